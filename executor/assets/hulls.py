"""Convex hulls as files, since the engine's builder takes them as files only; named by their content."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path

import numpy as np
from scipy.spatial import ConvexHull

from bddl.wholefile import write_atomically
from executor.assets.model import Vector
from executor.machine.cache import cache_dir, content_key


@lru_cache(maxsize=4096)
def hull_file(points_m: Sequence[Vector]) -> Path:
    """Returns an OBJ file of the convex hull of points, in metres; it is written where it is not there yet.

    Raises:
        scipy.spatial.QhullError: The points lie in a plane.
        OSError: The cache cannot be written.
    """
    points = np.asarray(points_m)
    path = cache_dir() / "hulls" / f"{content_key(points.tobytes())}.obj"
    if path.is_file():
        return path
    hull = ConvexHull(points)
    order = {int(old): new for new, old in enumerate(hull.vertices, start=1)}
    lines = [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in points[hull.vertices]]
    for face, plane in zip(hull.simplices, hull.equations, strict=True):
        a, b, c = (points[i] for i in face)
        outwards = float(np.cross(b - a, c - a) @ plane[:3]) > 0.0
        corners = face if outwards else face[::-1]
        lines.append("f " + " ".join(str(order[int(i)]) for i in corners))
    return write_atomically(path, ("\n".join(lines) + "\n").encode())
