"""Makes an asset of the library from what was read, what was inferred, and what a side file says."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from executor.assets.imports.grasping import Width, width_of
from executor.assets.imports.handles import find_handle
from executor.assets.imports.places import Place, find_places
from executor.assets.imports.raw import RawAsset
from executor.assets.imports.side_file import SideFile
from executor.assets.imports.visible import visible_shapes
from executor.assets.model import Asset, Handle, Joint, Link, Region, Shape, Vector
from executor.geometry import Array
from oag import Kind

DENSITY_KG_M3 = 500.0
FRICTION = 0.8
_DOOR_FRICTION = 0.3
_DOOR_DAMPING = 2.0
_LEVEL = 0.1

Pieces = Mapping[str, Sequence[Array]]


def assemble(raw: RawAsset, pieces: Pieces, side: SideFile, category: str, kind: Kind) -> tuple[Asset, tuple[str, ...]]:
    """Returns the asset, and notes on what was inferred.

    Args:
        raw: In the library's frame, shut, at its final size, its box in the middle; with joints only where they move.
        pieces: Points (N, 3) of each link's convex pieces.
        side: What overrules inference.
        category: What it is.
        kind: How the robot deals with it.
    """
    notes = list(raw.notes)
    low, high = raw.box()
    extent = _vector(high - low)
    width = width_of([piece for link in pieces.values() for piece in link]) if kind is Kind.ITEM else None
    handles, said = _handles(raw, side)
    regions = _regions(raw, side, pieces, kind)
    notes += [*said, *_noted(regions, width)]
    if raw.joints and not any(region.kind == "interior" for region in regions):
        notes.append("no interior was found: nothing can be put inside; name one in a side file")
    return (
        Asset(
            category=category,
            motion="articulated" if raw.joints else ("dynamic" if kind is Kind.ITEM else "static"),
            links=_links(raw, side, pieces),
            extent_m=extent,
            joints=tuple(
                Joint(
                    joint.name,
                    joint.kind,
                    raw.links[0].name,
                    joint.child,
                    _vector(joint.origin_m),
                    _vector(joint.axis),
                    (0.0, round(joint.high, 5)),
                    friction=_DOOR_FRICTION,
                    damping=_DOOR_DAMPING,
                    balanced=joint.kind == "revolute" and abs(float(joint.axis[2])) < _LEVEL,
                )
                for joint in raw.joints
            ),
            handles=handles,
            regions=regions,
            symmetric_about_z=width is not None and width.is_round,
            graspable_width_m=None if width is None else round(width.narrowest_m, 5),
            grasp_axes=() if width is None else width.axes,
            synset=side.synset or "",
        ),
        tuple(notes),
    )


def _links(raw: RawAsset, side: SideFile, pieces: Pieces) -> tuple[Link, ...]:
    """The asset's links, each in the frame of its joint."""
    volume = sum(_volume(piece) for link in pieces.values() for piece in link)
    told = side.mass_kg or sum(link.mass_kg or 0.0 for link in raw.links)
    density = round(told / volume, 3) if told and volume > 0 else DENSITY_KG_M3
    origin = {joint.child: joint.origin_m for joint in raw.joints}
    links = []
    for link in raw.links:
        at = origin.get(link.name, np.zeros(3))
        solid = tuple(_solid(piece - at, density, side.friction or FRICTION) for piece in pieces[link.name])
        links.append(Link(link.name, (*solid, *visible_shapes(link.looks, at))))
    return tuple(links)


def _solid(points: Array, density: float, friction: float) -> Shape:
    return Shape(
        kind="convex",
        vertices_m=tuple(_vector(point) for point in points),
        density_kg_m3=density,
        friction=friction,
        visible=False,
    )


def _handles(raw: RawAsset, side: SideFile) -> tuple[tuple[Handle, ...], tuple[str, ...]]:
    child = {joint.name: joint for joint in raw.joints}
    if side.handles is not None:
        told = []
        for handle in side.handles:
            joint = child[handle.joint]
            where = _vector(np.asarray(handle.position_m) - joint.origin_m)
            axis, outward = _unit(handle.axis), _unit(handle.outward)
            told.append(Handle(joint.child, joint.name, where, axis, outward, handle.length_m, handle.thickness_m))
        return tuple(told), (f"{len(told)} handles from the side file",)
    handles, notes = [], []
    for joint in raw.joints:
        found, note = find_handle(raw, joint)
        notes.append(note)
        if found is not None:
            where = _vector(found.position_m - joint.origin_m)
            axis, outward = _vector(found.axis), _vector(found.outward)
            length, thickness = round(found.length_m, 5), round(found.thickness_m, 5)
            handles.append(Handle(joint.child, joint.name, where, axis, outward, length, thickness))
    return tuple(handles), tuple(notes)


def _regions(raw: RawAsset, side: SideFile, pieces: Pieces, kind: Kind) -> tuple[Region, ...]:
    origin = {joint.child: joint.origin_m for joint in raw.joints}
    if side.places is not None:
        told = []
        for p in side.places:
            middle = _vector(np.asarray(p.center_m) - origin.get(p.link, np.zeros(3)))
            told.append(Region(p.name, p.kind, p.link, middle, p.half_extents_m, _unit(p.opening), p.joint))
        return tuple(told)
    return tuple(_region(place, origin) for place in find_places(raw, pieces, item=kind is Kind.ITEM))


def _region(place: Place, origin: Mapping[str, Array]) -> Region:
    middle = (place.box.low_m + place.box.high_m) / 2 - origin.get(place.link, np.zeros(3))
    return Region(
        name=place.name,
        kind="interior" if place.interior else "surface",
        link=place.link,
        center_m=_vector(middle),
        half_extents_m=_vector(place.box.size_m / 2),
        opening=_vector(place.opening),
        joint=place.joint,
    )


def _noted(regions: Sequence[Region], width: Width | None) -> list[str]:
    notes = [
        f"{region.kind} {region.name}: {' x '.join(f'{200 * half:.0f}' for half in region.half_extents_m)} cm"
        for region in regions
    ]
    if width is not None:
        shape = "round" if width.is_round else "narrowest"
        notes.append(f"{shape}, {width.narrowest_m * 1000:.0f} mm between the fingers")
    return notes


def _volume(piece: Array) -> float:
    from scipy.spatial import ConvexHull

    return float(ConvexHull(piece).volume)


def _unit(vector: Vector) -> Vector:
    array = np.asarray(vector, dtype=float)
    return _vector(array / max(float(np.linalg.norm(array)), 1e-9))


def _vector(array: Array) -> Vector:
    x, y, z = (round(float(value), 6) for value in array)
    return (x, y, z)
