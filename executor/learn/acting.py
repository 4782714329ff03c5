"""Policies at work: the protocol, trained policies of this program, and stock policies of LeRobot.

A trained policy predicts a chunk of actions per query. Stock policies are trained by LeRobot's own trainer on an export
(`dataset export --format lerobot`), and LeRobot's code executes them. They observe the environment's state, or the
robot's joints and pictures, under the names of a data set, so that one table compares them with trained policies.
LeRobot is an extra installation: `make setup` does not install it.

Source: lerobot 0.6, `rollout` of its `scripts/lerobot_eval.py`.
"""

from __future__ import annotations

import importlib
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal, Protocol

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from executor.data.state_readers import AGENT_MORE
from executor.envs.episodes import family_source
from executor.learn.action_chunks import to_world_targets
from executor.learn.demonstrations import MOST_GRASP_MODES, EpisodeKind, LearnedFrom, draw_point_indices, robot_of_kinds
from executor.learn.networks import PolicyNetwork
from executor.learn.observations import (
    Numbers,
    own_numbers,
    primitive_of,
    robot_numbers,
    shown_numbers,
    state_numbers,
    subtask_of,
)
from executor.learn.phases import PlanFollower
from executor.learn.policy_record import ABOUT, NotAPolicy, PolicyRecord, load_network, normalise, read_record
from executor.learn.settings import Acts, PolicySettings, Sees
from executor.sim.render.cameras import VIEWS
from executor.sim.robot.actions import hand_numbers
from executor.system.files import content_key, json_text, read_json


class Policy(Protocol):
    """A policy that acts in one episode after the other: a trained one, or a stock policy of LeRobot."""

    name: str
    folder: str
    record: PolicyRecord
    execute: int
    step: int
    picture_size: tuple[int, int] | None
    """Width and height of the pictures that it observes; None where it observes none."""
    home: bool
    """Whether these show a home, as those that it was trained on did."""

    def begin(self, plan: Sequence[int], seed: int) -> None:
        """Begin an episode with the step numbers of its plan and its seed."""

    def go_on(self, plan: Sequence[int]) -> None:
        """Continue in the middle of an episode with the rest of its plan."""

    @property
    def subtask(self) -> int:
        """Index of the subtask that it takes for the running one; 0 where it observes no plan."""

    @property
    def restarts(self) -> int:
        """Number of restarts of a grasp or the plan since the episode began."""

    def act(self, observation: Mapping[str, Any]) -> NDArray:
        """Return the next action."""


