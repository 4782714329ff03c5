"""URDF reader, also for PartNet-Mobility folders; fixed links are welded to their parents.

Every other joint must be attached to the body. A door in a door, or a knob on a door, is welded at its zero position,
and a note records it.
"""

from __future__ import annotations

import io
import json
import logging
import re
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from executor.assets.importers.files import (
    CATEGORY,
    MOST_FACES,
    AssetFolder,
    ImportRefused,
    NothingThere,
    from_screen,
    parsed_markup,
    read_mesh,
    read_text,
)
from executor.assets.importers.raw import AssetMesh, RawAsset, RawJoint, RawLink
from executor.geometry import Array
from executor.system.extras import require

PARTNET_FILE = "mobility.urdf"
HEAVIEST_KG = 10_000.0
_MOVES: dict[str, Literal["revolute", "prismatic"]] = {"revolute": "revolute", "prismatic": "prismatic"}
_WELDED = frozenset({"fixed", "continuous"})
_HANDLE = re.compile(r"(?<![a-z])(handle|knob|pull|grip)(?![a-z])", re.IGNORECASE)
_FRONT = re.compile(r"(?<![a-z])(door|drawer|lid)(?![a-z])", re.IGNORECASE)
_XACRO = re.compile(r"\$[{(]")
_HINT = "see the URDF specification, or import the meshes one by one"
# PartNet-Mobility's category -> ours, where they differ.
_CATEGORIES = {"StorageFurniture": "cabinet"}


def read_partnet(folder: Path) -> RawAsset:
    """Return the content of a PartNet-Mobility folder.

    Collision elements have no names there. The file names of visual meshes that are called handles identify the handles
    of the physics as well.
    """
    raw = read_urdf(folder / PARTNET_FILE, handles_by_mesh=True)
    meta = AssetFolder.of(folder / PARTNET_FILE).here / "meta.json"
    if not meta.is_file():
        return raw
    try:
        data = json.loads(read_text(meta))
    except (ValueError, RecursionError) as error:
        raise ImportRefused(meta, f"is no JSON: {error}", "download the folder again") from error
    name = data.get("model_cat") if isinstance(data, dict) else None
    if not isinstance(name, str):
        return raw
    # TrashCan is a trash_can.
    words = re.sub(r"(?<=[a-z])(?=[A-Z])|[^A-Za-z0-9]+", "_", name).strip("_").lower()
    return replace(raw, category=_CATEGORIES.get(name, words if CATEGORY.fullmatch(words) else ""))


def read_urdf(file: Path, *, handles_by_mesh: bool = False) -> RawAsset:
    """Return the content of a URDF file, at the zero position of its joints.

    Args:
        file: The file; its folder must contain the meshes.
        handles_by_mesh: Whether a mesh that is a handle in one element is a handle in all.

    Raises:
        ImportRefused: The file is no URDF, or an element is unusable; the message names it. A missing mesh, or one
            without faces, is left out, and a note records it.
    """
    return _UrdfReader(file, _parsed(file), handles_by_mesh=handles_by_mesh).asset()


def _parsed(file: Path) -> Any:
    """The URDF's elements; meshes are not loaded by the parser."""
    yourdfpy: Any = require("yourdfpy", "mesh")
    etree: Any = require("lxml.etree", "mesh")
    root = parsed_markup(file)
    if root.tag != "robot":
        raise ImportRefused(file, f"begins with <{root.tag}>, not with <robot>", _HINT)
    etree.strip_tags(root, etree.Comment)
    if _is_xacro(root):
        hint = f"expand it first: xacro {file.name} > {file.stem}_expanded.urdf"
        raise ImportRefused(file, "has expressions of xacro, and is no URDF yet", hint)
    logging.getLogger("yourdfpy").setLevel(logging.CRITICAL)
    try:
        text = io.BytesIO(etree.tostring(root))
        return yourdfpy.URDF.load(text, build_scene_graph=False, load_meshes=False, load_collision_meshes=False).robot
    except Exception as error:  # The parser raises whatever float(), getattr and numpy raise.
        if isinstance(error, KeyError):
            reason = f"an element lacks its attribute {error}"
        elif isinstance(error, AttributeError | TypeError | IndexError):
            # The parser accesses required children that are missing.
            reason = "an element lacks one that it must have, such as parent, child or geometry"
        else:
            reason = str(error)
        raise ImportRefused(file, f"is no URDF that can be read: {reason}", _HINT) from error


def _is_xacro(root: Any) -> bool:
    return any(
        "/xacro}" in str(element.tag) or any(map(_XACRO.search, map(str, element.attrib.values())))
        for element in root.iter()
    )


def _is_handle_name(*names: str | None) -> bool:
    return any(name is not None and _HANDLE.search(name.replace("_", " ")) for name in names)


