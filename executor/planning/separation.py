"""Configurations that are surely free, by boxes around all shapes: of whole paths at once, without asking the engine.

Each collision shape lies within a box. What separates two boxes along any direction separates the shapes in them by as
much, so a gap along one of fifteen directions is a lower bound of their distance. Where every bound exceeds the wanted
clearance the engine would report nothing. What this cannot decide is left to the engine.

Source: Gottschalk, Lin and Manocha, OBBTree: a hierarchical structure for rapid interference detection, 1996.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from executor.assets.asset_geometry import joint_transform
from executor.geometry import Array, transform
from executor.planning.cargo import HELD, Carried
from executor.sim.engine import ROBOT, ShapeBox
from executor.sim.robot.description import base_links
from executor.sim.robot.link_frames import LinkFrames
from executor.sim.world import World

TOLERANCE_M = 5e-4
"""The engine computes in single precision, and keeps contact points while bodies move a little."""

PARALLEL = 1e-4  # Of the squared sine between two edges, whose common normal rounding would decide.
ROUNDS = 6  # Of the search for the direction in which a hull is nearest.
Flags = NDArray[np.bool_]
Numbers = NDArray[np.intp]


@dataclass(frozen=True, slots=True, eq=False)
class Wanted:
    """What is to be kept from what.

    Attributes:
        of: Wanted clearance of a mover from all objects.
        itself_m: The same of the robot from itself.
        carried: What is in the gripper.
        allowed: Pairs of a mover and what it may touch.
    """

    of: Callable[[str], float]
    itself_m: float
    carried: Carried | None
    allowed: Iterable[tuple[str, str]]


class Boxes:
    """Boxes of bodies.

    Args:
        owners, links: (M,) names of the bodies' owners and links.
        poses: (M, 4, 4) their poses.
        halves_m: (M, 3) half their sides.

    Attributes:
        low_m, high_m: (M, 3) corners of the upright boxes around them.
    """

    def __init__(self, owners: NDArray[np.str_], links: NDArray[np.str_], poses: Array, halves_m: Array) -> None:
        self.owners, self.links, self.poses, self.halves_m = owners, links, poses, halves_m
        spans_m = (np.abs(poses[:, :3, :3]) @ halves_m[:, :, None])[..., 0]
        self.low_m, self.high_m = poses[:, :3, 3] - spans_m, poses[:, :3, 3] + spans_m

    def of(self, chosen: Flags) -> Boxes:
        """Return some of the boxes."""
        return Boxes(self.owners[chosen], self.links[chosen], self.poses[chosen], self.halves_m[chosen])

    def allowed_with(self, mover: str, allowed: Iterable[tuple[str, str]]) -> Flags:
        """Return (M,) whether a mover may touch each of them."""
        found = np.zeros(len(self.owners), dtype=bool)
        for name, other in allowed:
            if name == mover:
                owner, _, link = other.partition("/")
                found |= (self.owners == owner) & ((self.links == link) if link else True)
        return found


class Separation:
    """Lower bounds of the distances of a robot, and of what it carries, to everything else and to itself.

    Args:
        world: The oracle's; its shapes are those of the engine.
    """

    def __init__(self, world: World) -> None:
        self._world, robot = world, world.model
        every = world.collision_boxes()
        self._frames = LinkFrames(robot)
        self._postures: dict[Hashable, tuple[Array, Array, bool]] = {}
        mine = [(ref.link, box) for ref, box in every if ref.owner == ROBOT]
        # Fingers are small, and of many shapes.
        for link in robot.finger_links:
            around = _around([box for name, box in mine if name == link])
            mine = [*(each for each in mine if each[0] != link), (link, around)]
        self._links = tuple(link for link, _ in mine)
        self._own_poses = np.stack([box.T_body_box for _, box in mine])[:, None]
        self._own_halves_m = np.stack([box.half_m for _, box in mine])
        most = max(len(box.points_m) for _, box in mine)
        self._own_points_m = np.stack([np.resize(box.points_m, (most, 3)) for _, box in mine])
        self._stands = np.isin(self._links, list(base_links(robot)))
        self._arm = np.flatnonzero(~np.isin(self._links, list(robot.gripper_links)))
        colliding = world.self_collisions() - {frozenset(robot.finger_links)}
        first, second = np.triu_indices(len(self._links), 1)
        meets = [frozenset((self._links[i], self._links[j])) in colliding for i, j in zip(first, second, strict=True)]
        self._self_pairs = np.stack([first[meets], second[meets]])
        theirs = [(ref, box) for ref, box in every if ref.owner != ROBOT]
        self._bodies = list(dict.fromkeys(ref for ref, _ in theirs))
        self._body_of = np.array([self._bodies.index(ref) for ref, _ in theirs], dtype=int)
        self._their_poses = np.array([box.T_body_box for _, box in theirs]).reshape(-1, 4, 4)
        self._their_halves_m = np.array([box.half_m for _, box in theirs]).reshape(-1, 3)
        self._owners = np.array([ref.owner for ref, _ in theirs])
        self._link_names = np.array([ref.link for ref, _ in theirs])
        items = {ref.owner for ref, _ in theirs if ref.owner in world.dynamic_ids}
        self._item_boxes = {name: _around([box for ref, box in theirs if ref.owner == name]) for name in items}

    def boxes(self, resting: Mapping[str, Array], joints: Mapping[tuple[str, str], float]) -> Boxes:
        """Return the boxes of all objects.

        Args:
            resting: Pose (4, 4) of each object that can be moved.
            joints: Position of each joint, by object and name.
        """
        world, poses = self._world, list[Array]()
        for ref in self._bodies:
            T = resting[ref.owner] if ref.owner in resting else world.T_world_link(ref.owner)
            joint = next((each for each in world.assets[ref.owner].joints if each.child == ref.link), None)
            poses.append(T if joint is None else T @ joint_transform(joint, joints.get((ref.owner, joint.name), 0.0)))
        T_world_body = np.array(poses).reshape(-1, 4, 4)[self._body_of]
        return Boxes(self._owners, self._link_names, T_world_body @ self._their_poses, self._their_halves_m)

    def surely_free(self, path: Array, opening_m: float, around: Boxes, wanted: Wanted) -> Flags:
        """Return (N,) which configurations keep the wanted clearance from everything; others may do so all the same.

        Args:
            path: (N, Q) configurations.
            opening_m: Position of each finger.
            around: All objects; what is carried is left out.
            wanted: What is to be kept from what.
        """
        along = wanted.carried.poses if wanted.carried is not None else ()
        ids = [name for name, _ in along]
        movers = [*self._links, *(HELD for _ in ids)]
        clearances_m = np.array([wanted.of(mover) for mover in movers]) + TOLERANCE_M
        free = np.ones(len(path), dtype=bool)
        if (path[:, 3:] == path[0, 3:]).all():
            # The base alone moves in most paths, and in many after another: the rest is the same as before.
            held = tuple((name, T.tobytes()) for name, T in along)
            key = (path[0, 3:].tobytes(), opening_m, held, clearances_m.tobytes(), wanted.itself_m)
            if key not in self._postures:
                T, halves_m = self._movers(path[:1] * (np.arange(path.shape[1]) > 2), opening_m, wanted.carried)
                close = len(self._near_itself(T, halves_m, clearances_m, wanted)) > 0
                self._postures = {key: (T, halves_m, close)}
            T, halves_m, close = self._postures[key]
            if close:
                return ~free
            T = _base_poses(path) @ T
        else:
            T, halves_m = self._movers(path, opening_m, wanted.carried)
            free[self._near_itself(T, halves_m, clearances_m, wanted)] = False
            if not free.any():
                return free
        low_m = T[:, :, 2, 3] - (np.abs(T[:, :, 2, :3]) @ halves_m[:, :, None])[..., 0]
        off_floor = ~np.concatenate([self._stands, np.zeros(len(ids), dtype=bool)])
        free &= (low_m[off_floor] > clearances_m[off_floor, None]).all(axis=0)
        around = around.of(~np.isin(around.owners, ids)) if ids else around
        free[self._near_others(T, halves_m, clearances_m, around, movers, wanted.allowed)] = False
        return free

    def _movers(self, path: Array, opening_m: float, carried: Carried | None) -> tuple[Array, Array]:
        """Return the boxes of all that moves, the robot's first: (S, N, 4, 4) poses, and (S, 3) half sides."""
        T_links, T_eef = self._frames.at(path, opening_m, self._links)
        poses, halves_m = [T_links @ self._own_poses], [self._own_halves_m]
        for name, T_eef_object in carried.poses if carried is not None else ():
            box = self._item_boxes[name]
            poses.append((T_eef @ (T_eef_object @ box.T_body_box))[None])
            halves_m.append(box.half_m[None])
        return np.concatenate(poses), np.concatenate(halves_m)

    def _near_others(
        self,
        T: Array,
        halves_m: Array,
        clearances_m: Array,
        around: Boxes,
        movers: list[str],
        allowed: Iterable[tuple[str, str]],
    ) -> Numbers:
        """Return the numbers of configurations in which a mover may be too near to an object."""
        reach_m = np.linalg.norm(halves_m, axis=1) + clearances_m
        centres_m = T[:, :, :3, 3]
        low_m = (centres_m.min(axis=1) - reach_m[:, None]).min(axis=0)
        high_m = (centres_m.max(axis=1) + reach_m[:, None]).max(axis=0)
        around = around.of(((around.high_m >= low_m) & (around.low_m <= high_m)).all(axis=1))
        axes, points = around.poses[:, :3, :3], around.poses[:, :3, 3]
        local = centres_m.reshape(-1, 3) @ axes.transpose(1, 0, 2).reshape(3, -1)
        local = local.reshape(*centres_m.shape[:2], len(axes), 3) - np.einsum("mi,mij->mj", points, axes)
        beyond = np.maximum(np.abs(local) - around.halves_m, 0.0)
        near = np.einsum("snmk,snmk->snm", beyond, beyond) <= (reach_m**2)[:, None, None]
        if allowed:
            near &= ~np.stack([around.allowed_with(mover, allowed) for mover in movers])[:, None]
        s, n, m = np.nonzero(near)
        if not len(n):
            return n
        apart = _are_apart(T[s, n], halves_m[s], around.poses[m], around.halves_m[m], clearances_m[s])
        return np.asarray(n[~apart])

    def _near_itself(self, T: Array, halves_m: Array, clearances_m: Array, wanted: Wanted) -> Numbers:
        """Return the numbers of configurations in which the robot may be too near to itself or to what it carries."""
        count = len(self._links)
        held = np.arange(count, len(halves_m))
        with_held = np.stack([np.tile(self._arm, len(held)), np.repeat(held, len(self._arm))])
        first, second = np.concatenate([self._self_pairs, with_held], axis=1)
        own_m = np.full(self._self_pairs.shape[1], wanted.itself_m + TOLERANCE_M)
        least_m = np.concatenate([own_m, clearances_m[with_held[0]]])
        # A sphere about the second, the box of the first.
        offsets_m = T[second, :, :3, 3] - T[first, :, :3, 3]
        local = np.abs(np.einsum("pni,pnij->pnj", offsets_m, T[first, :, :3, :3]))
        beyond = np.maximum(local - halves_m[first, None], 0.0)
        reach_m = np.linalg.norm(halves_m[second], axis=1) + least_m
        p, n = np.nonzero(np.einsum("pnk,pnk->pn", beyond, beyond) <= (reach_m**2)[:, None])
        if not len(n):
            return n
        first, second, least_m = first[p], second[p], least_m[p]
        close = ~_are_apart(T[first, n], halves_m[first], T[second, n], halves_m[second], least_m)
        # A link may be near with a corner of its box alone, where it has none.
        own = np.flatnonzero(close & (second < len(self._links)))
        first, second = first[own], second[own]
        gaps_m = _gaps_m(T[first, n[own]], halves_m[first], T[second, n[own]], self._own_points_m[second])
        close[own] = gaps_m <= least_m[own]
        return np.asarray(n[close])


