"""Reads a URDF: fixed links are welded to what carries them, every other joint must sit on the body.

A door in a door, or a knob that turns on a door, is welded at its zero position, and a note says so.
"""

from __future__ import annotations

import logging
import re
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Literal

import numpy as np

from executor.assets.imports.colors import from_screen
from executor.assets.imports.folder import AssetFolder
from executor.assets.imports.markup import parsed_markup
from executor.assets.imports.meshes import MOST_FACES
from executor.assets.imports.problems import ImportRefused
from executor.assets.imports.raw import Part, RawAsset, RawJoint, RawLink
from executor.assets.imports.shapes import parts_of
from executor.geometry import Array
from executor.machine.extras import require

_MOVES: dict[str, Literal["revolute", "prismatic"]] = {"revolute": "revolute", "prismatic": "prismatic"}
_WELDED = frozenset({"fixed", "continuous"})
_HANDLE = re.compile(r"(?<![a-z])(handle|knob|pull|grip)(?![a-z])", re.IGNORECASE)
HEAVIEST_KG = 10_000.0
_HINT = "see the URDF specification, or import the meshes one by one"


def is_handle_name(*names: str | None) -> bool:
    """Decides whether one of the names says that a part is there to be held."""
    return any(name is not None and _HANDLE.search(name.replace("_", " ")) for name in names)


def read_urdf(file: Path, handle_meshes: frozenset[str] = frozenset()) -> RawAsset:
    """Returns what a URDF file describes, at the zero position of its joints.

    Args:
        file: The file; meshes are looked for in its folder.
        handle_meshes: Names of mesh files that are known to be handles.

    Raises:
        ImportRefused: The file is no URDF, or something in it cannot be used; the message names it.
        MissingExtra: yourdfpy is not installed.
    """
    folder = AssetFolder.of(file)
    model: Any = _parsed(file, folder)
    for what, elements in (("links", model.links), ("joints", model.joints)):
        for name, count in Counter(element.name for element in elements).items():
            if count > 1:
                raise ImportRefused(file, f"has {count} {what} called {name}", "give each a name of its own")
    links = {link.name: link for link in model.links}
    joints_of: dict[str, list[Any]] = {}
    children = set()
    for joint in model.joints:
        for end in (joint.parent, joint.child):
            if end not in links:
                raise ImportRefused(file, f"joint {joint.name} names a link {end!r} that is not there", _HINT)
        if joint.child in children:
            raise ImportRefused(file, f"link {joint.child} hangs on two joints", "assets are trees")
        children.add(joint.child)
        joints_of.setdefault(joint.parent, []).append(joint)
    roots = [name for name in links if name not in children]
    if len(roots) != 1:
        raise ImportRefused(file, f"has {len(roots)} links that hang on nothing", "one must carry all others")
    colors = {material.name: material.color.rgba for material in model.materials if material.color is not None}
    reader = _Tree(file, folder, links, joints_of, colors, handle_meshes)
    reader.walk(roots[0])
    return reader.asset()


