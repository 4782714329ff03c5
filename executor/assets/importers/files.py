"""Files of an imported asset: its folder, its side file, and its meshes (OBJ, STL, PLY, glTF, DAE).

No name in an asset's files leads out of its folder, and no file is too large to read.

XML is read alike by every reader: UTF-8, without a document type, whatever its declaration claims. A parser trusts the
declaration. A file in UTF-7 or UTF-16 can thereby hide entities from a check of its text, entities that grow to
gigabytes or name other files. Readers therefore get the checked text without its declaration.

A side file is a JSON file beside the asset. It overrules what is inferred:

    {"category": "cabinet", "height_m": 0.8, "front": "-y",
     "handles": [{"joint": "door", "position_m": [0, 0, 0], "axis": [0, 0, 1], "outward": [-1, 0, 0],
                  "length_m": 0.2, "thickness_m": 0.02}],
     "places": [{"name": "shelf", "kind": "interior", "link": "body", "center_m": [0, 0, 0],
                 "half_extents_m": [0.2, 0.2, 0.1], "opening": [-1, 0, 0], "joint": "door"}],
     "mass_kg": 0.3, "friction": 0.8}

Lengths and directions are in the finished asset's frame: metres, the middle of its box, front to -x, z up, joints shut.
"""

from __future__ import annotations

import io
import logging
import re
import stat
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import ArrayLike
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from bddl import near_names
from bddl.errors import Scene2DemoError
from executor.assets.importers.raw import GREY, AssetMesh
from executor.system.extras import require
from oag.model.forms import first_mistake

LARGEST_FILE_BYTES = 200_000_000  # Far above any mesh that a simulation needs.
MOST_NAMES = 5000
"""Number of the folder's file names that are searched for a hint."""
_SCHEMES = ("package://", "file://", "model://")
# Also of nonexistent XML versions, which many files name.
_DECLARATION = re.compile(r"\A\s*<\?xml[^>]*\?>")


class ImportRefused(Scene2DemoError, ValueError):
    """An asset cannot be read, or the robot could do nothing with it; the message has a remedy."""

    def __init__(self, path: Path, problem: str, hint: str) -> None:
        self.problem, self.hint = problem, hint
        super().__init__(f"{path}: {problem}; {hint}")


class NothingThere(ImportRefused):
    """A file that an asset names is missing or has no solid content."""


@dataclass(frozen=True, slots=True)
class AssetFolder:
    """The folder of an asset's files.

    Attributes:
        root: The folder; nothing above it is read.
        here: The base of relative names: a folder in `root`, or `root` itself.
    """

    root: Path
    here: Path

    @classmethod
    def of(cls, file: Path) -> AssetFolder:
        """Return the folder of an asset's main file."""
        folder = file.resolve().parent
        return cls(folder, folder)

    def find(self, name: str) -> Path:
        """Return the file for a name in the asset's files.

        `package://NAME/rest` is resolved as `rest` and as `NAME/rest` in the folder.

        Raises:
            NothingThere: There is no such file.
            ImportRefused: The name leads out of the folder, its package is missing, or the file is too large.
        """
        scheme = next((scheme for scheme in _SCHEMES if name.startswith(scheme)), "")
        rest = name[len(scheme) :]
        _, _, below = rest.partition("/")
        for candidate in (below, rest) if scheme and below else (rest,):
            path = (self.here / candidate).resolve()
            if not path.is_relative_to(self.root):
                problem = "the name leads out of the asset's folder"
                raise ImportRefused(self.here / name, problem, "copy the file into it")
            try:
                found = path.is_file()
            except OSError as error:
                raise ImportRefused(self.here, f"a name of {len(name)} letters cannot be read", "shorten it") from error
            if found:
                return self.readable(path)
        if scheme and below:
            package = rest.partition("/")[0]
            if not any((self.here / first).is_dir() for first in (package, below.partition("/")[0])):
                hint = f"copy the package's folder {package!r} into this one, so that there is {rest}"
                raise ImportRefused(self.here, f"{name} is not there", hint)
        near = near_names(below if scheme else name, self._names())
        hint = f"did you mean {' or '.join(near)}?" if near else "the folder must have all files that the asset names"
        raise NothingThere(self.here / rest, "no such file", hint)

    def _names(self) -> list[str]:
        """Names of the first files in the folder, for hints: the folder may be somebody's home."""
        paths = islice(self.here.rglob("*"), MOST_NAMES)
        return sorted(str(path.relative_to(self.here)) for path in paths if path.is_file())

    @staticmethod
    def readable(path: Path) -> Path:
        """Return a file's path.

        Raises:
            ImportRefused: It is too large, or no regular file.
        """
        found = path.stat()
        if not stat.S_ISREG(found.st_mode):
            raise ImportRefused(path, "is no regular file, but a folder, a device or a pipe", "name a file")
        if found.st_size > LARGEST_FILE_BYTES:
            hint = f"files up to {LARGEST_FILE_BYTES // 1_000_000} MB are read; simplify the mesh"
            raise ImportRefused(path, f"has {found.st_size // 1_000_000} MB", hint)
        return path


