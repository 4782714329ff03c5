"""Raw assets: parts and joints as read from files, and their conversion to the library's convention.

Parts and joints are in one frame, with joints at zero. Conversion closes all joints at position 0, lets positive motion
open them, turns the front to -x and z up.

Implausible joints are repaired: those with hardly any range, knobs, doors that open into the body, and mimicking
joints. Every joint counts as a door or a drawer, so implausible ones are fixed. A joint that opens into the body is
reversed where the other direction is free. A note names each change.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from executor.assets.model import LEAST_TRAVEL, Vector
from executor.geometry import Array, rotation_z, transform

Faces = NDArray[np.int64]
GREY = (0.62, 0.62, 0.62)
_MOST_UNCOVERED = 0.1
"""Largest share of the asset's size that its collision meshes may leave out."""
_NOTICED_M = 0.005  # A handle that protrudes by less cannot be held anyway.


@dataclass(frozen=True, slots=True, eq=False)
class AssetMesh:
    """One mesh of a link, in the asset's frame.

    Attributes:
        vertices_m: (N, 3) points.
        faces: (M, 3) indices.
        color: Linear RGB.
        source: Its origin, for messages.
    """

    vertices_m: Array
    faces: Faces
    color: tuple[float, ...] = GREY
    is_handle: bool = False
    source: str = ""

    def moved(self, T: Array) -> AssetMesh:
        """Return the mesh after a (4, 4) transform."""
        return replace(self, vertices_m=self.vertices_m @ T[:3, :3].T + T[:3, 3])

    def stretched(self, factors: Array | float) -> AssetMesh:
        """Return the mesh scaled by one factor or three; the faces of a mirror image still point outwards."""
        mirrored = float(np.prod(np.broadcast_to(factors, 3))) < 0.0
        faces = self.faces[:, ::-1].copy() if mirrored else self.faces
        return replace(self, vertices_m=self.vertices_m * factors, faces=faces)


@dataclass(frozen=True, slots=True, eq=False)
class RawLink:
    """A rigid part; the first link of an asset is its body.

    Attributes:
        mass_kg: As in the file, or None.
    """

    name: str
    visual_meshes: tuple[AssetMesh, ...]
    collision_meshes: tuple[AssetMesh, ...]
    mass_kg: float | None = None

    @property
    def points_m(self) -> Array:
        """All points (N, 3) of the physical meshes."""
        return np.concatenate([part.vertices_m for part in self.collision_meshes])

    @property
    def without_handles(self) -> tuple[AssetMesh, ...]:
        """The collision meshes without handles; all of them if nothing else is left."""
        return tuple(part for part in self.collision_meshes if not part.is_handle) or self.collision_meshes

    def map_meshes(self, change: Callable[[AssetMesh], AssetMesh]) -> RawLink:
        """Return the link with a function applied to every mesh."""
        return replace(
            self,
            visual_meshes=tuple(map(change, self.visual_meshes)),
            collision_meshes=tuple(map(change, self.collision_meshes)),
        )


@dataclass(frozen=True, slots=True, eq=False)
class RawJoint:
    """A joint between the body and another link, in the asset's frame.

    Attributes:
        origin_m: (3,) a point of its axis.
        axis: (3,) unit vector.
        low, high: Limits [rad] or [m], low < high.
        mimics: The joint that it follows by the file; empty for an independent joint.
    """

    name: str
    kind: Literal["revolute", "prismatic"]
    child: str
    origin_m: Array
    axis: Array
    low: float
    high: float
    mimics: str = ""


