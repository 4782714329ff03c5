"""From somebody's files to an asset that scenes can name: a URDF, a PartNet-Mobility folder, or a mesh."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from bddl import near_names
from executor.assets.imports.assemble import assemble
from executor.assets.imports.asset_folder import AssetFolder, ImportRefused
from executor.assets.imports.convex import convex_pieces
from executor.assets.imports.meant import as_meant
from executor.assets.imports.mesh_files import FORMATS, read_mesh, up_axis
from executor.assets.imports.orient import facing_minus_x, shut, upright
from executor.assets.imports.raw import RawAsset, RawLink, solid_as_seen
from executor.assets.imports.side_file import CATEGORY, SideFile, read_side_file
from executor.assets.imports.stored import NAME, Imported, keep
from executor.assets.imports.urdf import PARTNET_FILE, read_partnet, read_urdf
from executor.geometry import Array, transform
from oag import Kind, kind_of

Listener = Callable[[int, int], None]
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
    listen: Listener = lambda done, count: None,
) -> Imported:
    """Reads an asset, infers what a robot can do with it, keeps it, and returns it.

    Args:
        source: A `.urdf` file, a PartNet-Mobility folder, or a mesh.
        name: Its name, for scenes; by default the source's.
        category: What it is, such as "cabinet"; by default what the files say, else a known word in the name.
        height_m: Its height when upright; by default lengths in the files are metres.
        side_file: What overrules inference; by default `affordances.json` beside the source, where there is one.
        listen: Told how many meshes of how many are split into convex pieces, which may take seconds for each.

    Raises:
        ImportRefused: The files cannot be used; the message says what to do.
        MissingExtra: A library is not installed.
        OSError: The asset cannot be kept.
    """
    if not source.exists():
        raise ImportRefused(source, "no such file or folder", "give a .urdf, a PartNet-Mobility folder or a mesh")
    chosen = name or _as_name(source)
    if not NAME.fullmatch(chosen):
        raise ImportRefused(source, f"{chosen!r} is no name", "use up to 40 of a-z, 0-9 and _, a letter first")
    beside = (source if source.is_dir() else source.parent) / SIDE_NAME
    if category is not None and not CATEGORY.fullmatch(category):
        raise ImportRefused(source, f"{category!r} is no category", "use letters, digits and _, a letter first")
    if height_m is not None and not SMALLEST_M <= height_m <= LARGEST_M:
        raise ImportRefused(source, f"cannot be {height_m:g} m high", f"give {SMALLEST_M:g} to {LARGEST_M:g} m")
    side = read_side_file(side_file or (beside if beside.is_file() else None))
    raw = shut(solid_as_seen(_read(source, side)))
    raw = _sized(source, raw, side.height_m if height_m is None else height_m)
    what = category or side.category or raw.category or chosen
    low, high = raw.box()
    kind = kind_of(what, float((high - low)[:2].min()))
    if kind is Kind.ARTICULATED:
        raw = as_meant(raw)
    for joint in raw.joints:
        if joint.high > WIDEST[joint.kind]:
            told = f"joint {joint.name} opens by {joint.high:g}"
            hint = f"at most {WIDEST[joint.kind]:.3g} {UNIT[joint.kind]} make sense"
            if joint.kind == "revolute" and joint.high <= 360.0:
                hint += f"; {joint.high:g} degrees are {np.deg2rad(joint.high):.3g} rad"
            raise ImportRefused(source, told, hint)
    raw = facing_minus_x(raw, side.front)
    if raw.joints and kind is not Kind.ARTICULATED:
        note = f"a {what} is {kind.value}: its joints ({', '.join(joint.name for joint in raw.joints)}) were made fast"
        raw = replace(raw.in_one(), notes=(*raw.notes, note))
    _check_side(side_file or beside, side, raw, kind)
    pieces, flat = _pieces(source, raw, listen)
    asset, found = assemble(raw, pieces, side, what, kind)
    notes = list(found)
    if kind is Kind.ARTICULATED and not asset.joints:
        notes.append(f"a {what} usually opens, and this one has no joint; it is a support with its tops and hollows")
    if flat:
        notes.append(f"{flat} of its meshes are flat, and not solid; give them a thickness if things rest on them")
    return keep(chosen, asset, kind, source.name, tuple(notes))


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
        return upright(read_urdf(source), side.up or "z")
    if ending in FORMATS:
        up = side.up or up_axis(source)
        parts = read_mesh(AssetFolder.of(source), source)
        return upright(RawAsset((RawLink("body", parts, parts),)), up)
    legal = ", ".join((".urdf", *FORMATS))
    raise ImportRefused(source, f"is of no known kind ({ending or 'no ending'})", f"expected {legal}, or a folder")


def _sized(source: Path, raw: RawAsset, height_m: float | None) -> RawAsset:
    """The asset at its size, with the middle of its box at the origin."""
    low, high = raw.box()
    if height_m is not None:
        if high[2] - low[2] < 1e-9:
            raise ImportRefused(source, "is flat, so that its height says nothing", "leave the height out")
        raw = raw.grown(height_m / float(high[2] - low[2]))
        low, high = raw.box()
    size = high - low
    if not (SMALLEST_M <= float(size.max()) <= LARGEST_M):
        told = " x ".join(f"{value:.3g}" for value in size)
        raise ImportRefused(source, f"would be {told} m large", "give its height in metres (--height-m)")
    return raw.moved(transform(np.eye(3), -(low + high) / 2))


def _check_side(file: Path, side: SideFile, raw: RawAsset, kind: Kind) -> None:
    """Refuses a side file that names joints or links which the asset does not have."""
    joints, links = [j.name for j in raw.joints], [link.name for link in raw.links]
    told = [("joint", h.joint, joints) for h in side.handles or ()]
    for place in side.places or ():
        told += [("link", place.link, links), *([("joint", place.joint, joints)] if place.joint else [])]
    for what, name, known in told:
        if name not in known:
            near = near_names(name, known)
            none = "none" if kind is Kind.ARTICULATED else f"none, since its category makes it {kind.value}"
            hint = f"did you mean {' or '.join(near)}?" if near else f"it has {', '.join(known) or none}"
            raise ImportRefused(file, f"names a {what} {name!r} that the asset does not have", hint)


def _pieces(source: Path, raw: RawAsset, listen: Listener) -> tuple[dict[str, tuple[Array, ...]], int]:
    """Points (N, 3) of every link's convex pieces, and how many meshes have none."""
    count, done, flat = sum(len(link.bodies) for link in raw.links), 0, 0
    pieces: dict[str, tuple[Array, ...]] = {}
    for link in raw.links:
        pieces[link.name] = ()
        for part in link.bodies:
            listen(done, count)
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
    listen(done, count)
    return pieces, flat
