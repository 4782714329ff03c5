"""Splits meshes into convex pieces for the physics; what a library needs seconds for is kept by its content."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
from scipy.spatial import QhullError

from bddl.wholefile import write_atomically
from executor.assets.imports.raw import Part
from executor.assets.imports.simplify import simplified
from executor.geometry import Array
from executor.machine.cache import cache_dir, content_key
from executor.machine.extras import require

NEARLY_CONVEX = 0.97
"""Share of its hull that a mesh fills to count as convex."""
NOTICEABLE = 0.005
"""Air that a hull may add, as a share of the whole mesh's box: less of it changes nothing that a robot would notice."""
MOST_PIECES = 24
MOST_POINTS = 60
"""Points of one piece; the engine allows 255, and few points make fast contacts."""
THINNEST_M = 5e-5
"""What is thinner is flat."""
MOST_FACES = 1000
"""Of a mesh that is decomposed; it is simplified to this many before."""
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


def convex_pieces(part: Part) -> tuple[Array, ...]:
    """Returns the points (N, 3) of the convex pieces that stand for a mesh.

    Connected components that are convex already are taken as they are; the others are decomposed.

    Args:
        part: The mesh.

    Raises:
        MissingExtra: The mesh is not convex and coacd is not installed.
    """
    trimesh: Any = require("trimesh", "sim")
    mesh = trimesh.Trimesh(part.vertices_m, part.faces, process=True)
    whole = float(np.prod(np.ptp(part.vertices_m, axis=0)))
    pieces: list[Array] = []
    for component in mesh.split(only_watertight=False):
        hull = _hull(component)
        if hull is None:
            continue
        filled = abs(float(component.volume)) if component.is_watertight else 0.0
        air = float(hull.volume) - filled
        if air <= (1.0 - NEARLY_CONVEX) * float(hull.volume) or air <= NOTICEABLE * whole or _is_thin(hull):
            pieces.append(_few_points(hull))
        else:
            pieces += _decomposed(component)
    return tuple(pieces)


def _hull(mesh: Any) -> Any | None:
    """The convex hull, or None for what has next to no volume, such as a single triangle."""
    if len(mesh.vertices) < 4:
        return None
    # The library divides by the volume of what is flat.
    with np.errstate(invalid="ignore", divide="ignore"):
        try:
            hull = mesh.convex_hull
        except (QhullError, ValueError):
            return None
        # Of a plate that is its thickness; what is kept of it is rounded to micrometres.
        return hull if 2.0 * float(hull.volume) > THINNEST_M * float(hull.area) else None


def _is_thin(hull: Any) -> bool:
    """A sheet: decomposing it gains nothing."""
    return float(min(hull.bounding_box_oriented.primitive.extents)) < 2e-3


def _few_points(hull: Any) -> Array:
    points = np.asarray(hull.vertices, dtype=float)
    if len(points) <= MOST_POINTS:
        return points
    # Farthest points first: what is left out lies near to what stays.
    chosen = [int(np.argmax(np.linalg.norm(points - points.mean(axis=0), axis=1)))]
    distance = np.linalg.norm(points - points[chosen[0]], axis=1)
    while len(chosen) < MOST_POINTS:
        chosen.append(int(np.argmax(distance)))
        distance = np.minimum(distance, np.linalg.norm(points - points[chosen[-1]], axis=1))
    return points[sorted(chosen)]


def _decomposed(mesh: Any) -> list[Array]:
    vertices, faces = simplified(np.asarray(mesh.vertices, float), np.asarray(mesh.faces, np.int64), MOST_FACES)
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
    pieces = [_few_points(hull) for hull in hulls if hull is not None]
    write_atomically(kept, json.dumps([points.round(6).tolist() for points in pieces]).encode())
    return [points.round(6) for points in pieces]
