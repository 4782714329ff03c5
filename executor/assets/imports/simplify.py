"""Meshes with fewer triangles that look and collide nearly the same."""

from __future__ import annotations

from typing import Any

import numpy as np

from executor.assets.imports.raw import Faces
from executor.geometry import Array
from executor.machine.extras import require


def simplified(vertices_m: Array, faces: Faces, most: int) -> tuple[Array, Faces]:
    """Returns vertices (N, 3) and faces (M, 3) of a mesh with about as many faces as wanted, or as it is with fewer.

    Args:
        vertices_m: (N, 3) points.
        faces: (M, 3) indices.
        most: How many faces there shall be.

    Raises:
        MissingExtra: fast-simplification or trimesh is not installed.
    """
    if len(faces) <= most:
        return vertices_m, faces
    trimesh: Any = require("trimesh", "sim")
    fast: Any = require("fast_simplification", "sim")
    # Points that several faces have copies of must be one, else every edge is a border and stays.
    merged = trimesh.Trimesh(vertices_m, faces, process=True)
    merged.merge_vertices(merge_tex=True, merge_norm=True)
    if len(merged.faces) <= most:
        return np.asarray(merged.vertices, float), np.asarray(merged.faces, np.int64)
    points, triangles = fast.simplify(
        np.asarray(merged.vertices, np.float32), np.asarray(merged.faces, np.int32), 1.0 - most / len(merged.faces)
    )
    return np.asarray(points, float), np.asarray(triangles, np.int64)
