"""Stock policies of LeRobot at work in our environment, so that they stand in one table with ours.

They are trained by LeRobot's own trainer on what `dataset export --format lerobot` wrote, and act by its own code; here
they are given what the environment shows of the state, under the names that a data set has, and nothing else.
LeRobot has to be installed beside this program, which it is in no environment that `make setup` makes.

Source: lerobot 0.6, `rollout` of its `scripts/lerobot_eval.py`.
"""

from __future__ import annotations

import importlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np
import torch
from numpy.typing import NDArray

from executor.machine.files import content_key, read_json
from executor.policies.settings import Acts, PolicySettings, Sees
from executor.policies.trained import ABOUT, NotAPolicy, PolicyRecord
from executor.policies.windows import LearnedFrom
from executor.robot.actions import HAND_NUMBERS, TARGETS

CONFIG, WEIGHTS = "config.json", "model.safetensors"
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
        step: 0, as it does not say.

    Raises:
        NotAPolicy: LeRobot is not installed, or does not read it; or its actions are none of the environment's.
    """

    def __init__(self, folder: Path, data: LearnedFrom) -> None:
        self.name = self.folder = str(folder)
        self.step = 0
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
            kinds=data.kinds,
            seeds=data.seeds,
            demonstrations=data.demonstrations,
            takeovers=data.takeovers,
            ways=0,
            data_key=content_key(data.key, str(config.type), str(self.execute)),
        )
        self._sentence = data.kinds[0].origin.query if data.kinds else ""

    def begin(self, plan: Sequence[int], seed: int) -> None:
        """Begins an episode; of its plan it is told nothing, and what it draws follows from the seed."""
        torch.manual_seed(seed)
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
        return np.asarray(action.to("cpu").numpy()[0])


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


def _seed(folder: Path) -> int:
    """Returns the seed of its training, as its trainer wrote it down; 0 where it did not."""
    try:
        return int(read_json(folder / "train_config.json")["seed"])
    except (OSError, ValueError, KeyError, TypeError):
        return 0