class TrainedPolicy:
    """A trained policy that acts in one episode after the other.

    All arguments but the network are attributes of the same names.

    Args:
        name: Name in results.
        execute: Executed actions per chunk; by default those of the training's settings.
        step: Step of training of its weights; by default the last.
        folder: Folder of the record and the weights; by default the name.
    """

    def __init__(
        self,
        name: str,
        record: PolicyRecord,
        network: PolicyNetwork,
        execute: int | None = None,
        step: int | None = None,
        folder: str = "",
    ) -> None:
        self.name, self.record = name, record
        self.folder = folder or name
        self.picture_size: tuple[int, int] | None = None
        self.home = False
        self.step = record.settings.training.steps if step is None else step
        self._network, self._settings = network.eval(), record.settings
        self.execute = execute or record.settings.acts.execute
        self._frames: deque[tuple[Numbers, int, NDArray | None]] = deque(maxlen=record.settings.sees.frames)
        self._waiting: list[NDArray] = []
        self._grasp_modes: dict[int, int] = {}
        self._began: NDArray | None = None
        self._follower = PlanFollower(record, self.execute)
        mean, deviation = record.numbers
        self._scales = torch.from_numpy(mean), torch.from_numpy(deviation)
        self._points: NDArray[np.int64] | None = None

    @classmethod
    def load(cls, folder: Path, step: int | None = None, execute: int | None = None) -> TrainedPolicy:
        """Load the policy of a folder.

        Args:
            step: Step of training; by default the last.
        """
        record = read_record(folder)
        name = str(folder) if step is None else f"{folder}@{step}"
        return cls(name, record, load_network(folder, record, step), execute, step, str(folder))

    @property
    def phase(self) -> int:
        """Number of the step that it takes for the running one."""
        return self.record.steps[self._follower.phase]

    @property
    def restarts(self) -> int:
        """Number of restarts of a grasp or the plan since the episode began."""
        return self._follower.restarts

    @property
    def subtask(self) -> int:
        """Index of the subtask that it takes for the running one; 0 where it observes no plan."""
        return subtask_of(self.phase) if self._settings.sees.phase else 0

    def begin(self, plan: Sequence[int], seed: int) -> None:
        """Begin an episode.

        Args:
            plan: Step numbers of the episode's plan (`observations.py`), in order; the policy observes the running one,
                if it was trained so (`phases.py`).
            seed: Seed of the episode; it chooses among points as for demonstrations.

        Raises:
            NotAPolicy: It was not trained on a step of the plan, as of a task of another kind.
        """
        if self._settings.sees.phase and (foreign := [step for step in plan if step not in self.record.steps]):
            learned = ", ".join(dict.fromkeys(kind.origin.label for kind in self.record.kinds))
            step = f"{primitive_of(foreign[0]).name} in subtask {subtask_of(foreign[0])}"
            raise NotAPolicy(
                f"{self.name} has learned nothing of {step}, which this task's plan has; it was trained on {learned}"
            )
        self._began = None
        if self._settings.sees.kind == "cloud":
            self._points = draw_point_indices(self._settings.sees.points, seed)
        self.go_on(plan)

    def go_on(self, plan: Sequence[int]) -> None:
        """Continue in the middle of an episode, as at its beginning but for the first observation."""
        self._follower.begin(plan)
        self._frames.clear()
        self._waiting.clear()
        self._grasp_modes.clear()

    def act(self, observation: Mapping[str, Any]) -> NDArray:
        """Return the next action: (J,) joint targets or (H,) a hand action."""
        self._observe(observation)
        if not self._waiting:
            chunk = self._predict_actions(np.asarray(observation["agent_pos"], float)[:-AGENT_MORE])
            self._waiting = list(require_finite(chunk, self.folder))
        return self._waiting.pop(0)

    def _observe(self, observation: Mapping[str, Any]) -> None:
        agent, sees = np.asarray(observation["agent_pos"])[None], self._settings.sees
        cloud: NDArray | None = None
        if self._points is None:
            environment = np.asarray(observation["environment_state"])[None]
            if self._began is None:
                self._began = environment[0]
            numbers = state_numbers(agent, environment, sees, self._began)
        else:
            cloud = np.asarray(observation["point_cloud"], np.float32)[self._points]
            numbers = own_numbers(agent)
            if sees.locates:
                numbers, cloud = self._network.located(robot_numbers(agent), cloud[None]), None
        frame = (numbers[0], self._follower.phase if sees.phase else 0, cloud)
        self._frames.extend([frame] * (1 if self._frames else sees.frames))

    def _grasp_mode_of_subtask(self, numbers: Tensor, phase: Tensor) -> int:
        """Return the grasp mode of the running subtask, which stays for the subtask.

        A policy that does not choose takes the most frequent mode of the demonstrations.
        """
        if not self._settings.sees.chooses:
            return 0
        if self.subtask not in self._grasp_modes:
            grasp_modes = self._network(numbers[None], phase[None], None, torch.zeros_like(phase)[None]).grasp_modes
            assert grasp_modes is not None
            self._grasp_modes[self.subtask] = int(grasp_modes[0, : MOST_GRASP_MODES - 1].argmax())
        return self._grasp_modes[self.subtask]

    def _predict_actions(self, qpos: NDArray) -> NDArray:
        """Predict the next actions: (execute, J or H).

        If the phase advanced, query the network again with the new phase: no demonstration shows an action of a
        finished step.
        """
        found, logits = self._query_network()
        if logits is not None:
            before, sees, (numbers, _, cloud) = self._follower.phase, self._settings.sees, self._frames[-1]
            self._follower.go_on(
                logits[0], shown_numbers(self.record.robot, numbers[None], sees.places, sees.things, sees.handles)[0]
            )
            if self._follower.phase != before:
                self._frames[-1] = (numbers, self._follower.phase, cloud)
                found, logits = self._query_network()
                assert logits is not None
            self._follower.note_prediction(logits[self.execute - 1])
        mean, deviation = (part[self._frames[-1][1]] for part in self.record.actions)
        chunk = (found * deviation + mean)[: self.execute]
        if self._settings.acts.kind == "joint_target":
            chunk = to_world_targets(self.record.robot, qpos, chunk)
        return chunk

    def _query_network(self) -> tuple[NDArray, NDArray | None]:
        """Return the network's prediction: (chunk, A) normalised actions, and (chunk, P) logits of the step after each.

        The logits are None where it observes no steps.
        """
        phase = torch.tensor([frame[1] for frame in self._frames])
        frame_numbers = torch.from_numpy(np.stack([frame[0] for frame in self._frames]))
        numbers = normalise(frame_numbers, phase, self._scales)
        clouds = [frame[2] for frame in self._frames if frame[2] is not None]
        cloud = torch.from_numpy(np.stack(clouds))[None] if clouds else None
        with torch.inference_mode():
            phase_input = phase[None] if self._settings.sees.phase else None
            grasp_mode = torch.full_like(phase, self._grasp_mode_of_subtask(numbers, phase))[None]
            found, logits, _ = self._network(numbers[None], phase_input, cloud, grasp_mode)
        return found[0, -1].numpy(), None if logits is None else logits[0, -1].numpy()