@dataclass(frozen=True, slots=True, eq=False)
class RawAsset:
    """A whole asset, with notes from reading it.

    Attributes:
        links: The body first.
        joints: One for every other link.
        category: Category by the files; empty if they give none.
        notes: Omissions and decisions, for a person.
    """

    links: tuple[RawLink, ...]
    joints: tuple[RawJoint, ...] = ()
    category: str = ""
    notes: tuple[str, ...] = ()

    def link_of(self, joint: RawJoint) -> RawLink:
        """Return the link that a joint moves."""
        return next(link for link in self.links if link.name == joint.child)

    def origin_of(self, link: str) -> Array:
        """Return the origin of a finished link's frame: (3,) on its joint's axis, 0 for the body."""
        return next((joint.origin_m for joint in self.joints if joint.child == link), np.zeros(3))

    def scaled(self, factor: float) -> RawAsset:
        """Return the asset scaled by a factor."""
        links = tuple(link.map_meshes(lambda part: part.stretched(factor)) for link in self.links)
        joints = tuple(
            replace(joint, origin_m=joint.origin_m * factor)
            if joint.kind == "revolute"
            else replace(joint, origin_m=joint.origin_m * factor, low=joint.low * factor, high=joint.high * factor)
            for joint in self.joints
        )
        return replace(self, links=links, joints=joints)

    def moved(self, T: Array) -> RawAsset:
        """Return the asset after a (4, 4) rigid motion."""
        links = tuple(link.map_meshes(lambda part: part.moved(T)) for link in self.links)
        joints = tuple(
            replace(joint, origin_m=T[:3, :3] @ joint.origin_m + T[:3, 3], axis=T[:3, :3] @ joint.axis)
            for joint in self.joints
        )
        return replace(self, links=links, joints=joints)

    def box(self) -> tuple[Array, Array]:
        """Return the low and high corner (3,) of all collision meshes, joints as they are."""
        points = np.concatenate([link.points_m for link in self.links if link.collision_meshes])
        return points.min(axis=0), points.max(axis=0)


def rounded(array: Array) -> Vector:
    """Return three numbers rounded to micrometres, as they are stored."""
    x, y, z = (round(float(value), 6) for value in array)
    return (x, y, z)


def complete_collision_meshes(raw: RawAsset) -> RawAsset:
    """Replace collision meshes by visual meshes where the collision meshes leave out part of the asset.

    Many files give a table a top to collide with and legs for cameras only: it would float. Handles that protrude from
    their door's collision meshes become solid, too, since fingers could never touch them otherwise.
    """
    raw = _complete_handles(raw)
    visible_points = np.concatenate([part.vertices_m for link in raw.links for part in link.visual_meshes])
    low, high = raw.box()
    missing = np.maximum(low - visible_points.min(axis=0), visible_points.max(axis=0) - high).max()
    if missing <= _MOST_UNCOVERED * float((high - low).max()):
        return raw
    note = f"its collision shapes leave out {missing * 100:.0f} cm of what is seen; the seen meshes are solid instead"
    links = tuple(replace(link, collision_meshes=link.visual_meshes) for link in raw.links)
    return replace(raw, links=links, notes=(*raw.notes, note))


def _complete_handles(raw: RawAsset) -> RawAsset:
    """Make those handles solid that protrude from their link's collision box."""
    links, notes = [], list(raw.notes)
    for link in raw.links:
        low, high = link.points_m.min(axis=0) - _NOTICED_M, link.points_m.max(axis=0) + _NOTICED_M
        protruding = tuple(
            p for p in link.visual_meshes if p.is_handle and ((p.vertices_m < low) | (p.vertices_m > high)).any()
        )
        if protruding:
            link = replace(link, collision_meshes=(*link.collision_meshes, *protruding))
            notes.append(f"the handle of {link.name} has no collision shape; what is seen of it is solid")
        links.append(link)
    return replace(raw, links=tuple(links), notes=tuple(notes))


_FRONTS = {"-x": np.pi * 0.0, "+x": np.pi, "-y": -np.pi / 2, "+y": np.pi / 2}
"""Side that the front faces -> turn about z that makes it face -x [rad]."""

_PANEL, _SLIDING = 0.5, 0.15  # Thickness of a door, as a share of its next longer side.
_AT_FACE = 0.7  # Share of the distance from the middle of the body to its face.


def rotate_z_up(raw: RawAsset, up: str) -> RawAsset:
    """Return the asset with z up.

    Args:
        up: "z", or "y" as in glTF.
    """
    if up == "z":
        return raw
    return raw.moved(transform(Rotation.from_euler("x", 90, degrees=True).as_matrix(), [0.0, 0.0, 0.0]))


