"""An asset as its files tell it, before anything is inferred: parts and joints in one frame, joints at zero."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from executor.assets.model import Vector
from executor.geometry import Array

Faces = NDArray[np.int64]
GREY = (0.62, 0.62, 0.62)
_LEFT_OUT = 0.1
"""Share of the asset that may be seen outside of what is solid."""
_NOTICED_M = 0.005  # A handle that stands out by less cannot be held anyway.


@dataclass(frozen=True, slots=True, eq=False)
class MeshPart:
    """One mesh of a link, in the asset's frame.

    Attributes:
        vertices_m: (N, 3) points.
        faces: (M, 3) indices.
        color: Linear RGB.
        is_handle: Whether its name says that it is a handle or a knob.
        source: Where it comes from, for messages.
    """

    vertices_m: Array
    faces: Faces
    color: tuple[float, ...] = GREY
    is_handle: bool = False
    source: str = ""

    def moved(self, T: Array) -> MeshPart:
        """Returns the part after a (4, 4) transform."""
        return replace(self, vertices_m=self.vertices_m @ T[:3, :3].T + T[:3, 3])

    def stretched(self, factors: Array | float) -> MeshPart:
        """Returns the part with its coordinates times three factors, or one; a mirror image keeps its outside out."""
        mirrored = float(np.prod(np.broadcast_to(factors, 3))) < 0.0
        faces = self.faces[:, ::-1].copy() if mirrored else self.faces
        return replace(self, vertices_m=self.vertices_m * factors, faces=faces)


@dataclass(frozen=True, slots=True, eq=False)
class RawLink:
    """What moves together; the first link of an asset is its body.

    Attributes:
        name: As in the file.
        looks: Meshes for cameras.
        bodies: Meshes for physics.
        mass_kg: As in the file, or None.
    """

    name: str
    looks: tuple[MeshPart, ...]
    bodies: tuple[MeshPart, ...]
    mass_kg: float | None = None

    @property
    def points_m(self) -> Array:
        """All points (N, 3) of the physical meshes."""
        return np.concatenate([part.vertices_m for part in self.bodies])

    @property
    def without_handles(self) -> tuple[MeshPart, ...]:
        """The physical meshes without those that are handles; all of them where nothing else is left."""
        return tuple(part for part in self.bodies if not part.is_handle) or self.bodies

    def through(self, change: Callable[[MeshPart], MeshPart]) -> RawLink:
        """Returns the link with every mesh changed."""
        return replace(self, looks=tuple(map(change, self.looks)), bodies=tuple(map(change, self.bodies)))


@dataclass(frozen=True, slots=True, eq=False)
class RawJoint:
    """A joint between the body and another link, in the asset's frame.

    Attributes:
        name: As in the file.
        kind: Hinge or slide.
        child: The link that it moves.
        origin_m: (3,) a point of its axis.
        axis: (3,) unit vector.
        low, high: Limits in rad or m, low < high.
        mimics: The joint that it follows by the file; empty where it follows none.
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
    """A whole asset, with what was noticed while reading it.

    Attributes:
        links: The body first.
        joints: One for every other link.
        category: What the files say that it is; empty where they say nothing.
        notes: What was left out or decided, for a person.
    """

    links: tuple[RawLink, ...]
    joints: tuple[RawJoint, ...] = ()
    category: str = ""
    notes: tuple[str, ...] = ()

    def link_of(self, joint: RawJoint) -> RawLink:
        """Returns the link that a joint moves."""
        return next(link for link in self.links if link.name == joint.child)

    def origin_of(self, link: str) -> Array:
        """Returns where the frame of a link of the finished asset is: (3,) on its joint's axis; the body's at 0."""
        return next((joint.origin_m for joint in self.joints if joint.child == link), np.zeros(3))

    def grown(self, factor: float) -> RawAsset:
        """Returns the asset with every length times a factor."""
        links = tuple(link.through(lambda part: part.stretched(factor)) for link in self.links)
        joints = tuple(
            replace(joint, origin_m=joint.origin_m * factor)
            if joint.kind == "revolute"
            else replace(joint, origin_m=joint.origin_m * factor, low=joint.low * factor, high=joint.high * factor)
            for joint in self.joints
        )
        return replace(self, links=links, joints=joints)

    def moved(self, T: Array) -> RawAsset:
        """Returns the asset after a (4, 4) rigid motion of everything."""
        links = tuple(link.through(lambda part: part.moved(T)) for link in self.links)
        joints = tuple(
            replace(joint, origin_m=T[:3, :3] @ joint.origin_m + T[:3, 3], axis=T[:3, :3] @ joint.axis)
            for joint in self.joints
        )
        return replace(self, links=links, joints=joints)

    def in_one(self) -> RawAsset:
        """Returns the asset with all links made fast to the first."""
        looks = tuple(part for link in self.links for part in link.looks)
        bodies = tuple(part for link in self.links for part in link.bodies)
        masses = [link.mass_kg for link in self.links if link.mass_kg is not None]
        body = RawLink(self.links[0].name, looks, bodies, sum(masses) if masses else None)
        return replace(self, links=(body,), joints=())

    def box(self) -> tuple[Array, Array]:
        """Returns the low and high corner (3,) of everything physical, joints as they are."""
        points = np.concatenate([link.points_m for link in self.links if link.bodies])
        return points.min(axis=0), points.max(axis=0)


def rounded(array: Array) -> Vector:
    """Returns three numbers as they are kept: to micrometres."""
    x, y, z = (round(float(value), 6) for value in array)
    return (x, y, z)


def solid_as_seen(raw: RawAsset) -> RawAsset:
    """Returns the asset with the seen meshes as its solid ones where the solid ones leave out part of what is seen.

    Many files give a table a top to collide with and legs to look at: it would float. So do handles that stand out of
    what is solid of their door: no finger would ever meet them.
    """
    raw = _handles_solid(raw)
    seen = np.concatenate([part.vertices_m for link in raw.links for part in link.looks])
    low, high = raw.box()
    missing = np.maximum(low - seen.min(axis=0), seen.max(axis=0) - high).max()
    if missing <= _LEFT_OUT * float((high - low).max()):
        return raw
    note = f"its collision shapes leave out {missing * 100:.0f} cm of what is seen; the seen meshes are solid instead"
    links = tuple(replace(link, bodies=link.looks) for link in raw.links)
    return replace(raw, links=links, notes=(*raw.notes, note))


def _handles_solid(raw: RawAsset) -> RawAsset:
    """The asset with those handles made solid that stand out of their link's solid box."""
    links, notes = [], list(raw.notes)
    for link in raw.links:
        low, high = link.points_m.min(axis=0) - _NOTICED_M, link.points_m.max(axis=0) + _NOTICED_M
        seen = tuple(p for p in link.looks if p.is_handle and ((p.vertices_m < low) | (p.vertices_m > high)).any())
        if seen:
            link = replace(link, bodies=(*link.bodies, *seen))
            notes.append(f"the handle of {link.name} has no collision shape; what is seen of it is solid")
        links.append(link)
    return replace(raw, links=tuple(links), notes=tuple(notes))
