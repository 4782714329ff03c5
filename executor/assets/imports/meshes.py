"""Reads mesh files (OBJ, STL, PLY, glTF, DAE) without following any name out of the asset's folder."""

from __future__ import annotations

import io
import logging
from pathlib import Path
from typing import Any

import numpy as np

from executor.assets.imports.collada import ENDING, unit_m
from executor.assets.imports.colors import from_screen, rounded
from executor.assets.imports.folder import AssetFolder
from executor.assets.imports.markup import read_markup
from executor.assets.imports.problems import ImportRefused
from executor.assets.imports.raw import GREY, Part
from executor.machine.extras import require

FORMATS = (".obj", ".stl", ".ply", ".glb", ".gltf", ".dae", ".off")
MOST_FACES = 2_000_000
# Their colours are linear by their specification (3.9.2, baseColorFactor).
_LINEAR = frozenset({".glb", ".gltf"})
_PICTURES = frozenset({".png", ".jpg", ".jpeg", ".bmp", ".tga", ".tif", ".tiff", ".webp", ".gif", ".ktx2", ".dds"})


def read_mesh(folder: AssetFolder, file: Path) -> tuple[Part, ...]:
    """Returns the parts of a mesh file, one for each geometry in it, in the file's own frame.

    Lengths are the file's, except of Collada, which says what its unit is: those come in metres. Colours come from
    the materials; pictures are not read.

    Args:
        folder: Where the file and all that it names must be.
        file: The mesh.

    Raises:
        ImportRefused: The file is of no known format, broken or empty, or names something outside the folder.
        MissingExtra: trimesh is not installed.
    """
    if file.suffix.lower() not in FORMATS:
        raise ImportRefused(file, f"is no mesh that can be read ({file.suffix or 'no ending'})", _formats())
    # Of XML the reader gets the text that was looked at.
    markup = read_markup(folder, file) if file.suffix.lower() == ENDING else None
    unit = 1.0 if markup is None else unit_m(file, markup)
    trimesh: Any = require("trimesh", "sim")
    logging.getLogger("trimesh").setLevel(logging.CRITICAL)
    try:
        with folder.readable(file).open("rb") if markup is None else io.BytesIO(markup.encode()) as stream:
            loaded = trimesh.load_scene(stream, file_type=file.suffix[1:].lower(), resolver=_Resolver(folder, file))
        # Before the copies are made: a small file can name one mesh a million times.
        _few_enough(file, sum(len(getattr(loaded.geometry[of], "faces", ())) for _, of in _instances(loaded)))
        geometries = loaded.dump(concatenate=False)
    except ImportRefused:
        raise
    except MemoryError as error:
        raise ImportRefused(file, "needs more memory than there is", "simplify the mesh") from error
    except Exception as error:  # The readers of ten formats raise whatever comes to them.
        raise ImportRefused(file, f"cannot be read: {str(error) or type(error).__name__}", _formats()) from error
    parts = tuple(_part(file, geometry).grown(unit) for geometry in geometries if len(getattr(geometry, "faces", ())))
    if not parts:
        raise ImportRefused(file, "has no faces", "export it with triangles")
    return parts


def _instances(scene: Any) -> list[tuple[str, str]]:
    """The scene's nodes that show a geometry, each with the geometry's name."""
    return [(node, scene.graph[node][1]) for node in scene.graph.nodes_geometry]


def _few_enough(file: Path, faces: int) -> None:
    if faces > MOST_FACES:
        raise ImportRefused(file, f"has {faces} faces", f"at most {MOST_FACES} are read; simplify the mesh")


def _part(file: Path, geometry: Any) -> Part:
    vertices = np.asarray(geometry.vertices, dtype=float)
    if not np.isfinite(vertices).all():
        raise ImportRefused(file, "has a vertex that is no number", "export it again")
    return Part(vertices, np.asarray(geometry.faces, dtype=np.int64), _color(file, geometry), source=file.name)


def _color(file: Path, geometry: Any) -> tuple[float, ...]:
    """The material's main colour, linear; grey where there is none."""
    material = getattr(getattr(geometry, "visual", None), "material", None)
    color = getattr(material, "main_color", None)
    if color is None:
        return GREY
    read = rounded if file.suffix.lower() in _LINEAR else from_screen
    return read(np.asarray(color, dtype=float) / 255.0)


def _formats() -> str:
    return f"meshes can be {', '.join(ending[1:].upper() for ending in FORMATS)}"


class _Resolver:
    """Hands trimesh the files that a mesh names (materials, buffers), those of the asset's folder alone."""

    def __init__(self, folder: AssetFolder, file: Path) -> None:
        self._folder = AssetFolder(folder.root, file.resolve().parent)

    def get(self, name: str) -> bytes:
        """Returns a file's content; a picture or material that is not there costs its colour only."""
        if Path(name).suffix.lower() in _PICTURES:
            raise ImportRefused(self._folder.here / name, "is a picture", "pictures are not read")
        return self._folder.find(name).read_bytes()

    def __getitem__(self, name: str) -> bytes:
        return self.get(name)

    def __contains__(self, name: str) -> bool:
        try:
            self._folder.find(name)
        except ImportRefused:
            return False
        return True

    def namespaced(self, namespace: str) -> _Resolver:
        """Returns a resolver for names below a folder."""
        return _Resolver(self._folder, self._folder.here / namespace / "_")