class _Tree:
    """Walks a URDF's links from the body outwards, without recursion."""

    def __init__(
        self,
        file: Path,
        folder: AssetFolder,
        links: dict[str, Any],
        joints_of: dict[str, list[Any]],
        colors: dict[str, Any],
        handle_meshes: frozenset[str],
    ) -> None:
        self._file, self._folder, self._links, self._joints_of = file, folder, links, joints_of
        self._colors, self._handle_meshes = colors, handle_meshes
        self._faces = 0
        self._looks: dict[str, list[Part]] = {}
        self._bodies: dict[str, list[Part]] = {}
        self._mass: dict[str, float] = {}
        self._joints: list[RawJoint] = []
        self._notes: list[str] = []

    def walk(self, root: str) -> None:
        """Collects everything that hangs on a link; `carrier` is the link of the asset that a URDF link belongs to."""
        waiting: list[tuple[str, str, Array]] = [(root, root, np.eye(4))]
        seen = 0
        while waiting:
            name, carrier, T = waiting.pop()
            seen += 1
            self._take(name, carrier, T)
            for joint in self._joints_of.get(name, ()):
                T_joint = T @ (np.eye(4) if joint.origin is None else joint.origin)
                moves = self._moves(joint) and carrier == root
                if moves:
                    self._joints.append(self._joint(joint, T_joint))
                elif self._moves(joint):
                    self._notes.append(f"joint {joint.name} sits on a part that moves itself; it was made fast")
                elif joint.type == "continuous":
                    self._notes.append(f"joint {joint.name} turns without end; it was made fast")
                waiting.append((joint.child, joint.child if moves else carrier, T_joint))
        if seen != len(self._links):
            raise ImportRefused(self._file, "its joints make a ring", "assets are trees")
        self._root = root

    def asset(self) -> RawAsset:
        """Returns what was collected."""
        names = [self._root, *(joint.child for joint in self._joints)]
        links = []
        for name in names:
            bodies, looks = tuple(self._bodies.get(name, ())), tuple(self._looks.get(name, ()))
            if not bodies and not looks:
                if name == self._root:
                    raise ImportRefused(self._file, f"the body {name} has no shape", "give it a collision mesh")
                raise ImportRefused(self._file, f"link {name} moves and has no shape", "give it a collision mesh")
            links.append(RawLink(name, looks or bodies, bodies or looks, self._mass.get(name)))
        return RawAsset(tuple(links), tuple(self._joints), notes=tuple(self._notes))

    def _moves(self, joint: Any) -> bool:
        if joint.type not in _MOVES and joint.type not in _WELDED:
            legal = ", ".join([*_MOVES, *sorted(_WELDED)])
            raise ImportRefused(self._file, f"joint {joint.name} is of type {joint.type!r}", f"expected {legal}")
        return joint.type in _MOVES and not _is_shut_for_good(joint)

    def _joint(self, joint: Any, T: Array) -> RawJoint:
        axis = np.array([1.0, 0.0, 0.0]) if joint.axis is None else np.asarray(joint.axis, dtype=float)
        length = float(np.linalg.norm(axis))
        if length < 1e-9:
            raise ImportRefused(self._file, f"the axis of joint {joint.name} is zero", "expected a direction")
        if joint.limit is None or joint.limit.lower is None or joint.limit.upper is None:
            raise ImportRefused(self._file, f"joint {joint.name} has no limits", "give lower and upper")
        low, high = float(joint.limit.lower), float(joint.limit.upper)
        if not (np.isfinite([low, high]).all() and low < high):
            raise ImportRefused(
                self._file, f"the limits of joint {joint.name} are {low:g} and {high:g}", "numbers, lower first"
            )
        return RawJoint(
            joint.name, _MOVES[joint.type], joint.child, T[:3, 3].copy(), T[:3, :3] @ axis / length, low, high
        )

    def _take(self, name: str, carrier: str, T: Array) -> None:
        link = self._links[name]
        mass = None if link.inertial is None else link.inertial.mass
        if mass is not None and 0.0 < mass <= HEAVIEST_KG:
            self._mass[carrier] = self._mass.get(carrier, 0.0) + float(mass)
        elif mass:
            self._notes.append(f"the mass of link {name} is {mass:g} kg; it was left out")
        # A link that moves may well be called after the handle that it has; one that is welded on is the handle.
        called = name if name != carrier else None
        for element in link.visuals:
            self._looks.setdefault(carrier, []).extend(self._parts(element, called, T, self._color(element.material)))
        for element in link.collisions:
            self._bodies.setdefault(carrier, []).extend(self._parts(element, called, T, None))

    def _color(self, material: Any) -> tuple[float, ...] | None:
        """A material's own colour, linear, or that of the one of its name which the robot element has."""
        if material is None:
            return None
        rgba = self._colors.get(material.name) if material.color is None else material.color.rgba
        if rgba is None or not np.isfinite(rgba).all():
            return None
        return from_screen(rgba)

    def _parts(self, element: Any, link: str | None, T: Array, color: tuple[float, ...] | None) -> Iterator[Part]:
        T_shape = T if element.origin is None else T @ element.origin
        mesh_name = element.geometry.mesh.filename if element.geometry.mesh is not None else None
        known = mesh_name is not None and Path(mesh_name).name in self._handle_meshes
        handle = known or is_handle_name(element.name, link, None if mesh_name is None else Path(mesh_name).stem)
        for part in parts_of(element.geometry, self._file, self._folder):
            moved = part.moved(T_shape)
            if not np.isfinite(moved.vertices_m).all():
                raise ImportRefused(self._file, f"{part.source} has an origin or a size that is no number", _HINT)
            self._faces += len(moved.faces)
            if self._faces > MOST_FACES:
                raise ImportRefused(self._file, f"has more than {MOST_FACES} faces", "simplify its meshes")
            yield Part(moved.vertices_m, moved.faces, color or part.color, handle, part.source)


def _is_shut_for_good(joint: Any) -> bool:
    """A joint whose limits leave no room is as good as fixed."""
    limit = joint.limit
    return limit is not None and limit.lower is not None and limit.lower == limit.upper


def _parsed(file: Path, folder: AssetFolder) -> Any:
    """The URDF's elements; meshes are not loaded by the parser."""
    yourdfpy: Any = require("yourdfpy", "mesh")
    etree: Any = require("lxml.etree", "mesh")
    root = parsed_markup(folder, file)
    if root.tag != "robot":
        raise ImportRefused(file, f"begins with <{root.tag}>, not with <robot>", _HINT)
    etree.strip_tags(root, etree.Comment)
    logging.getLogger("yourdfpy").setLevel(logging.CRITICAL)
    try:
        urdf = yourdfpy.URDF
        return urdf(
            robot=urdf._parse_robot(xml_element=root),
            build_scene_graph=False,
            load_meshes=False,
            load_collision_meshes=False,
        ).robot
    except Exception as error:  # The parser raises whatever float(), getattr and numpy raise.
        raise ImportRefused(file, f"is no URDF that can be read: {_said(error)}", _HINT) from error


def _said(error: Exception) -> str:
    """What the parser's error means: it asks elements for what they must have, and gets nothing."""
    if isinstance(error, KeyError):
        return f"an element lacks its attribute {error}"
    if isinstance(error, AttributeError | TypeError | IndexError):
        return "an element lacks one that it must have, such as parent, child or geometry"
    return str(error)
