"""What a policy is told in numbers: the robot, the things around it, their joints, and where a hand takes hold.

Lengths of vectors do not depend on the scene: there are rows for so many things and handles, those that the task names
first, in the order in which it names them; rows that are not used are 0, and their first number says so.
"""

from __future__ import annotations

from collections.abc import Container, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

import bddl
from executor.geometry import quaternions_last
from executor.robot.actions import TARGETS
from executor.robot.description import TCP_LINK
from executor.world.world import World
from oag import Task

Vector = NDArray[np.float32]

AGENT = TARGETS + 7 + 1
"""Joint positions (12: base x y yaw, arm, fingers), hand pose in the world (x y z, quaternion x y z w), opening (m)."""

THINGS, THING = 12, 14
"""Rows of things: there (1 or 0), position x y z, quaternion x y z w, extent along its axes (3), grasp point x y z."""

HANDLES, HANDLE = 8, 6
"""Rows of handles: there, joint position (rad or m), share of its range (0 shut, 1 open), middle of the bar x y z."""

ENVIRONMENT = THINGS * THING + HANDLES * HANDLE
LARGEST = 1000.0
"""No number is larger: metres, radians, in rooms of at most ten metres either way."""


def named(task: Task, names: Container[str]) -> tuple[str, ...]:
    """Returns those objects out of `names` that a task names, in the order in which it does."""
    said = [
        name
        for subtask in task.subtasks
        for name in (subtask.target, subtask.support_init, subtask.support_goal)
        if name is not None
    ]
    said += [name for atom in sorted(bddl.atoms(task.goal), key=bddl.format) for name in atom.args]
    return tuple(dict.fromkeys(name for name in said if name in names))


class StateReader:
    """Reads one world into vectors.

    Args:
        world: Where things are.
        task: Decides which things come first.

    Attributes:
        things: Ids of the things, row by row.
        handles: "id/joint" of what each row of handles opens.
    """

    def __init__(self, world: World, task: Task) -> None:
        self._world = world
        names = tuple(dict.fromkeys([*named(task, world.assets), *world.assets]))
        self.things = names[:THINGS]
        self._handles = [(name, handle) for name in names for handle in world.assets[name].handles][:HANDLES]
        self.handles = tuple(f"{name}/{handle.joint}" for name, handle in self._handles)
        self._rows = np.zeros((THINGS, THING), np.float32)
        self._handle_rows = np.zeros((HANDLES, HANDLE), np.float32)
        self._positions: dict[int, float] = {}  # Of the handles' joints as they were read last; furniture stands fast.
        self._grasp_points_m = np.array([world.assets[name].grasp_point_m for name in self.things]).reshape(-1, 3)
        self._moving = [row for row, name in enumerate(self.things) if name in world.dynamic_ids]
        for row, name in enumerate(self.things):
            self._rows[row, 0], self._rows[row, 8:11] = 1.0, world.assets[name].extent_m
        # What stands fast is read once.
        self._place(range(len(self.things)))

    def agent(self) -> Vector:
        """Returns (AGENT,) the robot itself."""
        qpos = np.asarray(self._world.robot.get_qpos())
        hand = self._world.robot.find_link_by_name(TCP_LINK).entity_pose
        pose = quaternions_last(np.concatenate([hand.p, hand.q]))
        return np.concatenate([qpos, pose, [qpos[TARGETS - 2 :].sum()]]).astype(np.float32)

    def environment(self) -> Vector:
        """Returns (ENVIRONMENT,) things and handles."""
        self._place(self._moving)
        for row, (name, handle) in enumerate(self._handles):
            position = self._world.joint_position(name, handle.joint)
            if position == self._positions.get(row):
                continue
            self._positions[row] = position
            T_world_link = self._world.T_world_link(name, handle.link)
            bar_m = T_world_link[:3, :3] @ np.asarray(handle.position_m) + T_world_link[:3, 3]
            joint = self._world.assets[name].joint(handle.joint)
            self._handle_rows[row] = [1.0, position, joint.fraction(position), *bar_m]
        return np.concatenate([self._rows.ravel(), self._handle_rows.ravel()])

    def _place(self, rows: Sequence[int]) -> None:
        """Writes where the things of these rows are."""
        if not len(rows):
            return
        chosen = list(rows)
        poses = self._world.root_poses(self.things[row] for row in chosen)
        turns = Rotation.from_quat(poses[:, 3:], scalar_first=True).as_matrix()
        self._rows[chosen, 1:8] = quaternions_last(poses)
        self._rows[chosen, 11:14] = np.einsum("nij,nj->ni", turns, self._grasp_points_m[chosen]) + poses[:, :3]