def close_joints(raw: RawAsset) -> RawAsset:
    """Return the asset with every joint shut at 0 and opening in the positive direction.

    A joint is shut at zero if its limits include it, else at the limit nearest to zero; it opens towards the farther
    limit. A door that opens in both directions opens out of the body, if its range that way suffices.
    """
    notes = list(raw.notes)
    links = {link.name: link for link in raw.links}
    joints = []
    for joint in raw.joints:
        at = min(max(0.0, joint.low), joint.high)
        forwards = joint.high - at >= at - joint.low
        if joint.low < at < joint.high:
            direction = "the longer way"
            shorter = min(joint.high - at, at - joint.low)
            if shorter >= LEAST_TRAVEL[joint.kind] and _opens_inwards(raw, joint, forwards):
                forwards, direction = not forwards, "out of the body"
            notes.append(f"joint {joint.name} goes both ways from zero; shut is zero, and it opens {direction}")
        links[joint.child] = links[joint.child].map_meshes(partial(AssetMesh.moved, T=_motion(joint, at)))
        travel = joint.high - at if forwards else at - joint.low
        joints.append(replace(joint, axis=joint.axis if forwards else -joint.axis, low=0.0, high=travel))
    return replace(raw, links=tuple(links.values()), joints=tuple(joints), notes=tuple(notes))


def _opens_inwards(raw: RawAsset, joint: RawJoint, forwards: bool) -> bool:
    if joint.kind == "prismatic" or not is_panel(raw.link_of(joint)):
        return False
    return float(opening_of(raw, joint) @ outward_of(raw, joint)) * (1.0 if forwards else -1.0) < 0.0


def _motion(joint: RawJoint, position: float) -> Array:
    if joint.kind == "prismatic":
        return transform(np.eye(3), position * joint.axis)
    turn = Rotation.from_rotvec(position * joint.axis).as_matrix()
    return transform(turn, joint.origin_m - turn @ joint.origin_m)


def turn_front_to_minus_x(raw: RawAsset, front: str | None) -> RawAsset:
    """Return the asset turned about z so that its front faces -x.

    Args:
        raw: A shut asset.
        front: "-x", "+x", "-y" or "+y". None chooses the side that most of its doors and drawers face, or -x without
            any.
    """
    side = front or _front_of(raw)
    if side == "-x":
        return raw
    turned = raw.moved(transform(rotation_z(_FRONTS[side]), [0.0, 0.0, 0.0]))
    if front is None:
        turned = replace(turned, notes=(*turned.notes, f"its front faces {side}; it was turned to -x"))
    return turned


def _front_of(raw: RawAsset) -> str:
    towards = np.zeros(3)
    for joint in raw.joints:
        towards += outward_of(raw, joint)
    if not towards[:2].any():
        # Lids alone: the front is where they come up, away from their hinges.
        towards = np.zeros(3)
        for joint in raw.joints:
            if joint.kind == "revolute":
                points = raw.link_of(joint).points_m
                across = (points.min(axis=0) + points.max(axis=0)) / 2 - joint.origin_m
                towards += across - float(across @ joint.axis) * joint.axis
    axis = int(np.argmax(np.abs(towards[:2])))
    if abs(float(towards[axis])) < 1e-6:
        return "-x"
    return f"{'+' if towards[axis] > 0 else '-'}{'xy'[axis]}"


def outward_of(raw: RawAsset, joint: RawJoint) -> Array:
    """Return the unit vector (3,) that a door's or drawer's front faces, along one of the asset's axes.

    A drawer faces its sliding direction. A door, also a sliding door, faces across its thinnest side, away from the
    middle of the body.
    """
    if joint.kind == "prismatic" and not slides_sideways(raw, joint):
        axis = int(np.argmax(np.abs(joint.axis)))
        return unit(axis, float(joint.axis[axis]))
    low, high = _box_of(raw.link_of(joint))
    axis = int(np.argmin(high - low))
    return unit(axis, float(((low + high) / 2 - _middle_of(raw))[axis]))


def opening_of(raw: RawAsset, joint: RawJoint) -> Array:
    """Return the unit vector (3,) of the first motion of a hinged door's centre when it opens."""
    low, high = _box_of(raw.link_of(joint))
    direction = np.cross(joint.axis, (low + high) / 2 - joint.origin_m)
    return np.asarray(direction / max(float(np.linalg.norm(direction)), 1e-9))


def is_panel(link: RawLink) -> bool:
    """Return whether a part is much thinner in one direction than in the others, as a door is."""
    low, high = _box_of(link)
    thin, middle, _ = sorted(high - low)
    return bool(thin < _PANEL * middle)


