"""The solid parts of a scene at one moment as boxes: tests of occlusion, and of lenses inside a solid.

Every collision shape is one oriented box: itself where it is a box, the box around it where it is not. So "inside" errs
on the safe side, and furniture, which is made of boxes, is exact: with its doors where they stand.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from executor.assets.asset_geometry import joint_transform
from executor.assets.library import asset_for
from executor.assets.model import Asset, Shape
from executor.assets.parameters import number
from executor.geometry import Array, transform_from_quaternion
from oag import Scene, SceneObject

_NOTHING: Mapping[str, ArrayLike] = {}


@dataclass(frozen=True, slots=True)
class Solids:
    """Boxes, N of them.

    Attributes:
        owners: (N,) the object that each belongs to.
        axes: (N, 3, 3) orientations in the world, one axis a column.
        middles: (N, 3) in metres.
        halves: (N, 3) half extents in metres.
    """

    owners: NDArray[np.str_]
    axes: Array
    middles: Array
    halves: Array

    @classmethod
    def of(
        cls,
        scene: Scene,
        joints: Mapping[str, ArrayLike] = _NOTHING,
        poses: Mapping[str, ArrayLike] = _NOTHING,
    ) -> Solids:
        """Return the solid parts of a scene.

        Args:
            scene: The concrete scene.
            joints: Id of an articulated object -> its joints [rad] or [m], in the asset's order; by default those of
                the scene.
            poses: Id of an object -> (7,) position and quaternion w x y z of its root; by default those of the scene.
        """
        owners: list[str] = []
        boxes: list[tuple[Array, Array]] = []
        for name, thing in scene.objects.items():
            asset = asset_for(thing)
            pose = np.asarray(poses.get(name, (*thing.position, *thing.orientation)), dtype=float)
            T_world_root = transform_from_quaternion(pose[:3], pose[3:])
            frames = link_frames(asset, joints[name] if name in joints else joints_at_start(thing))
            for link in asset.links:
                for shape in link.shapes:
                    if shape.collides:
                        T_shape_box, half = _box_around(shape)
                        boxes.append((T_world_root @ frames[link.name] @ T_shape_box, half))
                        owners.append(name)
        poses_of = np.array([T for T, _ in boxes]).reshape(-1, 4, 4)
        halves = np.array([half for _, half in boxes]).reshape(-1, 3)
        return cls(np.array(owners, dtype=np.str_), poses_of[:, :3, :3], poses_of[:, :3, 3], halves)

    def without(self, owners: Collection[str]) -> Solids:
        """Return the solids without those of some objects."""
        keep = ~np.isin(self.owners, list(owners))
        return Solids(self.owners[keep], self.axes[keep], self.middles[keep], self.halves[keep])

    def with_box(self, owner: str, T_world_box: Array, half: ArrayLike) -> Solids:
        """Return the solids with one more box."""
        return Solids(
            np.append(self.owners, owner),
            np.concatenate([self.axes, T_world_box[None, :3, :3]]),
            np.concatenate([self.middles, T_world_box[None, :3, 3]]),
            np.concatenate([self.halves, np.asarray(half, dtype=float)[None]]),
        )

    def gap_m(self, point_m: ArrayLike) -> float:
        """Return how far a point (3,) is from the nearest solid or the floor; negative inside one."""
        point = np.asarray(point_m, dtype=float)
        beyond = np.abs(np.einsum("nji,nj->ni", self.axes, point - self.middles)) - self.halves
        outside = np.linalg.norm(np.maximum(beyond, 0.0), axis=1)
        inside = np.minimum(beyond.max(axis=1, initial=-np.inf), 0.0)
        return float(min((outside + inside).min(initial=np.inf), point[2]))

    def hidden(self, eye_m: ArrayLike, points_m: ArrayLike) -> NDArray[np.bool_]:
        """Return (P,) whether something solid is between an eye (3,) and each of some points (P, 3)."""
        eye, points = np.asarray(eye_m, dtype=float), np.atleast_2d(np.asarray(points_m, dtype=float))
        start = np.einsum("nji,nj->ni", self.axes, eye - self.middles)[:, None]
        ray = np.einsum("nji,pj->npi", self.axes, points - eye)
        ray = np.where(np.abs(ray) < 1e-12, 1e-12, ray)
        half = self.halves[:, None]
        first, second = (-half - start) / ray, (half - start) / ray
        enter = np.minimum(first, second).max(axis=2)
        leave = np.maximum(first, second).min(axis=2)
        # What a ray only reaches at its end is what is looked at.
        return np.asarray(((enter < leave) & (leave > 0.0) & (enter < 0.999)).any(axis=0))


def joints_at_start(thing: SceneObject, asset: Asset | None = None) -> list[float]:
    """Return the joints of an object when its scene is built, [rad] or [m], in the asset's order.

    Args:
        thing: The object.
        asset: Its asset, where it is built already.
    """
    fraction = number(thing, "open_fraction", 0.0, 0.0, 1.0)
    return [joint.position(fraction) for joint in (asset or asset_for(thing)).joints]


def link_frames(asset: Asset, joints: ArrayLike | Sequence[float]) -> dict[str, Array]:
    """Return link name -> (4, 4) pose in the root's frame, its joints somewhere (rad or m, in the asset's order)."""
    positions = np.asarray(joints, dtype=float)
    moved = {j.child: joint_transform(j, float(p)) for j, p in zip(asset.joints, positions, strict=True)}
    return {link.name: moved.get(link.name, np.eye(4)) for link in asset.links}


def _box_around(shape: Shape) -> tuple[Array, Array]:
    """Return a shape's box: (4, 4) pose of its middle in the link's frame and (3,) half extents."""
    T = transform_from_quaternion(shape.position_m, shape.orientation)
    if shape.kind == "box":
        return T, np.asarray(shape.size_m, dtype=float)
    if shape.kind == "sphere":
        return T, np.full(3, shape.size_m[0])
    if shape.kind == "cylinder":
        radius, half_length = shape.size_m
        return T, np.array([radius, radius, half_length])
    points = np.asarray(shape.vertices_m, dtype=float)
    low, high = points.min(axis=0), points.max(axis=0)
    T[:3, 3] += T[:3, :3] @ ((low + high) / 2)
    return T, (high - low) / 2
