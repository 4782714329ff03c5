"""Simplify meshes: convex pieces for physics, and few triangles for cameras.

Results that take seconds are cached by content.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy.spatial import QhullError

from bddl.files import write_atomically
from executor.assets.asset_geometry import farthest_points
from executor.assets.importers.raw import AssetMesh, Faces
from executor.assets.model import Shape
from executor.geometry import Array
from executor.system.extras import require
from executor.system.files import cache_dir, content_key

NEARLY_CONVEX = 0.97
"""Share of its hull that a mesh fills to count as convex."""
NOTICEABLE = 0.005
"""Air that a hull may add, as a share of the whole mesh's box: less of it changes nothing that a robot would notice."""
MOST_PIECES = 24
MOST_POINTS = 60
"""Points of one piece; the engine allows 255, and few points make fast contacts."""
THINNEST_M = 5e-5
"""Least thickness of a solid; anything thinner is flat."""
SHEET_M = 2e-3
"""Least thickness that is worth decomposing."""
MOST_FACES = 1000
"""Most faces of a mesh to decompose; larger ones are simplified first."""
MOST_TRIANGLES = 4000
"""Most visual triangles of one link, over all its meshes, for fast rendering."""
# Coarser than the library's defaults: seconds instead of minutes, and a few millimetres on things of a hand's size.
_SEARCH = {
    "threshold": 0.06,
    "mcts_iterations": 40,
    "mcts_nodes": 12,
    "mcts_max_depth": 2,
    "resolution": 1000,
    "preprocess_resolution": 25,
}
_VERSION = "2"


def convex_pieces(part: AssetMesh) -> tuple[Array, ...]:
    """Return the points (N, 3) of the convex pieces that represent a mesh.

    Connected components that are already convex are kept; the others are decomposed. Components without volume, such as
    each side of a box in many recorded models, are joined into one component.
    """
    trimesh: Any = require("trimesh", "sim")
    mesh = trimesh.Trimesh(part.vertices_m, part.faces, process=True)
    whole = float(np.prod(np.ptp(part.vertices_m, axis=0)))
    pieces: list[Array] = []
    components = mesh.split(only_watertight=False)
    sheets = [component for component in components if _hull(component) is None]
    if len(sheets) > 1:
        together = trimesh.util.concatenate(sheets)
        together.merge_vertices()
        together.update_faces(together.unique_faces())  # Many sides exist twice, once per orientation.
        components = [*(one for one in components if _hull(one) is not None), together]
    for component in components:
        hull = _hull(component)
        if hull is None:
            continue
        filled = abs(float(component.volume)) if component.is_watertight else 0.0
        air = 0.0 if _is_skin(component, hull) else float(hull.volume) - filled
        if (
            air <= (1.0 - NEARLY_CONVEX) * float(hull.volume)
            or air <= NOTICEABLE * whole
            or float(min(hull.bounding_box_oriented.primitive.extents)) < SHEET_M
        ):
            pieces.append(_few_points(hull))
        else:
            pieces += _decomposed(component)
    return tuple(pieces)


def _hull(mesh: Any) -> Any | None:
    """The convex hull, or None for a component of nearly no volume, such as a single triangle."""
    if len(mesh.vertices) < 4:
        return None
    # The library divides by the volume of what is flat.
    with np.errstate(invalid="ignore", divide="ignore"):
        try:
            hull = mesh.convex_hull
        except (QhullError, ValueError):
            return None
        # For a plate this compares its thickness; stored points are rounded to micrometres.
        return hull if 2.0 * float(hull.volume) > THINNEST_M * float(hull.area) else None


def _is_skin(mesh: Any, hull: Any) -> bool:
    """Return whether faces, which may share no edge, lie on their hull and cover it."""
    if mesh.area < NEARLY_CONVEX * hull.area or len(mesh.vertices) * len(hull.faces) > MOST_FACES**2:
        return False
    beyond_m = mesh.vertices @ hull.face_normals.T - (hull.triangles[:, 0] * hull.face_normals).sum(axis=1)
    return bool((beyond_m.max(axis=1) > -SHEET_M).all())


def _few_points(hull: Any) -> Array:
    points = np.asarray(hull.vertices, dtype=float)
    if len(points) <= MOST_POINTS:
        return points
    outermost = int(np.argmax(np.linalg.norm(points - points.mean(axis=0), axis=1)))
    return points[sorted(farthest_points(points, MOST_POINTS, outermost))]


def _decomposed(mesh: Any) -> list[Array]:
    vertices, faces = _simplified(np.asarray(mesh.vertices, float), np.asarray(mesh.faces, np.int64), MOST_FACES)
    key = content_key(_VERSION, vertices.round(7).tobytes(), faces.tobytes())
    kept = cache_dir() / "convex" / f"{key}.json"
    if kept.is_file():
        return [np.asarray(points) for points in json.loads(kept.read_text(encoding="utf-8"))]
    coacd: Any = require("coacd", "mesh")
    coacd.set_log_level("error")
    whole = coacd.Mesh(vertices.astype(np.float64), faces.astype(np.int32))
    found = coacd.run_coacd(whole, max_convex_hull=MOST_PIECES, seed=0, **_SEARCH)
    trimesh: Any = require("trimesh", "sim")
    hulls = (_hull(trimesh.Trimesh(points, triangles)) for points, triangles in found)
    pieces = [_few_points(hull).round(6) for hull in hulls if hull is not None]
    write_atomically(kept, json.dumps([points.tolist() for points in pieces]).encode())
    return pieces


def visible_shapes(visual_meshes: Sequence[AssetMesh], origin_m: Array) -> tuple[Shape, ...]:
    """Return visible shapes for a link's meshes.

    Args:
        origin_m: (3,) origin of the link's frame.
    """
    total = sum(len(part.faces) for part in visual_meshes)
    shapes = []
    for part in visual_meshes:
        if not len(part.faces):
            continue
        points, faces = part.vertices_m, part.faces
        if total > MOST_TRIANGLES:
            points, faces = _simplified(points, faces, max(int(len(faces) * MOST_TRIANGLES / total), 12))
        vertices = tuple((float(x), float(y), float(z)) for x, y, z in (points - origin_m).round(5))
        triangles = tuple((int(a), int(b), int(c)) for a, b, c in faces)
        color = tuple(part.color)
        shapes.append(Shape("mesh", color=color, collides=False, vertices_m=vertices, triangles=triangles))
    return tuple(shapes)


def _simplified(vertices_m: Array, faces: Faces, most: int) -> tuple[Array, Faces]:
    """Vertices (N, 3) and faces (M, 3) of a mesh with at most about as many faces as given."""
    if len(faces) <= most:
        return vertices_m, faces
    trimesh: Any = require("trimesh", "sim")
    fast: Any = require("fast_simplification", "sim")
    # Points that several faces have copies of must be one, else every edge is a border and stays.
    merged = trimesh.Trimesh(vertices_m, faces, process=True)
    merged.merge_vertices(merge_tex=True, merge_norm=True)
    points, triangles = np.asarray(merged.vertices, float), np.asarray(merged.faces, np.int64)
    if len(triangles) > most:
        points, triangles = fast.simplify(
            points.astype(np.float32), triangles.astype(np.int32), 1.0 - most / len(triangles)
        )
    return np.asarray(points, float), np.asarray(triangles, np.int64)
