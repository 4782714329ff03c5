"""What cameras see of an asset; the only file of the assets that touches render classes."""

from __future__ import annotations

from typing import Any

import numpy as np

from executor.assets.model import Link, Shape
from executor.assets.shapes import engine_orientation, vertex_normals
from executor.machine.simulator import load_sapien

_ROUGHNESS = 0.55
_SPECULAR = 0.35


def draw_link(entity: Any, link: Link) -> None:
    """Gives an entity the visible shapes of a link; the scene needs a render system.

    Args:
        entity: The `sapien.Entity` of the link's body.
        link: The link; shapes that are not visible are left out.
    """
    sapien = load_sapien()

    component = sapien.render.RenderBodyComponent()
    for shape in link.shapes:
        if shape.visible:
            drawn = _drawn(shape)
            drawn.local_pose = sapien.Pose(list(shape.position_m), list(engine_orientation(shape)))
            component.attach(drawn)
    entity.add_component(component)


def _drawn(shape: Shape) -> Any:
    sapien = load_sapien()

    red, green, blue, *alpha = shape.color
    material = sapien.render.RenderMaterial(
        base_color=[red, green, blue, alpha[0] if alpha else 1.0], roughness=_ROUGHNESS, specular=_SPECULAR
    )
    if shape.kind == "box":
        return sapien.render.RenderShapeBox(list(shape.size_m), material)
    if shape.kind == "cylinder":
        return sapien.render.RenderShapeCylinder(*shape.size_m, material)
    if shape.kind == "sphere":
        return sapien.render.RenderShapeSphere(shape.size_m[0], material)
    return sapien.render.RenderShapeTriangleMesh(
        np.asarray(shape.vertices_m, np.float32),
        np.asarray(shape.triangles, np.uint32),
        vertex_normals(shape.vertices_m, shape.triangles).astype(np.float32),
        np.zeros((len(shape.vertices_m), 2), np.float32),
        material,
    )