def slides_sideways(raw: RawAsset, joint: RawJoint) -> bool:
    """Return whether a joint slides an upright panel along itself, at the face of the body: a sliding door.

    An upright part in the body, such as a pull-out beside an oven, is thicker; a keyboard's tray lies flat.
    """
    if joint.kind != "prismatic":
        return False
    low, high = _box_of(raw.link_of(joint))
    across = int(np.argmin(high - low))
    thin, middle, _ = sorted(high - low)
    body = raw.links[0].points_m
    half_m = float(np.ptp(body[:, across])) / 2
    at_face = abs(float(((low + high) / 2 - _middle_of(raw))[across])) > _AT_FACE * half_m
    along = int(np.argmax(np.abs(joint.axis)))
    return bool(thin < _SLIDING * middle and across != 2 and along != across and at_face)


def _box_of(link: RawLink) -> tuple[Array, Array]:
    """The corners (3,) of the box around all of a door but its handles.

    The largest part of a framed door may be a bar that is thin in two directions.
    """
    points = np.concatenate([part.vertices_m for part in link.without_handles])
    return points.min(axis=0), points.max(axis=0)


def _middle_of(raw: RawAsset) -> Array:
    body = raw.links[0].points_m
    return np.asarray((body.min(axis=0) + body.max(axis=0)) / 2)


def unit(axis: int, sign: float) -> Array:
    """Return the unit vector (3,) along an axis (0, 1 or 2), or against it where the sign is negative."""
    vector = np.zeros(3)
    vector[axis] = 1.0 if sign >= 0 else -1.0
    return vector


WIDE_RAD = np.deg2rad(60.0)
"""Least opening of a door that lets a hand in."""

_MIDDLE = 0.12
"""An axis within this share of a part's span from its middle goes through the middle."""
_OUTWARDS = 0.5  # Cosine between the first motion of a door's centre and the direction that its front faces.
_NEAR_M = 0.01
_RAYS, _INSET = 5, 0.1
_BLOCKED = 0.5  # Share of the front that is blocked.


def repair_joints(raw: RawAsset) -> RawAsset:
    """Return the asset with plausible joints of doors or drawers only; the others are fixed.

    Args:
        raw: A shut asset at its final size.
    """
    notes, joints, fast = list(raw.notes), [], []
    for joint in raw.joints:
        message, back = _joint_fault(raw, joint), replace(joint, axis=-joint.axis)
        if message:
            message += "; it was made fast"
            fast.append(joint.name)
        elif (inwards := _inward_fault(raw, joint)) and _inward_fault(raw, back):
            message = f"{inwards}, and there is no other way; it was made fast"
            fast.append(joint.name)
        elif inwards:
            message = f"{inwards}: its sign was turned, so that it opens outwards"
            joint = back
        elif joint.kind == "revolute" and joint.high < WIDE_RAD:
            message = f"opens by {np.rad2deg(joint.high):.0f} degrees only"
        notes += [f"warning: joint {joint.name} {message}"] if message else []
        joints.append(joint)
    return replace(fix_joints(replace(raw, joints=tuple(joints)), fast), notes=(*notes, *_top_heavy(raw)))


def _top_heavy(raw: RawAsset) -> Iterator[str]:
    """Yield parts that are heavier than the body that carries them: a mistake that the spread by volume ignores."""
    body, *others = raw.links
    for link in others:
        if body.mass_kg and link.mass_kg and link.mass_kg > body.mass_kg:
            weights = f"{link.mass_kg:g} kg, its body {body.mass_kg:g} kg"
            yield f"warning: {link.name} weighs {weights}; here their sum is spread by volume"


def fix_joints(raw: RawAsset, names: Sequence[str]) -> RawAsset:
    """Return the asset with the links of some joints merged into its body."""
    welded = {joint.child for joint in raw.joints if joint.name in names}
    joined = [raw.links[0], *(link for link in raw.links if link.name in welded)]
    masses = [link.mass_kg for link in joined if link.mass_kg is not None]
    body = RawLink(
        raw.links[0].name,
        tuple(part for link in joined for part in link.visual_meshes),
        tuple(part for link in joined for part in link.collision_meshes),
        sum(masses) if masses else None,
    )
    links = (body, *(link for link in raw.links[1:] if link.name not in welded))
    return replace(raw, links=links, joints=tuple(joint for joint in raw.joints if joint.name not in names))


