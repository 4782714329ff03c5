"""Makes an asset of the library from what was read, what was inferred, and what a side file says."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from scipy.spatial import ConvexHull

from executor.assets.imports.convex import visible_shapes
from executor.assets.imports.gripping import find_handle, width_of
from executor.assets.imports.hollows import find_places
from executor.assets.imports.raw import RawAsset, RawJoint, rounded
from executor.assets.imports.side_file import SideFile
from executor.assets.model import Asset, Handle, Joint, Link, Region, Shape, Vector
from executor.geometry import Array
from oag import Kind

DENSITY_KG_M3 = 500.0  # Of a furnished cupboard or a filled vessel, air included.
FRICTION = 0.8
# As doors of the library have them.
_LEVEL = 0.1  # Within six degrees; springs carry a door that hangs on such a hinge.

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
    low, high = raw.box()
    handles, said = _handles(raw, side)
    regions = _regions(raw, side, pieces, kind)
    notes = [*raw.notes, *said]
    for region in regions:
        size = " x ".join(f"{200 * half:.0f}" for half in region.half_extents_m)
        notes.append(f"{region.kind} {region.name}: {size} cm")
    width: float | None = None
    axes: tuple[Vector, ...] = ()
    if kind is Kind.ITEM:
        narrowest, axes = width_of([piece for link in pieces.values() for piece in link])
        width = round(narrowest, 5)
        notes.append(f"{'narrowest' if axes else 'round'}, {narrowest * 1000:.0f} mm between the fingers")
    if raw.joints and not any(region.kind == "interior" for region in regions):
        notes.append("no interior was found: nothing can be put inside; name one in a side file")
    asset = Asset(
        category=category,
        motion="articulated" if raw.joints else ("dynamic" if kind is Kind.ITEM else "static"),
        links=_links(raw, side, pieces),
        extent_m=rounded(high - low),
        joints=tuple(_joint(raw.links[0].name, joint) for joint in raw.joints),
        handles=handles,
        regions=regions,
        symmetric_about_z=width is not None and not axes,
        graspable_width_m=width,
        grasp_axes=axes,
        synset=side.synset or "",
    )
    return asset, tuple(notes)


def _joint(body: str, joint: RawJoint) -> Joint:
    return Joint(
        joint.name,
        joint.kind,
        body,
        joint.child,
        rounded(joint.origin_m),
        rounded(joint.axis),
        (0.0, round(joint.high, 5)),
        balanced=joint.kind == "revolute" and abs(float(joint.axis[2])) < _LEVEL,
    )


def _links(raw: RawAsset, side: SideFile, pieces: Pieces) -> tuple[Link, ...]:
    """The asset's links, each in the frame of its joint."""
    volume = sum(float(ConvexHull(piece).volume) for link in pieces.values() for piece in link)
    told = side.mass_kg or sum(link.mass_kg or 0.0 for link in raw.links)
    density = round(told / volume, 3) if told and volume > 0 else DENSITY_KG_M3
    friction = side.friction or FRICTION

    def solid(points: Array) -> Shape:
        vertices = tuple(rounded(point) for point in points)
        return Shape("convex", vertices_m=vertices, density_kg_m3=density, friction=friction, visible=False)

    links = []
    for link in raw.links:
        at = raw.origin_of(link.name)
        shapes = (*(solid(piece - at) for piece in pieces[link.name]), *visible_shapes(link.looks, at))
        links.append(Link(link.name, shapes))
    return tuple(links)


def _handles(raw: RawAsset, side: SideFile) -> tuple[tuple[Handle, ...], tuple[str, ...]]:
    if side.handles is None:
        found = [find_handle(raw, joint) for joint in raw.joints]
        return tuple(handle for handle, _ in found if handle is not None), tuple(note for _, note in found)
    child = {joint.name: joint for joint in raw.joints}
    handles = []
    for told in side.handles:
        joint = child[told.joint]
        where, axis, outward = _place(told.position_m, joint.origin_m), _unit(told.axis), _unit(told.outward)
        handles.append(Handle(joint.child, joint.name, where, axis, outward, told.length_m, told.thickness_m))
    return tuple(handles), (f"{len(handles)} handles from the side file",)


def _regions(raw: RawAsset, side: SideFile, pieces: Pieces, kind: Kind) -> tuple[Region, ...]:
    if side.places is None:
        return find_places(raw, pieces, item=kind is Kind.ITEM)
    regions = []
    for told in side.places:
        middle = _place(told.center_m, raw.origin_of(told.link))
        opening = _unit(told.opening)
        regions.append(Region(told.name, told.kind, told.link, middle, told.half_extents_m, opening, told.joint))
    return tuple(regions)


def _place(point_m: Vector, origin_m: Array) -> Vector:
    return rounded(np.asarray(point_m) - origin_m)


def _unit(vector: Vector) -> Vector:
    array = np.asarray(vector, dtype=float)
    return rounded(array / max(float(np.linalg.norm(array)), 1e-9))