def _base_poses(path: Array) -> Array:
    """Return (N, 4, 4) poses of the base on the floor."""
    c, s = np.cos(path[:, 2]), np.sin(path[:, 2])
    T = np.tile(np.eye(4), (len(path), 1, 1))
    T[:, 0, 0], T[:, 0, 1], T[:, 1, 0], T[:, 1, 1] = c, -s, s, c
    T[:, :2, 3] = path[:, :2]
    return T


def _around(boxes: list[ShapeBox]) -> ShapeBox:
    """Return the box around some boxes of one body; a single one stays as it is."""
    if len(boxes) == 1:
        return boxes[0]
    points_m = np.concatenate([box.points_m @ box.T_body_box[:3, :3].T + box.T_body_box[:3, 3] for box in boxes])
    low_m, high_m = points_m.min(axis=0), points_m.max(axis=0)
    middle_m = (low_m + high_m) / 2
    return ShapeBox(transform(np.eye(3), middle_m), (high_m - low_m) / 2, points_m - middle_m)


def _are_apart(A: Array, a: Array, B: Array, b: Array, least_m: Array) -> Flags:
    """Return (K,) whether pairs of boxes are surely farther apart than a distance.

    Args:
        A, B: (K, 4, 4) poses.
        a, b: (K, 3) half sides.
        least_m: (K,) the distance.
    """
    turned = A[:, :3, :3].transpose(0, 2, 1) @ B[:, :3, :3]
    absolute = np.abs(turned)
    offset_m = B[:, :3, 3] - A[:, :3, 3]
    along_a = np.einsum("ki,kij->kj", offset_m, A[:, :3, :3])
    along_b = np.einsum("ki,kij->kj", offset_m, B[:, :3, :3])
    by_a = np.abs(along_a) - a - np.einsum("kij,kj->ki", absolute, b)
    by_b = np.abs(along_b) - b - np.einsum("kij,ki->kj", absolute, a)
    apart = np.maximum(by_a, by_b).max(axis=1) > least_m
    rest = np.flatnonzero(~apart)
    if len(rest):
        apart[rest] = _edges_apart(turned[rest], absolute[rest], along_a[rest], a[rest], b[rest], least_m[rest])
    return apart