def require_finite(actions: NDArray, policy: str) -> NDArray:
    """Refuse actions that are not finite."""
    if not np.isfinite(actions).all():
        raise NotAPolicy(f"{policy} gives actions that are not finite: its weights are not, or what it sees is not")
    return actions


CONFIG, TRAINING = "config.json", "train_config.json"
STEP = "training_state/training_step.json"
"""State of training, next to the policy's folder."""
PICTURE = "observation.images."
"""Beginning of the names of pictures in exported data sets."""

_NO_EFFECT = ("seed", "output_dir", "job_name", "resume", "checkpoint_path", "wandb")
"""Keys of a training without effect on the weights, and its seed."""

_MOST_CHUNK = 64  # Longest chunk of this program's settings.


def is_stock(folder: Path) -> bool:
    """Decide whether a folder holds a policy of LeRobot (its `pretrained_model`), and none of this program."""
    return (folder / CONFIG).is_file() and not (folder / ABOUT).exists()


class LeRobotPolicy:
    """A policy of LeRobot that acts in one episode after the other.

    Args:
        data: Its training data, which it does not record reliably.

    Attributes:
        name, folder: Its folder.
        record: A record in the form of trained policies: its observations, actions and training data.
        execute: Executed actions between observations.
        step: Step of training, as its trainer recorded it; 0 without a record.
        picture_size: Width and height of the pictures that it observes; None where it observes none.
        home: Whether these show a home, as its training data's do.

    Raises:
        NotAPolicy: LeRobot is not installed, or cannot read it; or its actions or pictures are not the environment's.
    """

    def __init__(self, folder: Path, data: LearnedFrom) -> None:
        self.name = self.folder = str(folder)
        self.step, self.home = _step(folder) or 0, data.home
        self._policy, self._before, self._after = _load_lerobot_policy(folder)
        config = self._policy.config
        self._views, self.picture_size = _observed_views(folder, getattr(config, "image_features", None) or {})
        numbers = int(config.action_feature.shape[0])
        robot = robot_of_kinds(data.kinds)
        action_kinds: dict[int, Literal["joint_target", "paper"]]
        action_kinds = {hand_numbers(robot): "paper", len(robot.joint_names): "joint_target"}
        if numbers not in action_kinds:
            known = " or ".join(map(str, action_kinds))
            raise NotAPolicy(f"{folder} does {numbers} numbers at a time; the environment takes {known}")
        self.execute = int(getattr(config, "n_action_steps", 1))
        chunk = min(max(int(getattr(config, "chunk_size", self.execute)), self.execute), _MOST_CHUNK)
        none = np.zeros(0, np.float32)
        self.record = PolicyRecord(
            settings=PolicySettings(
                sees=Sees(kind="state"),
                acts=Acts(kind=action_kinds[numbers], chunk=chunk, execute=min(self.execute, chunk)),
            ),
            seed=_seed(folder),
            rate_hz=data.rate_hz,
            steps=(),
            numbers=(none, none),
            actions=(none, none),
            exit_bounds=(none, none),
            longest_s=none,
            kinds=data.kinds,
            seeds=data.seeds,
            demonstrations=data.demonstrations,
            takeovers=data.takeovers,
            grasp_modes=0,
            data_key=content_key(data.key, str(self.execute), _training_key(folder)),
        )
        self._sentence = ""
        self.expect(data.kinds[0])

    def expect(self, kind: EpisodeKind) -> None:
        """Set the distribution of its episodes, by default its training data's: it observes each one's sentence."""
        self._sentence_of = _sentences(kind)

    def begin(self, plan: Sequence[int], seed: int) -> None:
        """Begin an episode; it does not observe the plan, and its draws follow from the seed."""
        self._sentence = self._sentence_of(seed)
        torch.manual_seed(seed)
        self.go_on(plan)

    def go_on(self, plan: Sequence[int]) -> None:
        self._policy.reset()

    @property
    def subtask(self) -> int:
        return 0

    @property
    def restarts(self) -> int:
        return 0

    def act(self, observation: Mapping[str, Any]) -> NDArray:
        """Return the next action: (J,) joint targets or (H,) a hand action."""
        batch = {"observation.state": _batch_of_one(observation["agent_pos"]), "task": [self._sentence]}
        if "environment_state" in observation:
            batch["observation.environment_state"] = _batch_of_one(observation["environment_state"])
        for view in self._views:
            # LeRobot has pictures as (C, H, W) from 0 to 1.
            shares = np.moveaxis(np.asarray(observation["pixels"][view], np.float32), -1, 0) / 255.0
            batch[PICTURE + view] = _batch_of_one(shares)
        with torch.inference_mode():
            action = self._after(self._policy.select_action(self._before(batch)))
        return require_finite(np.asarray(action.to("cpu").numpy()[0]), self.folder)