def read_text(file: Path) -> str:
    """Return the text of a file."""
    try:
        return AssetFolder.readable(file).read_text(encoding="utf-8")
    except UnicodeDecodeError as error:
        raise ImportRefused(file, f"is no text: {error.reason} at byte {error.start}", "save it as UTF-8") from error
    except OSError as error:
        raise ImportRefused(file, error.strerror or "cannot be read", "check its name and permissions") from error


def read_markup(file: Path) -> str:
    """Return the text of an XML file, without its declaration.

    Raises:
        ImportRefused: It is no text, or has a document type or entities.
    """
    text = read_text(file).removeprefix("\ufeff")
    if "\0" in text:
        raise ImportRefused(file, "is no text: it has characters that are none", "save it as UTF-8")
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise ImportRefused(file, "has a document type or entities", "remove them; neither is needed")
    return _DECLARATION.sub("", text, count=1)


def parsed_markup(file: Path) -> Any:
    """Return the root element (of lxml) of an XML file; no reference in the text is followed."""
    etree: Any = require("lxml.etree", "mesh")
    text = read_markup(file)
    strict = etree.XMLParser(
        encoding="utf-8", resolve_entities=False, no_network=True, huge_tree=False, remove_blank_text=True
    )
    try:
        return etree.fromstring(text.encode(), strict)
    except etree.XMLSyntaxError as error:
        raise ImportRefused(file, f"is not well-formed XML: {error.msg}", "see the line and column it names") from error


Coordinate = Annotated[float, Field(ge=-10, le=10)]
Triple = tuple[Coordinate, Coordinate, Coordinate]
CATEGORY = re.compile(r"^[A-Za-z][A-Za-z0-9_]{0,59}$")
Length = Annotated[float, Field(gt=0, le=10)]


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class SideHandle(_Strict):
    """A handle; see `executor.assets.model.Handle`."""

    joint: str
    position_m: Triple
    axis: Triple
    outward: Triple
    length_m: Length
    thickness_m: Length


class SidePlace(_Strict):
    """A place; see `executor.assets.model.Region`."""

    name: str = Field(min_length=1, max_length=60)
    kind: Literal["interior", "surface"]
    link: str
    center_m: Triple
    half_extents_m: tuple[Length, Length, Length]
    opening: Triple
    joint: str | None = None


class SideFile(_Strict):
    """All values that a side file may set; omitted ones are inferred."""

    category: str | None = Field(default=None, pattern=CATEGORY.pattern)
    synset: str | None = Field(default=None, max_length=80, pattern=r"^[a-z0-9_'-]+\.[a-z]\.\d\d$")
    height_m: Length | None = None
    up: Literal["y", "z"] | None = None
    front: Literal["-x", "+x", "-y", "+y"] | None = None
    handles: tuple[SideHandle, ...] | None = None
    places: tuple[SidePlace, ...] | None = None
    mass_kg: Annotated[float, Field(gt=0, le=500)] | None = None
    friction: Annotated[float, Field(gt=0, le=2)] | None = None


def read_side_file(file: Path | None) -> SideFile:
    """Return the content of a side file; an empty one without a file.

    Raises:
        ImportRefused: The file is not JSON, or a value has the wrong form; the message names the first one.
    """
    if file is None:
        return SideFile()
    try:
        return SideFile.model_validate_json(read_text(file))
    except ValidationError as error:
        legal = ", ".join(SideFile.model_fields)
        raise ImportRefused(file, first_mistake(error, SideFile), f"its fields are {legal}") from error


FORMATS = (".obj", ".stl", ".ply", ".glb", ".gltf", ".dae", ".off")
MOST_FACES = 2_000_000  # Far above what a simulation needs; a workstation still holds them.
_HINT = f"meshes can be {', '.join(ending[1:].upper() for ending in FORMATS)}"
_GLTF, _COLLADA = frozenset({".glb", ".gltf"}), ".dae"
_PICTURES = frozenset({".png", ".jpg", ".jpeg", ".bmp", ".tga", ".tif", ".tiff", ".webp", ".gif", ".ktx2", ".dds"})
_UP = re.compile(r"<up_axis>\s*([XYZ])_UP\s*</up_axis>")
# Confined to one element: each unclosed element would otherwise be searched to the end of the file.
_UNIT = re.compile(r"<unit\b[^<>]*\bmeter\s*=\s*[\"']([^\"']*)[\"']")
_UNITS_M = (1e-6, 1e3)  # From micrometres to kilometres.


