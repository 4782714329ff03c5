"""One demonstration in memory, in columns: the only source of every dataset format.

An episode has N observations and N - 1 transitions. Observation i is sample i of the recording; the action of
transition i is what was commanded between samples i and i + 1.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

import bddl
from bddl.terminal import pluralize
from executor.records import Rollout, Trajectory
from executor.sim.render.cameras import camera_json, cameras_for
from executor.sim.render.frames import Frames, Picture
from executor.sim.robot.actions import joint_limits
from llm.offline.reader import paraphrases
from oag import Scene, Task, flow_to_json

ACTION_NAMES = (
    "base_forward",
    "base_left",
    "base_turn",
    *(f"arm_joint{index}" for index in range(1, 8)),
    "gripper",
)
# Fastest motion that an action of 1 stands for: m/s, m/s, rad/s for the base, rad/s for each arm joint.
ACTION_RATES = np.array([1.0, 1.0, 2.0, *[3.0] * 7])


class EpisodeTooShort(ValueError):
    """A recording with fewer than two samples has no transition to learn from."""

    def __init__(self, samples: int) -> None:
        super().__init__(f"an episode needs at least 2 recorded samples, this recording has {samples}")


@dataclass(frozen=True, slots=True)
class SubtaskSpan:
    """Where a subtask lies in an episode: samples `first` up to, but not including, `end`.

    Attributes:
        name, detail: Its texts.
        init, goal: BDDL text.
        flow: Its action flow as executed, as JSON.
        succeeded: Whether its regressed goal was reached.
    """

    name: str
    detail: str
    init: str
    goal: str
    flow: list[object]
    first: int
    end: int
    succeeded: bool


@dataclass(frozen=True, slots=True)
class Episode:
    """One recorded demonstration.

    Attributes:
        task, scene, seed: Task, concrete scene, and seed.
        succeeded: Whether the task's goal was reached.
        state_hash: Over the recorded states.
        trajectory: The recorded motion.
        rate_hz: Samples a second [Hz].
        images: View name -> (N, H, W, 3) uint8, all of one size; empty when nothing was rendered.
        actions: (N - 1, 11) float32 in [-1, 1], named by `ACTION_NAMES`: displacement of the base in its own frame
            and of the arm's joints, commanded for the interval and divided by `action_scale`; the gripper's
            commanded opening, -1 shut and 1 as far as the robot's fingers open.
        actions_absolute: (N - 1, 12) float32: the drive targets themselves, in the robot's joint order (m, rad).
        action_scale: (10,) displacement that an action of 1 stands for.
        clipped: How many of the actions' numbers had to be clipped to [-1, 1].
        object_poses: (N, 7 K) float32: position and quaternion w x y z of each dynamic object, in `object_ids` order.
        joint_positions: (N, J) float32: the joints of the articulated objects, in `joint_names` order.
        spans: The subtasks that ran.
        observations: Name -> (N, ...) further columns of a data set, in addition to these or instead of them.
        commanded: Name -> (N - 1, D) equivalent actions in other forms.
        rewards: (N - 1,) of every transition; by default 1 for the last one of a success.
        about: Further metadata as JSON; empty without any.
        query: The sentence that was typed; empty where a task file was executed.
        paraphrases: Other sentences for it.
        cameras: View name -> its camera (`camera_json`).
    """

    task: Task
    scene: Scene
    seed: int
    succeeded: bool
    state_hash: str
    trajectory: Trajectory
    rate_hz: float
    images: Mapping[str, Picture]
    actions: NDArray[np.float32]
    actions_absolute: NDArray[np.float32]
    action_scale: NDArray[np.float64]
    clipped: int
    object_ids: tuple[str, ...]
    object_poses: NDArray[np.float32]
    joint_names: tuple[str, ...]
    joint_positions: NDArray[np.float32]
    spans: tuple[SubtaskSpan, ...]
    observations: Mapping[str, NDArray[Any]] = field(default_factory=dict)
    commanded: Mapping[str, NDArray[np.float32]] = field(default_factory=dict)
    rewards: NDArray[np.float32] | None = None
    about: str = ""
    query: str = ""
    paraphrases: tuple[str, ...] = ()
    cameras: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)

    def __repr__(self) -> str:
        ended = "succeeded" if self.succeeded else "failed"
        return (
            f"<Episode {ended} of {self.task.name!r}, seed {self.seed}: {pluralize(len(self.actions) + 1, 'sample')}>"
        )

    @classmethod
    def from_rollout(cls, rollout: Rollout, frames: Frames | None = None, query: str = "") -> Episode:
        """Return the episode of a rollout, with pictures when there are any.

        Args:
            rollout: The rollout.
            frames: Its rendered pictures.
            query: The sentence that was typed, where one was.

        Raises:
            EpisodeTooShort: When fewer than two samples were recorded.
            ValueError: When pictures and samples differ in number.
        """
        return cls.from_samples(
            task=rollout.task,
            scene=rollout.scene,
            seed=rollout.seed,
            succeeded=rollout.succeeded,
            state_hash=rollout.state_hash,
            trajectory=rollout.trajectory,
            spans=_spans(rollout),
            frames=frames,
            query=query,
            paraphrases=paraphrases(query) if query else (),
            cameras={} if frames is None else _cameras(rollout, frames),
        )

    @classmethod
    def from_samples(
        cls,
        *,
        task: Task,
        scene: Scene,
        seed: int,
        succeeded: bool,
        state_hash: str,
        trajectory: Trajectory,
        spans: tuple[SubtaskSpan, ...],
        frames: Frames | None = None,
        observations: Mapping[str, NDArray[Any]] | None = None,
        commanded: Mapping[str, NDArray[np.float32]] | None = None,
        rewards: NDArray[np.float32] | None = None,
        about: str = "",
        query: str = "",
        paraphrases: tuple[str, ...] = (),
        cameras: Mapping[str, Mapping[str, Any]] | None = None,
    ) -> Episode:
        """Return the episode of a recorded motion and its metadata; see the attributes.

        Raises:
            EpisodeTooShort, ValueError: As for `from_rollout`.
        """
        count = len(trajectory.time_s)
        if count < 2:
            raise EpisodeTooShort(count)
        if frames is not None and frames.count != count:
            raise ValueError(f"expected {count} pictures of each view, got {frames.count}")
        rate_hz = 1.0 / float(np.median(np.diff(trajectory.time_s)))
        scale = ACTION_RATES / rate_hz
        opening_m = float(joint_limits(scene.robot.scale)[-1, 1])
        actions, clipped = _actions(trajectory.robot_qpos, trajectory.robot_target[1:], scale, opening_m)
        images = {} if frames is None else {view: frames.at_size(view) for view in frames.views}
        joints = {
            f"{owner}/{column}": positions[:, column]
            for owner, positions in trajectory.joint_positions.items()
            for column in range(positions.shape[1])
        }
        return cls(
            task=task,
            scene=scene,
            seed=seed,
            succeeded=succeeded,
            state_hash=state_hash,
            trajectory=trajectory,
            rate_hz=round(rate_hz, 6),
            images=images,
            actions=actions,
            actions_absolute=trajectory.robot_target[1:].astype(np.float32),
            action_scale=scale,
            clipped=clipped,
            object_ids=tuple(trajectory.object_poses),
            object_poses=_side_by_side(tuple(trajectory.object_poses.values()), count),
            joint_names=tuple(joints),
            joint_positions=_side_by_side(tuple(column[:, None] for column in joints.values()), count),
            spans=spans,
            observations=observations or {},
            commanded=commanded or {},
            rewards=rewards,
            about=about,
            query=query,
            paraphrases=paraphrases,
            cameras=cameras or {},
        )

    @property
    def length(self) -> int:
        """Number of transitions."""
        return len(self.actions)

    @property
    def states(self) -> NDArray[np.float32]:
        """(N, 24 + J + 7 K): robot positions and velocities, joints of the objects, poses of the objects."""
        trajectory = self.trajectory
        parts = [trajectory.robot_qpos, trajectory.robot_qvel, self.joint_positions, self.object_poses]
        return np.concatenate(parts, axis=1, dtype=np.float32)

    @property
    def state_names(self) -> tuple[str, ...]:
        """Name of the columns of `states`, in blocks: name and width."""
        blocks = ["robot_qpos:12", "robot_qvel:12", *(f"{name}:1" for name in self.joint_names)]
        return (*blocks, *(f"{name}:7" for name in self.object_ids))


def _actions(
    qpos: NDArray[np.float32], targets: NDArray[np.float32], scale: NDArray[np.float64], opening_m: float
) -> tuple[NDArray[np.float32], int]:
    """Return the normalised actions of every transition, and how many numbers were clipped.

    Args:
        qpos: (N, 12) joint positions.
        targets: (N - 1, 12) what was commanded between them.
        scale: (10,) displacement that an action of 1 stands for.
        opening_m: How far one finger of the robot opens.
    """
    now = qpos[:-1].astype(np.float64)
    moves = targets[:, :10].astype(np.float64) - now[:, :10]
    cosine, sine = np.cos(now[:, 2]), np.sin(now[:, 2])
    forward = cosine * moves[:, 0] + sine * moves[:, 1]
    left = -sine * moves[:, 0] + cosine * moves[:, 1]
    moves[:, 0], moves[:, 1] = forward, left
    gripper = targets[:, 10:12].mean(axis=1, keepdims=True) / opening_m * 2.0 - 1.0
    raw = np.concatenate([moves / scale, gripper], axis=1)
    clipped = int(np.count_nonzero(np.abs(raw) > 1.0 + 1e-6))
    return np.clip(raw, -1.0, 1.0).astype(np.float32), clipped


def _cameras(rollout: Rollout, frames: Frames) -> dict[str, dict[str, Any]]:
    """Return the cameras of a rollout's pictures, at the common size."""
    cameras = cameras_for(rollout.scene, tuple(frames.views), aspect=frames.size[0] / frames.size[1], task=rollout.task)
    return {camera.name: camera_json(camera, frames.size) for camera in cameras}


def _side_by_side(columns: tuple[NDArray[np.float32], ...], count: int) -> NDArray[np.float32]:
    if not columns:
        return np.zeros((count, 0), dtype=np.float32)
    return np.concatenate(columns, axis=1, dtype=np.float32)


def _spans(rollout: Rollout) -> tuple[SubtaskSpan, ...]:
    spans = []
    finished = {record.index: record for record in rollout.subtasks}
    for index, subtask in enumerate(rollout.task.subtasks):
        rows = np.flatnonzero(rollout.trajectory.subtask == index)
        if not len(rows):
            continue
        record = finished.get(index)
        flow = record.flow if record is not None else subtask.flow or ()
        spans.append(
            SubtaskSpan(
                name=subtask.name,
                detail=subtask.detail,
                init=bddl.format(subtask.init),
                goal=bddl.format(subtask.goal),
                flow=list(flow_to_json(flow)),
                first=int(rows[0]),
                end=int(rows[-1]) + 1,
                succeeded=record is not None and record.succeeded,
            )
        )
    return tuple(spans)
