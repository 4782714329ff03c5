"""Samples the motion at a fixed rate and hashes every sample."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from typing import Any

import numpy as np

from executor.geometry import Array, pose_vector
from executor.primitives.control import Controller
from executor.records.rollout import Trajectory
from executor.robot.kinematics import Kinematics
from executor.rollouts.peaks import PeakWatch
from executor.world.penetration import Overlap, deepest
from executor.world.world import World


class TrajectoryRecorder:
    """Collects the rows of a trajectory.

    Args:
        kinematics: For the hand's pose.
        rate_hz: Samples a second of simulated time.
        state_hash: Hash of what was recorded before, when a run is resumed.
    """

    def __init__(self, kinematics: Kinematics, rate_hz: float, state_hash: str = "") -> None:
        self._kinematics = kinematics
        self._rate_hz = rate_hz
        self.state_hash = state_hash
        self.world: World | None = None
        self.control: Controller | None = None
        self.subtask, self.step = 0, -1
        self._rows: list[dict[str, object]] = []
        self._packed: list[bytes] = []
        self.overlaps: list[Overlap] = []
        self.peaks: list[Array] = []
        self._watch = PeakWatch()

    def after_step(self) -> None:
        """Takes a sample when one is due; called after every physics step."""
        world = self.world
        if world is None or self.control is None:
            return
        self._watch.look(world, self.control)
        every = max(round(1.0 / (self._rate_hz * world.timestep_s)), 1)
        if world.steps % every:
            return
        self.state_hash = hashlib.sha256(self.state_hash.encode() + world.state_vector().tobytes()).hexdigest()
        qpos = np.asarray(world.robot.get_qpos(), dtype=np.float32)
        fingers = [self.control.finger_target_m] * 2
        self._rows.append(
            {
                "time_s": world.time_s,
                "robot_qpos": qpos,
                "robot_qvel": np.asarray(world.robot.get_qvel(), dtype=np.float32),
                "robot_target": np.concatenate([self.control.target, fingers]).astype(np.float32),
                "eef_pose": pose_vector(self._kinematics.forward(qpos.astype(np.float64))).astype(np.float32),
                "subtask": self.subtask,
                "step": self.step,
                **{f"object:{i}": pose_vector(world.T_world_link(i)) for i in world.dynamic_ids},
                **{
                    f"joints:{i}": [world.joint_position(i, joint.name) for joint in world.assets[i].joints]
                    for i in world.articulated_ids
                },
            }
        )
        self._packed.append(world.pack())
        self.overlaps.append(deepest(world))
        self.peaks.append(self._watch.take())

    @property
    def samples(self) -> int:
        """How many samples were taken."""
        return len(self._rows)

    def rewind(self, samples: int, state_hash: str) -> None:
        """Forgets what was recorded after the first samples, when a run goes back to a checkpoint.

        Args:
            samples: How many to keep.
            state_hash: The checkpoint's hash.
        """
        for rows in self._all():
            del rows[samples:]
        self.state_hash = state_hash

    def recorded(self) -> tuple[str, list[list[Any]]]:
        """Returns what was recorded so far, for `restore`."""
        return self.state_hash, [list(rows) for rows in self._all()]

    def restore(self, recorded: tuple[str, list[list[Any]]]) -> None:
        """Makes an earlier recording the present one, with all that was recorded since it forgotten."""
        self.state_hash = recorded[0]
        for rows, kept in zip(self._all(), recorded[1], strict=True):
            rows[:] = kept

    def _all(self) -> tuple[list[Any], ...]:
        return self._rows, self._packed, self.overlaps, self.peaks

    def trajectory(self) -> Trajectory:
        """Returns what was recorded so far."""

        def column(name: str, dtype: type) -> np.ndarray:
            return np.array([row[name] for row in self._rows], dtype=dtype)

        def columns(prefix: str) -> Mapping[str, np.ndarray]:
            names = [name for name in self._rows[0] if name.startswith(prefix)] if self._rows else []
            return {name.removeprefix(prefix): column(name, np.float32) for name in names}

        return Trajectory(
            time_s=column("time_s", np.float64),
            robot_qpos=column("robot_qpos", np.float32),
            robot_qvel=column("robot_qvel", np.float32),
            robot_target=column("robot_target", np.float32),
            eef_pose=column("eef_pose", np.float32),
            object_poses=columns("object:"),
            joint_positions=columns("joints:"),
            subtask=column("subtask", np.int32),
            step=column("step", np.int32),
            packed_states=tuple(self._packed),
        )