def _edges_apart(turned: Array, absolute: Array, along_a: Array, a: Array, b: Array, least_m: Array) -> Flags:
    """Return (K,) whether the common normal of two edges separates boxes, given in the frame of the first ones."""
    nexts, lasts = [1, 2, 0], [2, 0, 1]
    # Normal of edges i of the first and j of the second: e_i x B_j, whose parts are those of B_j.
    reach_m = np.abs(along_a[:, lasts, None] * turned[:, nexts] - along_a[:, nexts, None] * turned[:, lasts])
    mine_m = a[:, nexts, None] * absolute[:, lasts] + a[:, lasts, None] * absolute[:, nexts]
    theirs_m = b[:, None, nexts] * absolute[:, :, lasts] + b[:, None, lasts] * absolute[:, :, nexts]
    squared = 1.0 - turned**2
    gaps_m = (reach_m - mine_m - theirs_m) / np.sqrt(np.maximum(squared, PARALLEL))
    return np.asarray((np.where(squared > PARALLEL, gaps_m, -np.inf).max(axis=(1, 2))) > least_m)


def _gaps_m(A: Array, a: Array, B: Array, points_m: Array) -> Array:
    """Return (K,) lower bounds of the distance of boxes to hulls: across their sides, and along the way between them.

    The way is followed from the hull's point that is nearest to the box to the nearest place between its points.
    Source: Gilbert, An iterative procedure for computing the minimum of a quadratic form on a convex set, 1966.

    Args:
        A, B: (K, 4, 4) poses of boxes and hulls.
        a: (K, 3) half sides of the boxes.
        points_m: (K, V, 3) the hulls' points.
    """
    turned = A[:, :3, :3].transpose(0, 2, 1) @ B[:, :3, :3]
    offset_m = np.einsum("ki,kij->kj", B[:, :3, 3] - A[:, :3, 3], A[:, :3, :3])
    local = points_m @ turned.transpose(0, 2, 1) + offset_m[:, None]
    across_m = (np.maximum(local.min(axis=1), -local.max(axis=1)) - a).max(axis=1)
    beyond = local - np.clip(local, -a[:, None], a[:, None])
    every, gaps_m = np.arange(len(a)), across_m
    at_m = local[every, np.einsum("kvi,kvi->kv", beyond, beyond).argmin(axis=1)]
    for _ in range(ROUNDS):
        off_m = at_m - np.clip(at_m, -a, a)
        towards = off_m / np.maximum(np.linalg.norm(off_m, axis=1), TOLERANCE_M)[:, None]
        along_m = (local @ towards[:, :, None])[..., 0]
        gaps_m = np.maximum(gaps_m, along_m.min(axis=1) - (np.abs(towards) * a).sum(axis=1))
        step_m = local[every, along_m.argmin(axis=1)] - at_m
        share = -(off_m * step_m).sum(axis=1) / np.maximum((step_m**2).sum(axis=1), TOLERANCE_M**2)
        at_m = at_m + np.clip(share, 0.0, 1.0)[:, None] * step_m
    return np.asarray(gaps_m)
