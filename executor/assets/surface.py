"""The surface of a shape as triangles, as cameras see it: what point clouds are drawn from and rays are cast at."""

from __future__ import annotations

from typing import Any

import numpy as np

from executor.assets.model import Shape
from executor.geometry import transform_from_quaternion
from executor.machine.extras import require

_SIDES = 24  # Of a round shape.


def surface_of(shape: Shape) -> Any:
    """Returns a shape as a `trimesh.Trimesh` in its link's frame."""
    trimesh = require("trimesh", "sim")
    if shape.kind == "box":
        mesh = trimesh.creation.box(2.0 * np.asarray(shape.size_m))
    elif shape.kind == "cylinder":
        mesh = trimesh.creation.cylinder(shape.size_m[0], 2.0 * shape.size_m[1], sections=_SIDES)
    elif shape.kind == "sphere":
        mesh = trimesh.creation.icosphere(2, shape.size_m[0])
    elif shape.kind == "convex":
        mesh = trimesh.convex.convex_hull(np.asarray(shape.vertices_m))
    else:
        mesh = trimesh.Trimesh(shape.vertices_m, shape.triangles, process=False)
    return mesh.apply_transform(transform_from_quaternion(shape.position_m, shape.orientation))
