"""Reads mesh files (OBJ, STL, PLY, glTF, DAE) without following any name out of the asset's folder."""

from __future__ import annotations

import io
import logging
import re
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from executor.assets.imports.asset_folder import AssetFolder, ImportRefused, NothingThere, read_markup
from executor.assets.imports.raw import GREY, MeshPart
from executor.machine.extras import require

FORMATS = (".obj", ".stl", ".ply", ".glb", ".gltf", ".dae", ".off")
MOST_FACES = 2_000_000  # Far above what a simulation needs; a workstation still holds them.
_HINT = f"meshes can be {', '.join(ending[1:].upper() for ending in FORMATS)}"
_GLTF, _COLLADA = frozenset({".glb", ".gltf"}), ".dae"
_PICTURES = frozenset({".png", ".jpg", ".jpeg", ".bmp", ".tga", ".tif", ".tiff", ".webp", ".gif", ".ktx2", ".dds"})
_UP = re.compile(r"<up_axis>\s*([XYZ])_UP\s*</up_axis>")
# Within one element: from each of many that are not closed it would else be looked for to the end of the file.
_UNIT = re.compile(r"<unit\b[^<>]*\bmeter\s*=\s*[\"']([^\"']*)[\"']")
_UNITS_M = (1e-6, 1e3)  # From micrometres to kilometres.


def read_mesh(folder: AssetFolder, file: Path) -> tuple[MeshPart, ...]:
    """Returns the parts of a mesh file, one for each geometry in it, in the file's own frame.

    Lengths are the file's, except of Collada, which says what its unit is: those come in metres. Colours come from
    the materials; pictures are not read.

    Args:
        folder: Where the file and all that it names must be.
        file: The mesh.

    Raises:
        NothingThere: The file has no faces.
        ImportRefused: The file is of no known format or broken, or names something outside the folder.
        MissingExtra: trimesh is not installed.
    """
    ending = file.suffix.lower()
    if ending not in FORMATS:
        raise ImportRefused(file, f"is no mesh that can be read ({file.suffix or 'no ending'})", _HINT)
    # Of XML the reader gets the text that was looked at.
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
    except Exception as error:  # The readers of ten formats raise whatever comes to them.
        raise ImportRefused(file, f"cannot be read: {str(error) or type(error).__name__}", _HINT) from error
    solid = (geometry for geometry in geometries if len(getattr(geometry, "faces", ())))
    parts = tuple(_part(file, geometry).stretched(unit) for geometry in solid)
    if not parts:
        raise NothingThere(file, "has no faces", "export it with triangles")
    return parts


def up_axis(file: Path) -> str:
    """Returns the axis that is up in a mesh file, "y" or "z": told by the file, or usual for its format.

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
    """Returns the linear RGB of a colour whose parts, 0 to 1, are encoded as in sRGB.

    Renderers count colours linear in the amount of light. OBJ, PLY and DAE have them as screens show them, and so do
    the URDF files of who chose them in a viewer. Source: IEC 61966-2-1.
    """
    encoded = np.clip(np.asarray(color, dtype=float)[:3], 0.0, 1.0)
    return _rounded(np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4))


def _rounded(color: ArrayLike) -> tuple[float, ...]:
    """The RGB of a linear colour without digits that mean nothing."""
    return tuple(round(float(value), 4) for value in np.clip(np.asarray(color, dtype=float)[:3], 0.0, 1.0))


def _unit_m(file: Path, markup: str) -> float:
    """The length of a Collada file's unit in metres, 1 where it says nothing."""
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


def _part(file: Path, geometry: Any) -> MeshPart:
    vertices = np.asarray(geometry.vertices, dtype=float)
    if not np.isfinite(vertices).all():
        raise ImportRefused(file, "has a vertex that is no number", "export it again")
    material = getattr(getattr(geometry, "visual", None), "material", None)
    color = getattr(material, "main_color", None)
    if color is None:
        told: tuple[float, ...] = GREY
    else:
        # Those of glTF are linear by their specification (3.9.2, baseColorFactor).
        told = (_rounded if file.suffix.lower() in _GLTF else from_screen)(np.asarray(color, dtype=float) / 255.0)
    return MeshPart(vertices, np.asarray(geometry.faces, dtype=np.int64), told, source=file.name)


class _Resolver:
    """Hands trimesh the files that a mesh names (materials, buffers), those of the asset's folder alone."""

    def __init__(self, folder: AssetFolder, file: Path) -> None:
        self._folder = AssetFolder(folder.root, file.resolve().parent)

    def get(self, name: str) -> bytes:
        """Returns a file's content; a picture or material that is not there costs its colour only."""
        if Path(name).suffix.lower() in _PICTURES:
            raise ImportRefused(self._folder.here / name, "is a picture", "pictures are not read")
        return self._folder.find(name).read_bytes()

    __getitem__ = get
