"""Import an asset from a URDF, a PartNet-Mobility folder or a mesh, and store it for scenes.

The asset is assembled from the files' content, from inferred affordances, and from the side file.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.spatial import ConvexHull

from bddl import near_names
from executor.assets.importers.affordances import find_handle, find_places, width_of
from executor.assets.importers.convex import convex_pieces, visible_shapes
from executor.assets.importers.files import (
    CATEGORY,
    FORMATS,
    AssetFolder,
    ImportRefused,
    SideFile,
    read_mesh,
    read_side_file,
    up_axis,
)
from executor.assets.importers.raw import (
    RawAsset,
    RawJoint,
    RawLink,
    close_joints,
    complete_collision_meshes,
    fix_joints,
    repair_joints,
    rotate_z_up,
    rounded,
    turn_front_to_minus_x,
)
from executor.assets.importers.store import NAME, Imported, keep
from executor.assets.importers.urdf import PARTNET_FILE, read_partnet, read_urdf
from executor.assets.model import Asset, Handle, Joint, Link, Region, Shape, Vector
from executor.geometry import Array, transform
from executor.system.progress import OnProgress, ignore_progress
from oag.model.symbols import Kind, kind_of

DENSITY_KG_M3 = 500.0  # Of a furnished cupboard or a filled vessel, air included.
FRICTION = 0.8
# As doors of the library have them.
_LEVEL = 0.1  # Within six degrees; springs carry a door that hangs on such a hinge.

Pieces = Mapping[str, Sequence[Array]]


def assemble(raw: RawAsset, pieces: Pieces, side: SideFile, category: str, kind: Kind) -> tuple[Asset, tuple[str, ...]]:
    """Return the asset, and notes on inferences.

    Args:
        raw: In the library's frame, shut, at its final size, centred on its box; with joints only where they move.
        pieces: Points (N, 3) of each link's convex pieces.
    """
    low, high = raw.box()
    handles, handle_notes = _handles(raw, side)
    regions = _regions(raw, side, pieces, kind)
    notes = [*raw.notes, *handle_notes]
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
    volume = sum(float(ConvexHull(piece).volume) for link in pieces.values() for piece in link)
    known_mass_kg = side.mass_kg or sum(link.mass_kg or 0.0 for link in raw.links)
    density = round(known_mass_kg / volume, 3) if known_mass_kg and volume > 0 else DENSITY_KG_M3
    friction = side.friction or FRICTION

    def solid(points: Array) -> Shape:
        vertices = tuple(rounded(point) for point in points)
        return Shape("convex", vertices_m=vertices, density_kg_m3=density, friction=friction, visible=False)

    links = []
    for link in raw.links:
        at = raw.origin_of(link.name)
        shapes = (*(solid(piece - at) for piece in pieces[link.name]), *visible_shapes(link.visual_meshes, at))
        links.append(Link(link.name, shapes))
    return tuple(links)


def _handles(raw: RawAsset, side: SideFile) -> tuple[tuple[Handle, ...], tuple[str, ...]]:
    if side.handles is None:
        found = [find_handle(raw, joint) for joint in raw.joints]
        return tuple(handle for handle, _ in found if handle is not None), tuple(note for _, note in found)
    child = {joint.name: joint for joint in raw.joints}
    handles = []
    for given in side.handles:
        joint = child[given.joint]
        where, axis, outward = _place(given.position_m, joint.origin_m), _unit(given.axis), _unit(given.outward)
        handles.append(Handle(joint.child, joint.name, where, axis, outward, given.length_m, given.thickness_m))
    return tuple(handles), (f"{len(handles)} handles from the side file",)


def _regions(raw: RawAsset, side: SideFile, pieces: Pieces, kind: Kind) -> tuple[Region, ...]:
    if side.places is None:
        return find_places(raw, pieces, item=kind is Kind.ITEM)
    regions = []
    for given in side.places:
        middle = _place(given.center_m, raw.origin_of(given.link))
        opening = _unit(given.opening)
        regions.append(Region(given.name, given.kind, given.link, middle, given.half_extents_m, opening, given.joint))
    return tuple(regions)


def _place(point_m: Vector, origin_m: Array) -> Vector:
    return rounded(np.asarray(point_m) - origin_m)


def _unit(vector: Vector) -> Vector:
    array = np.asarray(vector, dtype=float)
    return rounded(array / max(float(np.linalg.norm(array)), 1e-9))


SIDE_NAME = "affordances.json"
SMALLEST_M, LARGEST_M = 0.01, 4.0  # What a room holds; other sizes come of other units.
WIDEST = {"revolute": 2 * np.pi, "prismatic": LARGEST_M}
UNIT = {"revolute": "rad", "prismatic": "m"}
MOST_PIECES = 1000
"""Solid pieces of one asset; with more, a second of physics takes minutes."""


def import_asset(
    source: Path,
    name: str | None = None,
    *,
    category: str | None = None,
    height_m: float | None = None,
    side_file: Path | None = None,
    on_progress: OnProgress = ignore_progress,
) -> Imported:
    """Read an asset, infer its affordances, store it, and return it.

    Args:
        source: A `.urdf` file, a PartNet-Mobility folder, or a mesh.
        name: Its name for scenes; by default the source's.
        category: Its category, such as "cabinet"; by default that of the files, else a known word in the name.
        height_m: Its height when upright; by default lengths in the files are metres.
        side_file: Overrules inference; by default `affordances.json` beside the source, if it exists.
        on_progress: Receives the number of decomposed meshes and their total; each may take seconds.

    Raises:
        ImportRefused: The files cannot be used; the message has a remedy.
    """
    chosen = name or _as_name(source)
    _check_arguments(source, chosen, category, height_m)
    adjacent_file = (source if source.is_dir() else source.parent) / SIDE_NAME
    side = read_side_file(side_file or (adjacent_file if adjacent_file.is_file() else None))
    raw = close_joints(complete_collision_meshes(_read(source, side)))
    raw = _sized(source, raw, side.height_m if height_m is None else height_m)
    what = category or side.category or raw.category or chosen
    low, high = raw.box()
    kind = kind_of(what, float((high - low)[:2].min()))
    if kind is Kind.ARTICULATED:
        raw = repair_joints(raw)
    _check_joints(source, raw)
    raw = turn_front_to_minus_x(raw, side.front)
    if raw.joints and kind is not Kind.ARTICULATED:
        joints = [joint.name for joint in raw.joints]
        note = f"a {what} is {kind.value}: its joints ({', '.join(joints)}) were made fast"
        raw = replace(fix_joints(raw, joints), notes=(*raw.notes, note))
    _check_side(side_file or adjacent_file, side, raw, kind)
    pieces, flat = _pieces(source, raw, on_progress)
    asset, found = assemble(raw, pieces, side, what, kind)
    notes = list(found)
    if kind is Kind.ARTICULATED and not asset.joints:
        notes.append(f"a {what} usually opens, and this one has no joint; it is a support with its tops and hollows")
    if flat:
        notes.append(f"{flat} of its meshes are flat, and not solid; give them a thickness if things rest on them")
    return keep(chosen, asset, kind, source.name, tuple(notes))


def _check_arguments(source: Path, name: str, category: str | None, height_m: float | None) -> None:
    if not source.exists():
        raise ImportRefused(source, "no such file or folder", "give a .urdf, a PartNet-Mobility folder or a mesh")
    if not NAME.fullmatch(name):
        raise ImportRefused(source, f"{name!r} is no name", "use up to 40 of a-z, 0-9 and _, a letter first")
    if category is not None and not CATEGORY.fullmatch(category):
        raise ImportRefused(source, f"{category!r} is no category", "use letters, digits and _, a letter first")
    if height_m is not None and not SMALLEST_M <= height_m <= LARGEST_M:
        raise ImportRefused(source, f"cannot be {height_m:g} m high", f"give {SMALLEST_M:g} to {LARGEST_M:g} m")


def _check_joints(source: Path, raw: RawAsset) -> None:
    for joint in raw.joints:
        if joint.high > WIDEST[joint.kind]:
            problem = f"joint {joint.name} opens by {joint.high:g}"
            hint = f"at most {WIDEST[joint.kind]:.3g} {UNIT[joint.kind]} make sense"
            if joint.kind == "revolute" and joint.high <= 360.0:
                hint += f"; {joint.high:g} degrees are {np.deg2rad(joint.high):.3g} rad"
            raise ImportRefused(source, problem, hint)


def _as_name(source: Path) -> str:
    words = re.sub(r"[^a-z0-9]+", "_", source.resolve().stem.lower()).strip("_")
    return (words if words[:1].isalpha() else f"asset_{words}")[:40]


def _read(source: Path, side: SideFile) -> RawAsset:
    if source.is_dir():
        if not (source / PARTNET_FILE).is_file():
            raise ImportRefused(source, f"is a folder without {PARTNET_FILE}", "give the file itself")
        return read_partnet(source)
    ending = source.suffix.lower()
    if ending == ".urdf":
        return rotate_z_up(read_urdf(source), side.up or "z")
    if ending in FORMATS:
        up = side.up or up_axis(source)
        parts = read_mesh(AssetFolder.of(source), source)
        return rotate_z_up(RawAsset((RawLink("body", parts, parts),)), up)
    legal = ", ".join((".urdf", *FORMATS))
    raise ImportRefused(source, f"is of no known kind ({ending or 'no ending'})", f"expected {legal}, or a folder")


def _sized(source: Path, raw: RawAsset, height_m: float | None) -> RawAsset:
    """Return the asset at its final size, with the middle of its box at the origin."""
    low, high = raw.box()
    if height_m is not None:
        if high[2] - low[2] < 1e-9:
            raise ImportRefused(source, "is flat, so that its height says nothing", "leave the height out")
        raw = raw.scaled(height_m / float(high[2] - low[2]))
        low, high = raw.box()
    size = high - low
    if not (SMALLEST_M <= float(size.max()) <= LARGEST_M):
        size_text = " x ".join(f"{value:.3g}" for value in size)
        raise ImportRefused(source, f"would be {size_text} m large", "give its height in metres (--height-m)")
    return raw.moved(transform(np.eye(3), -(low + high) / 2))


def _check_side(file: Path, side: SideFile, raw: RawAsset, kind: Kind) -> None:
    """Refuse a side file that names joints or links which the asset does not have."""
    joints, links = [j.name for j in raw.joints], [link.name for link in raw.links]
    references = [("joint", h.joint, joints) for h in side.handles or ()]
    for place in side.places or ():
        references += [("link", place.link, links), *([("joint", place.joint, joints)] if place.joint else [])]
    for what, name, known in references:
        if name not in known:
            near = near_names(name, known)
            none = "none" if kind is Kind.ARTICULATED else f"none, since its category makes it {kind.value}"
            hint = f"did you mean {' or '.join(near)}?" if near else f"it has {', '.join(known) or none}"
            raise ImportRefused(file, f"names a {what} {name!r} that the asset does not have", hint)


def _pieces(source: Path, raw: RawAsset, on_progress: OnProgress) -> tuple[dict[str, tuple[Array, ...]], int]:
    """Return the points (N, 3) of every link's convex pieces, and the number of flat meshes."""
    count, done, flat = sum(len(link.collision_meshes) for link in raw.links), 0, 0
    pieces: dict[str, tuple[Array, ...]] = {}
    for link in raw.links:
        pieces[link.name] = ()
        for part in link.collision_meshes:
            on_progress(done, count)
            found = convex_pieces(part)
            pieces[link.name] += found
            flat += not found
            done += 1
            if sum(map(len, pieces.values())) > MOST_PIECES:
                hint = "give it collision meshes of few parts, or simplify it"
                raise ImportRefused(source, f"falls into more than {MOST_PIECES} solid pieces", hint)
        if not pieces[link.name]:
            hint = "give it a closed mesh, or a box as its collision"
            raise ImportRefused(source, f"{link.name} has no volume", hint)
    on_progress(done, count)
    return pieces, flat
