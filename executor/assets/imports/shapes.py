"""The shapes that a URDF names: boxes, cylinders, balls, and meshes at their scale."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from executor.assets.imports.folder import AssetFolder
from executor.assets.imports.meshes import read_mesh
from executor.assets.imports.problems import ImportRefused
from executor.assets.imports.raw import Part
from executor.machine.extras import require


def parts_of(geometry: Any, file: Path, folder: AssetFolder) -> tuple[Part, ...]:
    """Returns the meshes of a geometry element, in the element's frame.

    Args:
        geometry: As yourdfpy reads it.
        file: The URDF, for messages.
        folder: Where its meshes are.

    Raises:
        ImportRefused: A length or a scale cannot be, or a mesh cannot be read.
    """
    if geometry.mesh is not None:
        return _scaled(geometry.mesh, file, folder)
    create: Any = require("trimesh", "sim").creation
    if geometry.box is not None:
        kind, lengths = "box", tuple(geometry.box.size)
    elif geometry.cylinder is not None:
        kind, lengths = "cylinder", (geometry.cylinder.radius, geometry.cylinder.length)
    else:  # The parser admits no fourth kind.
        kind, lengths = "sphere", (geometry.sphere.radius,)
    if not all(np.isfinite(length) and length > 0.0 for length in lengths):
        raise ImportRefused(file, f"a {kind} has the size {_told(lengths)}", "lengths are positive, in metres")
    if kind == "box":
        mesh = create.box(extents=lengths)
    elif kind == "cylinder":
        mesh = create.cylinder(*lengths, sections=24)
    else:
        mesh = create.icosphere(subdivisions=2, radius=lengths[0])
    return (Part(np.asarray(mesh.vertices, float), np.asarray(mesh.faces, np.int64), source=f"a {kind}"),)


def _scaled(mesh: Any, file: Path, folder: AssetFolder) -> tuple[Part, ...]:
    if not mesh.filename:
        raise ImportRefused(file, "a mesh has no filename", "give it one, relative to the URDF")
    scale = np.ones(3) if mesh.scale is None else np.atleast_1d(np.asarray(mesh.scale, dtype=float))
    if scale.shape not in ((1,), (3,)) or not np.isfinite(scale).all() or (scale == 0.0).any():
        problem = f"mesh {mesh.filename} has the scale {_told(scale)}"
        raise ImportRefused(file, problem, "expected three numbers other than 0")
    return tuple(part.stretched(scale) for part in read_mesh(folder, folder.find(mesh.filename)))


def _told(lengths: Any) -> str:
    return " ".join(f"{length:g}" for length in lengths)
