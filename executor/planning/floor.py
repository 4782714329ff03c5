"""The floor by footprints: where the base would stand within furniture, known without asking the engine.

Most of the places that a search thinks of are taken, and most of those by something upright and box-shaped. Two upright
boxes that overlap in the plan and in height overlap, so the engine would say the same. What this cannot decide, such as
round legs, things that lie about and mere nearness, is left to the engine.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy.spatial.transform import Rotation

from executor.assets.asset_geometry import joint_transform
from executor.assets.model import Link
from executor.geometry import Array
from executor.planning.collision import CollisionOracle
from executor.sim.robot.description import BASE_BOTTOM_M, BASE_SIDE_M
from oag.model.robots import Robot

UPRIGHT = 0.99999  # Of an axis: to a quarter of a degree.
DEEP_M = 0.001  # Overlaps are deeper than rounding.


class FloorPlan:
    """The upright boxes of all furniture at the height of the base, with doors and drawers as they stand.

    Args:
        oracle: Knows where joints are; what can be carried is left out.
    """

    def __init__(self, oracle: CollisionOracle) -> None:
        self._oracle = oracle
        self._fixed = np.array([box for name in self._furniture() for box in self._boxes(name, moving=False)])
        self._moving: dict[tuple[float, ...], Array] = {}

    def taken(self, bases: Array) -> Array:
        """Return which of some base poses (N, B) are within furniture, (N,); others may be taken all the same."""
        boxes = self._all_boxes()
        if not len(boxes):
            return np.zeros(len(bases), dtype=bool)
        # Boxes beyond reach of all poses overlap with none.
        middle_m = (bases[:, :2].min(axis=0) + bases[:, :2].max(axis=0)) / 2
        around_m = np.hypot(*(bases[:, :2] - middle_m).T).max() + BASE_SIDE_M
        boxes = boxes[np.hypot(*(boxes[:, :2] - middle_m).T) <= around_m + np.hypot(*boxes[:, 6:].T)]
        if not len(boxes):
            return np.zeros(len(bases), dtype=bool)
        half_m = BASE_SIDE_M / 2
        c, s = np.cos(bases[:, 2]), np.sin(bases[:, 2])
        mine = np.stack([np.stack([c, s], 1), np.stack([-s, c], 1)], axis=1)  # (N, axis, 2)
        centres_m, theirs, halves_m = boxes[:, :2], boxes[:, 2:6].reshape(-1, 2, 2), boxes[:, 6:]
        offset_m = centres_m[None] - bases[:, None, :2]  # (N, M, 2)
        along = np.abs(np.einsum("nax,mbx->nmab", mine, theirs))
        gaps_m = np.concatenate(
            [
                np.abs(np.einsum("nmx,nax->nma", offset_m, mine)) - half_m - np.einsum("nmab,mb->nma", along, halves_m),
                np.abs(np.einsum("nmx,mbx->nmb", offset_m, theirs)) - halves_m - half_m * along.sum(axis=2),
            ],
            axis=2,
        )
        return np.asarray((gaps_m.max(axis=2) < -DEEP_M).any(axis=1))

    def _furniture(self) -> Iterator[str]:
        return (name for name, asset in self._oracle.world.assets.items() if asset.motion != "dynamic")

    def _all_boxes(self) -> Array:
        """Return (M, 8) boxes: centre, two axes, half sides."""
        oracle, assets = self._oracle, self._oracle.world.assets
        names = [name for name in oracle.world.articulated_ids if assets[name].joints]
        key = tuple(oracle.joint_position((name, joint.name)) for name in names for joint in assets[name].joints)
        if key not in self._moving:
            moving = [box for name in names for box in self._boxes(name, moving=True)]
            self._moving = {key: np.array([*self._fixed, *moving]).reshape(-1, 8)}
        return self._moving[key]

    def _boxes(self, name: str, *, moving: bool) -> Iterator[Array]:
        world = self._oracle.world
        asset, T_root = world.assets[name], world.T_world_link(name)
        joint_of = {joint.child: joint for joint in asset.joints}
        for link in asset.links:
            joint = joint_of.get(link.name)
            if (joint is not None) is not moving:
                continue
            position = 0.0 if joint is None else self._oracle.joint_position((name, joint.name))
            T_link = T_root if joint is None else T_root @ joint_transform(joint, position)
            yield from _upright_boxes(self._oracle.robot, link, T_link)


def _upright_boxes(robot: Robot, link: Link, T_world_link: Array) -> Iterator[Array]:
    low_m, high_m = BASE_BOTTOM_M, robot.chassis_m
    for shape in link.shapes:
        if not shape.collides or shape.kind != "box":
            continue
        R = T_world_link[:3, :3] @ Rotation.from_quat(shape.orientation, scalar_first=True).as_matrix()
        up = int(np.argmax(np.abs(R[2])))
        centre_m = T_world_link[:3, :3] @ shape.position_m + T_world_link[:3, 3]
        half_m = shape.size_m[up]
        if abs(R[2, up]) < UPRIGHT or min(centre_m[2] + half_m, high_m) - max(centre_m[2] - half_m, low_m) < DEEP_M:
            continue
        level = [axis for axis in range(3) if axis != up]
        yield np.array([*centre_m[:2], *R[:2, level[0]], *R[:2, level[1]], *(shape.size_m[axis] for axis in level)])