def _observed_views(folder: Path, features: Mapping[str, Any]) -> tuple[tuple[str, ...], tuple[int, int] | None]:
    """Return the views that a policy observes and the size of their pictures; None without views.

    Raises:
        NotAPolicy: It has other pictures than the environment, or pictures of several sizes.
    """
    views = tuple(name.removeprefix(PICTURE) for name in sorted(features))
    sizes = {(int(feature.shape[2]), int(feature.shape[1])) for feature in features.values()}
    if not set(views) <= set(VIEWS) or len(sizes) > 1:
        legal = ", ".join(PICTURE + view for view in VIEWS)
        raise NotAPolicy(f"{folder} observes {', '.join(sorted(features))}; the environment has {legal}, of one size")
    return views, next(iter(sizes), None)


def _batch_of_one(values: Any) -> torch.Tensor:
    return torch.from_numpy(np.asarray(values, np.float32)[None])


def _load_lerobot_policy(folder: Path) -> tuple[Any, Any, Any]:
    """Load a policy of LeRobot, with its pre- and postprocessors."""
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
    """Return a function from an episode's seed to its sentence."""
    if kind.origin.family is None:
        return lambda seed: kind.origin.query
    # As the environment draws and caches it: nothing is drawn twice.
    draw = family_source(kind.origin.family, kind.variation, robot=kind.robot_name)
    return lambda seed: draw(seed, None).query


def _seed(folder: Path) -> int:
    """Return the seed of its training, as its trainer recorded it; 0 without a record."""
    try:
        return int(read_json(folder / TRAINING)["seed"])
    except (OSError, ValueError, KeyError, TypeError):
        return 0


def _step(folder: Path) -> int | None:
    """Return its step of training; None without its trainer's record."""
    try:
        return int(read_json(folder.resolve().parent / STEP)["step"])
    except (OSError, ValueError, KeyError, TypeError):
        return None


def _training_key(folder: Path) -> str:
    """Return a key that is equal when two policies differ only in the seed of training.

    That is: equal recorded configuration, training and steps. A policy without a record is like no other.
    """
    step, alone = _step(folder), str(folder.resolve())
    try:
        config, training = read_json(folder / CONFIG), read_json(folder / TRAINING)
        if step is None or training.get("seed") is None:
            return alone
        for config_part in (config, training.get("policy") or {}):
            config_part.pop("repo_id", None)
        return json_text(
            [step, config, {name: config_part for name, config_part in training.items() if name not in _NO_EFFECT}]
        )
    except (OSError, ValueError, AttributeError, TypeError):
        return alone
