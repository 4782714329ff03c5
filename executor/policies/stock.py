"""Stock policies of LeRobot at work in our environment, so that they stand in one table with ours.

They are trained by LeRobot's own trainer on what `dataset export --format lerobot` wrote, and act by its own code; here
they are given what the environment shows of the state, under the names that a data set has, and nothing else.
LeRobot has to be installed beside this program, which it is in no environment that `make setup` makes.

Source: lerobot 0.6, `rollout` of its `scripts/lerobot_eval.py`.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np
import torch
from numpy.typing import NDArray

from executor.envs.episodes import of_family
from executor.machine.files import content_key, json_text, read_json
from executor.policies.acting import finite
from executor.policies.settings import Acts, PolicySettings, Sees
from executor.policies.trained import ABOUT, NotAPolicy, PolicyRecord
from executor.policies.windows import EpisodeKind, LearnedFrom
from executor.robot.actions import HAND_NUMBERS, TARGETS

CONFIG, TRAINING = "config.json", "train_config.json"
STEP = "training_state/training_step.json"
"""Beside the policy's folder, where its trainer keeps what training goes on from."""

_WITHOUT_A_SAY = ("seed", "output_dir", "job_name", "resume", "checkpoint_path", "wandb")
"""Of a training: its seed, and what says only where it is kept and how it is told of."""

_MOST = 64  # Actions of a chunk that settings of ours can say.
_KINDS: Mapping[int, Literal["joint_target", "paper"]] = {HAND_NUMBERS: "paper", TARGETS: "joint_target"}


def is_stock(folder: Path) -> bool:
    """Decides whether a folder holds a policy of LeRobot (its `pretrained_model`), and none of ours."""
    return (folder / CONFIG).is_file() and not (folder / ABOUT).exists()


class StockActor:
    """A policy of LeRobot that acts in one episode after the other.

    Args:
        folder: Where it is.
        data: What it was trained on, as it says nothing of that which could be believed.

    Attributes:
        name, folder: Where it is.
        record: What is known of it, in the form of our own policies: what it sees and does, and what it learned from.
        execute: How many actions it does before it looks again.
        step: After how many steps of training it is as it is, as its trainer wrote that down; 0 where it did not.

    Raises:
        NotAPolicy: LeRobot is not installed, or does not read it; or its actions are none of the environment's.
    """

    def __init__(self, folder: Path, data: LearnedFrom) -> None:
        self.name = self.folder = str(folder)
        self.step = _step(folder) or 0
        self._policy, self._before, self._after = _loaded(folder)
        config = self._policy.config
        if pictures := sorted(getattr(config, "image_features", None) or ()):
            raise NotAPolicy(f"{folder} sees {', '.join(pictures)}; here it is shown the state, and no pictures")
        numbers = int(config.action_feature.shape[0])
        if numbers not in _KINDS:
            known = " or ".join(map(str, _KINDS))
            raise NotAPolicy(f"{folder} does {numbers} numbers at a time; the environment takes {known}")
        self.execute = int(getattr(config, "n_action_steps", 1))
        chunk = min(max(int(getattr(config, "chunk_size", self.execute)), self.execute), _MOST)
        none = np.zeros(0, np.float32)
        self.record = PolicyRecord(
            settings=PolicySettings(
                sees=Sees(kind="state"),
                acts=Acts(kind=_KINDS[numbers], chunk=chunk, execute=min(self.execute, chunk)),
            ),
            seed=_seed(folder),
            rate_hz=data.rate_hz,
            steps=(),
            numbers=(none, none),
            actions=(none, none),
            left=(none, none),
            longest_s=none,
            kinds=data.kinds,
            seeds=data.seeds,
            demonstrations=data.demonstrations,
            takeovers=data.takeovers,
            ways=0,
            data_key=content_key(data.key, str(self.execute), _training_key(folder)),
        )
        self._sentence = ""
        self.expect(data.kinds[0])

    def expect(self, kind: EpisodeKind) -> None:
        """Says what its episodes are drawn from, by default what it was trained on: it is told each one's sentence."""
        self._sentence_of = _sentences(kind)

    def begin(self, plan: Sequence[int], seed: int) -> None:
        """Begins an episode; of its plan it is told nothing, and what it draws follows from the seed."""
        self._sentence = self._sentence_of(seed)
        torch.manual_seed(seed)
        self.go_on(plan)

    def go_on(self, plan: Sequence[int]) -> None:
        """Forgets what it was about to do."""
        self._policy.reset()

    @property
    def subtask(self) -> int:
        """It is told nothing of subtasks."""
        return 0

    @property
    def anew(self) -> int:
        """It has no plan that could be begun anew."""
        return 0

    def act(self, observation: Mapping[str, Any]) -> NDArray:
        """Returns the next action: (12,) joint targets or (10,) a hand action."""
        seen = {
            "observation.state": _row(observation["agent_pos"]),
            "observation.environment_state": _row(observation["environment_state"]),
            "task": [self._sentence],
        }
        with torch.inference_mode():
            action = self._after(self._policy.select_action(self._before(seen)))
        return finite(np.asarray(action.to("cpu").numpy()[0]), self.folder)