def read_mesh(folder: AssetFolder, file: Path) -> tuple[AssetMesh, ...]:
    """Return the parts of a mesh file, one for each geometry in it, in the file's own frame.

    Lengths are in the file's unit. Collada files name their unit, so that their lengths are converted to metres.
    Colours come from the materials; textures are not read.

    Args:
        folder: Folder that must contain the file and all files that it names.

    Raises:
        NothingThere: The file has no faces.
        ImportRefused: The file is of no known format or broken, or names something outside the folder.
    """
    ending = file.suffix.lower()
    if ending not in FORMATS:
        raise ImportRefused(file, f"is no mesh that can be read ({file.suffix or 'no ending'})", _HINT)
    # Of XML the reader gets the checked text.
    markup = read_markup(file) if ending == _COLLADA else None
    unit = 1.0 if markup is None else _unit_m(file, markup)
    trimesh: Any = require("trimesh", "sim")
    logging.getLogger("trimesh").setLevel(logging.CRITICAL)
    try:
        with folder.readable(file).open("rb") if markup is None else io.BytesIO(markup.encode()) as stream:
            loaded = trimesh.load_scene(stream, file_type=ending[1:], resolver=_Resolver(folder, file))
        # Before the copies are made: a small file can name one mesh a million times.
        shown = (loaded.geometry[loaded.graph[node][1]] for node in loaded.graph.nodes_geometry)
        faces = sum(len(getattr(geometry, "faces", ())) for geometry in shown)
        if faces > MOST_FACES:
            raise ImportRefused(file, f"has {faces} faces", f"at most {MOST_FACES} are read; simplify the mesh")
        geometries = loaded.dump(concatenate=False)
    except ImportRefused:
        raise
    except MemoryError as error:
        raise ImportRefused(file, "needs more memory than there is", "simplify the mesh") from error
    except Exception as error:  # The readers of ten formats raise arbitrary exceptions.
        raise ImportRefused(file, f"cannot be read: {str(error) or type(error).__name__}", _HINT) from error
    solid = (geometry for geometry in geometries if len(getattr(geometry, "faces", ())))
    parts = tuple(_part(file, geometry).stretched(unit) for geometry in solid)
    if not parts:
        raise NothingThere(file, "has no faces", "export it with triangles")
    return parts


def up_axis(file: Path) -> str:
    """Return the up axis of a mesh file, "y" or "z": as given in the file, or usual for its format.

    Raises:
        ImportRefused: It is x.
    """
    if file.suffix.lower() != _COLLADA:
        return "y" if file.suffix.lower() in _GLTF else "z"
    found = _UP.search(read_markup(file))
    if found is not None and found[1] == "X":
        raise ImportRefused(file, "has x up", "export it with y or z up")
    return "y" if found is None else found[1].lower()


def from_screen(color: ArrayLike) -> tuple[float, ...]:
    """Convert an sRGB colour with parts from 0 to 1 to linear RGB.

    Renderers expect colours linear in the amount of light. OBJ, PLY and DAE store sRGB colours, and so do URDF files
    whose authors chose colours in a viewer. Source: IEC 61966-2-1.
    """
    encoded = np.clip(np.asarray(color, dtype=float)[:3], 0.0, 1.0)
    return _rounded(np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4))


def _rounded(color: ArrayLike) -> tuple[float, ...]:
    """Return the RGB of a linear colour, rounded to significant digits."""
    return tuple(round(float(value), 4) for value in np.clip(np.asarray(color, dtype=float)[:3], 0.0, 1.0))


def _unit_m(file: Path, markup: str) -> float:
    """Return the length of a Collada file's unit [m], 1 if it names none."""
    found = _UNIT.search(markup)
    if found is None:
        return 1.0
    try:
        length = float(found[1])
    except ValueError:
        length = 0.0
    if not _UNITS_M[0] <= length <= _UNITS_M[1]:
        raise ImportRefused(file, f"has a unit of {found[1][:40]!r} metres", "export it again")
    return length


def _part(file: Path, geometry: Any) -> AssetMesh:
    vertices = np.asarray(geometry.vertices, dtype=float)
    if not np.isfinite(vertices).all():
        raise ImportRefused(file, "has a vertex that is no number", "export it again")
    material = getattr(getattr(geometry, "visual", None), "material", None)
    color = getattr(material, "main_color", None)
    if color is None:
        rgb: tuple[float, ...] = GREY
    else:
        # Those of glTF are linear by their specification (3.9.2, baseColorFactor).
        rgb = (_rounded if file.suffix.lower() in _GLTF else from_screen)(np.asarray(color, dtype=float) / 255.0)
    return AssetMesh(vertices, np.asarray(geometry.faces, dtype=np.int64), rgb, source=file.name)


class _Resolver:
    """Hands trimesh the files that a mesh names (materials, buffers), those of the asset's folder alone."""

    def __init__(self, folder: AssetFolder, file: Path) -> None:
        self._folder = AssetFolder(folder.root, file.resolve().parent)

    def get(self, name: str) -> bytes:
        """Return a file's content; a picture or material that is not there costs its colour only."""
        if Path(name).suffix.lower() in _PICTURES:
            raise ImportRefused(self._folder.here / name, "is a picture", "pictures are not read")
        return self._folder.find(name).read_bytes()

    __getitem__ = get