def _joint_fault(raw: RawAsset, joint: RawJoint) -> str:
    """Return why a joint is neither a door's nor a drawer's, as a predicate of its name; empty where it may be."""
    if joint.mimics:
        return f"follows {joint.mimics} (mimic), and here nothing moves by itself"
    if joint.kind == "revolute" and _turns_about_its_middle(raw.link_of(joint), joint):
        return f"turns {joint.child} about its own middle: a knob, no door"
    if joint.high < LEAST_TRAVEL[joint.kind]:
        return f"moves by {_travel(joint)} only"
    if joint.kind == "revolute" and is_panel(raw.link_of(joint)) and abs(_opening(raw, joint)) < _OUTWARDS:
        return f"turns {joint.child} in its own plane, which opens nothing; its axis may be wrong"
    return ""


def _inward_fault(raw: RawAsset, joint: RawJoint) -> str:
    """Return how a joint moves a door or a drawer into the body; empty where it does not."""
    if joint.kind == "prismatic":
        return _obstructed(raw, joint)
    inwards = is_panel(raw.link_of(joint)) and _opening(raw, joint) < -_OUTWARDS
    return f"swings {joint.child} into the body" if inwards else ""


def _opening(raw: RawAsset, joint: RawJoint) -> float:
    """Return the cosine between the first motion of a door's centre and the direction that its front faces."""
    return float(opening_of(raw, joint) @ outward_of(raw, joint))


def _travel(joint: RawJoint) -> str:
    return f"{np.rad2deg(joint.high):.1f} degrees" if joint.kind == "revolute" else f"{1000 * joint.high:.0f} mm"


def _turns_about_its_middle(link: RawLink, joint: RawJoint) -> bool:
    points = np.concatenate([part.vertices_m for part in link.without_handles])
    low, high = points.min(axis=0), points.max(axis=0)
    lever = (low + high) / 2 - joint.origin_m
    across = lever - float(lever @ joint.axis) * joint.axis
    spread = points - np.outer(points @ joint.axis, joint.axis)
    span_m = float(np.linalg.norm(np.ptp(spread, axis=0)))
    return float(np.linalg.norm(across)) < _MIDDLE * span_m


def _obstructed(raw: RawAsset, joint: RawJoint) -> str:
    """Return how a drawer slides into the body: the body blocks most of its leading face; empty where it does not."""
    points, axis = raw.link_of(joint).points_m, joint.axis
    side, up = np.linalg.svd(axis[None])[2][1:]
    reach = points @ np.stack([side, up, axis], axis=1)
    low, high = reach.min(axis=0), reach.max(axis=0)
    shares = np.linspace(_INSET, 1.0 - _INSET, _RAYS)
    starts = [
        (low[0] + a * (high[0] - low[0])) * side + (low[1] + b * (high[1] - low[1])) * up + high[2] * axis
        for a in shares
        for b in shares
    ]
    triangles = np.concatenate([part.vertices_m[part.faces] for part in raw.links[0].collision_meshes])
    free_lengths_m = np.array([_free_length_m(triangles, start, axis) for start in starts])
    met = free_lengths_m < joint.high - _NEAR_M
    if float(met.mean()) < _BLOCKED:
        return ""
    after = f"after {1000 * max(0.0, float(np.median(free_lengths_m[met]))):.0f} of {1000 * joint.high:.0f} mm"
    return f"slides {joint.child} into the body {after}"


def _free_length_m(triangles: Array, start: Array, axis: Array) -> float:
    """Return the length of a ray before it hits one of the triangles (N, 3, 3).

    Source: Moeller and Trumbore, Fast, minimum storage ray-triangle intersection (1997).
    """
    a, ab, ac = triangles[:, 0], triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    across = np.cross(axis, ac)
    scale = np.einsum("ij,ij->i", ab, across)
    hit = np.abs(scale) > 1e-12
    a, ab, ac, across, scale = a[hit], ab[hit], ac[hit], across[hit], scale[hit]
    off = start - a
    u = np.einsum("ij,ij->i", off, across) / scale
    turned = np.cross(off, ab)
    v = turned @ axis / scale
    distance_m = np.einsum("ij,ij->i", ac, turned) / scale
    met = distance_m[(u >= 0.0) & (v >= 0.0) & (u + v <= 1.0) & (distance_m > -1e-4)]
    return float(met.min(initial=np.inf))