def _row(values: Any) -> torch.Tensor:
    return torch.from_numpy(np.asarray(values, np.float32)[None])


def _loaded(folder: Path) -> tuple[Any, Any, Any]:
    """Returns a policy of LeRobot, and what goes before and after it.

    Raises:
        NotAPolicy: LeRobot is not installed, or does not read it.
    """
    try:
        configs = importlib.import_module("lerobot.configs.policies")
        factory = importlib.import_module("lerobot.policies.factory")
    except ImportError as problem:
        message = f"{folder} holds a policy of LeRobot, which is not installed here ({problem})"
        raise NotAPolicy(f"{message}; docs/policies.md says how both are") from None
    try:
        config = configs.PreTrainedConfig.from_pretrained(folder)
        config.device = "cpu"
        policy = factory.get_policy_class(config.type).from_pretrained(folder, config=config)
        device = {"preprocessor_overrides": {"device_processor": {"device": "cpu"}}}
        before, after = factory.make_pre_post_processors(policy_cfg=config, pretrained_path=str(folder), **device)
    except (OSError, ValueError, KeyError, RuntimeError) as problem:
        raise NotAPolicy(f"{folder} holds no policy that LeRobot reads: {problem}") from None
    return policy.eval(), before, after


def _sentences(kind: EpisodeKind) -> Callable[[int], str]:
    """Returns what says the sentence of a seed's episode."""
    if kind.origin.family is None:
        return lambda seed: kind.origin.query
    # As the environment draws it, and remembers it: nothing is drawn twice.
    draw = of_family(kind.origin.family, kind.variation, full_size=kind.full_size)
    return lambda seed: draw(seed, None).query


def _seed(folder: Path) -> int:
    """Returns the seed of its training, as its trainer wrote it down; 0 where it did not."""
    try:
        return int(read_json(folder / TRAINING)["seed"])
    except (OSError, ValueError, KeyError, TypeError):
        return 0


def _step(folder: Path) -> int | None:
    """Returns after how many steps of training it is as it is; None where its trainer's word is not beside it."""
    try:
        return int(read_json(folder.resolve().parent / STEP)["step"])
    except (OSError, ValueError, KeyError, TypeError):
        return None


def _training_key(folder: Path) -> str:
    """Returns a key that is equal when two policies differ in nothing but the seed of their training.

    That is, when what they are, and how and for how long they were trained, is the same as it was written down. What
    was not written down may differ: such a policy is like no other.
    """
    step, alone = _step(folder), str(folder.resolve())
    try:
        config, training = read_json(folder / CONFIG), read_json(folder / TRAINING)
        if step is None or training.get("seed") is None:
            return alone
        for told in (config, training.get("policy") or {}):
            told.pop("repo_id", None)
        return json_text([step, config, {name: told for name, told in training.items() if name not in _WITHOUT_A_SAY}])
    except (OSError, ValueError, AttributeError, TypeError):
        return alone