class _UrdfReader:
    """Walks a URDF's links from the body outwards, without recursion."""

    def __init__(self, file: Path, model: Any, *, handles_by_mesh: bool) -> None:
        self._file, self._folder = file, AssetFolder.of(file)
        self._links = {link.name: link for link in model.links}
        self._joints_of: dict[str, list[Any]] = {}
        self._root = self._tree(model)
        self._colors = {item.name: item.color.rgba for item in model.materials if item.color is not None}
        called = [visual for link in model.links for visual in link.visuals if _is_handle_name(visual.name)]
        meshes = [visual.geometry.mesh.filename for visual in called if visual.geometry.mesh is not None]
        self._handle_meshes = {Path(name or "").name for name in meshes} if handles_by_mesh else set()
        self._faces = 0
        self._visual_meshes: dict[str, list[AssetMesh]] = {}
        self._collision_meshes: dict[str, list[AssetMesh]] = {}
        self._mass: dict[str, float] = {}
        self._joints: list[RawJoint] = []
        self._notes: list[str] = []

    def _refused(self, problem: str, hint: str = _HINT) -> ImportRefused:
        return ImportRefused(self._file, problem, hint)

    def _tree(self, model: Any) -> str:
        """Store the joints by parent; return the name of the root link."""
        for what, elements in (("links", model.links), ("joints", model.joints)):
            for name, count in Counter(element.name for element in elements).items():
                if count > 1:
                    raise self._refused(f"has {count} {what} called {name}", "give each a name of its own")
        children = set()
        for joint in model.joints:
            for end in (joint.parent, joint.child):
                if end not in self._links:
                    raise self._refused(f"joint {joint.name} names a link {end!r} that is not there")
            if joint.child in children:
                raise self._refused(f"link {joint.child} hangs on two joints", "assets are trees")
            children.add(joint.child)
            self._joints_of.setdefault(joint.parent, []).append(joint)
        roots = [name for name in self._links if name not in children]
        if len(roots) != 1:
            named = f" ({', '.join(roots[:4])})" if roots else ""
            raise self._refused(f"has {len(roots)} links that hang on nothing{named}", "one must carry all others")
        return roots[0]

    def asset(self) -> RawAsset:
        """Return the asset of all links under the root."""
        # Each link with its carrier in the asset, and its pose.
        waiting: list[tuple[str, str, Array]] = [(self._root, self._root, np.eye(4))]
        visited = 0
        while waiting:
            name, carrier, T = waiting.pop()
            visited += 1
            self._add_link(name, carrier, T)
            for joint in self._joints_of.get(name, ()):
                T_joint = T @ (np.eye(4) if joint.origin is None else joint.origin)
                moves = self._moves(joint) and carrier == self._root
                if moves:
                    self._joints.append(self._joint(joint, T_joint))
                elif self._moves(joint):
                    self._notes.append(f"joint {joint.name} sits on a part that moves itself; it was made fast")
                elif joint.type == "continuous":
                    self._notes.append(f"joint {joint.name} turns without end; it was made fast")
                elif joint.type in _MOVES:
                    self._notes.append(f"warning: joint {joint.name} has no range; it was made fast")
                elif carrier == self._root and self._looks_like_front(joint.child):
                    warning = f"joint {joint.name} is fixed, and {joint.child} looks like a door or a drawer"
                    self._notes.append(f"warning: {warning}: it will not open")
                waiting.append((joint.child, joint.child if moves else carrier, T_joint))
        if visited != len(self._links):
            raise self._refused("its joints make a ring", "assets are trees")
        links = []
        for name in (self._root, *(joint.child for joint in self._joints)):
            collision_meshes, visual_meshes = (
                tuple(self._collision_meshes.get(name, ())),
                tuple(self._visual_meshes.get(name, ())),
            )
            if not collision_meshes and not visual_meshes:
                problem = f"the body {name} has" if name == self._root else f"link {name} moves and has"
                raise self._refused(f"{problem} no shape", "give it a collision mesh")
            links.append(
                RawLink(
                    name, visual_meshes or collision_meshes, collision_meshes or visual_meshes, self._mass.get(name)
                )
            )
        return RawAsset(tuple(links), tuple(self._joints), notes=tuple(self._notes))

    def _moves(self, joint: Any) -> bool:
        if joint.type not in _MOVES and joint.type not in _WELDED:
            legal = ", ".join([*_MOVES, *sorted(_WELDED)])
            raise self._refused(f"joint {joint.name} is of type {joint.type!r}", f"expected {legal}")
        limit = joint.limit
        # A joint without range is equivalent to a fixed one.
        fast = limit is not None and limit.lower is not None and limit.lower == limit.upper
        return joint.type in _MOVES and not fast

    def _looks_like_front(self, name: str) -> bool:
        """Whether a link is named like a door or a drawer, or has a handle and other parts."""
        link = self._links[name]
        handles = [_is_handle_name(element.name) for element in (*link.visuals, *link.collisions)]
        called = _FRONT.search(name.replace("_", " ")) is not None and not _is_handle_name(name)
        return bool(handles) and (called or any(handles)) and not all(handles)

    def _joint(self, joint: Any, T: Array) -> RawJoint:
        axis = np.array([1.0, 0.0, 0.0]) if joint.axis is None else np.asarray(joint.axis, dtype=float)
        length = float(np.linalg.norm(axis))
        if length < 1e-9:
            raise self._refused(f"the axis of joint {joint.name} is zero", "expected a direction")
        if joint.limit is None or joint.limit.lower is None or joint.limit.upper is None:
            raise self._refused(f"joint {joint.name} has no limits", "give lower and upper")
        low, high = float(joint.limit.lower), float(joint.limit.upper)
        if not (np.isfinite([low, high]).all() and low < high):
            raise self._refused(f"the limits of joint {joint.name} are {low:g} and {high:g}", "numbers, lower first")
        turned = T[:3, :3] @ axis / length
        mimics = "" if joint.mimic is None else str(joint.mimic.joint)
        return RawJoint(joint.name, _MOVES[joint.type], joint.child, T[:3, 3].copy(), turned, low, high, mimics)

    def _add_link(self, name: str, carrier: str, T: Array) -> None:
        link = self._links[name]
        mass = None if link.inertial is None else link.inertial.mass
        if mass is not None and 0.0 < mass <= HEAVIEST_KG:
            self._mass[carrier] = self._mass.get(carrier, 0.0) + float(mass)
        elif mass:
            self._notes.append(f"the mass of link {name} is {mass:g} kg; it was left out")
        # A moving link may be named after its handle; a welded link of that name is the handle itself.
        called = name if name != carrier else None
        for element in link.visuals:
            self._visual_meshes.setdefault(carrier, []).extend(
                self._parts(element, called, T, self._color(element.material))
            )
        for element in link.collisions:
            self._collision_meshes.setdefault(carrier, []).extend(self._parts(element, called, T, None))

    def _color(self, material: Any) -> tuple[float, ...] | None:
        """Return a material's own colour, linear, or the colour of the robot element's material of that name."""
        if material is None:
            return None
        rgba = self._colors.get(material.name) if material.color is None else material.color.rgba
        if rgba is None or not np.isfinite(rgba).all():
            return None
        return from_screen(rgba)

    def _parts(self, element: Any, link: str | None, T: Array, color: tuple[float, ...] | None) -> Iterator[AssetMesh]:
        T_shape = T if element.origin is None else T @ element.origin
        mesh_name = element.geometry.mesh.filename if element.geometry.mesh is not None else None
        known = mesh_name is not None and Path(mesh_name).name in self._handle_meshes
        handle = known or _is_handle_name(element.name, link, None if mesh_name is None else Path(mesh_name).stem)
        for part in self._shapes(element.geometry):
            moved = part.moved(T_shape)
            if not np.isfinite(moved.vertices_m).all():
                raise self._refused(f"{part.source} has an origin or a size that is no number")
            self._faces += len(moved.faces)
            if self._faces > MOST_FACES:
                raise self._refused(f"has more than {MOST_FACES} faces", "simplify its meshes")
            yield AssetMesh(moved.vertices_m, moved.faces, color or part.color, handle, part.source)

    def _shapes(self, geometry: Any) -> tuple[AssetMesh, ...]:
        if geometry.mesh is not None:
            return self._scaled(geometry.mesh)
        if geometry.box is not None:
            kind, lengths = "box", tuple(geometry.box.size)
        elif geometry.cylinder is not None:
            kind, lengths = "cylinder", (geometry.cylinder.radius, geometry.cylinder.length)
        else:  # The parser admits no fourth kind.
            kind, lengths = "sphere", (geometry.sphere.radius,)
        if not all(np.isfinite(length) and length > 0.0 for length in lengths):
            raise self._refused(f"a {kind} has the size {_format_lengths(lengths)}", "lengths are positive, in metres")
        create: Any = require("trimesh", "sim").creation
        if kind == "box":
            mesh = create.box(extents=lengths)
        elif kind == "cylinder":
            mesh = create.cylinder(*lengths, sections=24)
        else:
            mesh = create.icosphere(subdivisions=2, radius=lengths[0])
        return (AssetMesh(np.asarray(mesh.vertices, float), np.asarray(mesh.faces, np.int64), source=f"a {kind}"),)

    def _scaled(self, mesh: Any) -> tuple[AssetMesh, ...]:
        if not mesh.filename:
            raise self._refused("a mesh has no filename", "give it one, relative to the URDF")
        scale = np.ones(3) if mesh.scale is None else np.atleast_1d(np.asarray(mesh.scale, dtype=float))
        if scale.shape not in ((1,), (3,)) or not np.isfinite(scale).all() or (scale == 0.0).any():
            problem = f"mesh {mesh.filename} has the scale {_format_lengths(scale)}"
            raise self._refused(problem, "expected three numbers other than 0")
        try:
            parts = read_mesh(self._folder, self._folder.find(mesh.filename))
        except NothingThere as problem:
            warning = f"warning: mesh {mesh.filename} was left out: {problem.problem}; {problem.hint}"
            if warning not in self._notes:
                self._notes.append(warning)
            return ()
        return tuple(part.stretched(scale) for part in parts)


def _format_lengths(lengths: Any) -> str:
    return " ".join(f"{length:g}" for length in lengths)
