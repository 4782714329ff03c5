"""What cameras see of an imported link: its meshes, with so few triangles that drawing stays fast."""

from __future__ import annotations

from collections.abc import Sequence

from executor.assets.imports.raw import Part
from executor.assets.imports.simplify import simplified
from executor.assets.model import Shape
from executor.geometry import Array

MOST_TRIANGLES = 4000
"""Of one link, over all its meshes."""


def visible_shapes(looks: Sequence[Part], origin_m: Array) -> tuple[Shape, ...]:
    """Returns visible shapes for a link's meshes.

    Args:
        looks: In the asset's frame.
        origin_m: (3,) where the link's frame is.

    Raises:
        MissingExtra: There are many triangles and fast-simplification is not installed.
    """
    total = sum(len(part.faces) for part in looks)
    return tuple(_shape(_simplified(part, total), origin_m) for part in looks if len(part.faces))


def _simplified(part: Part, total: int) -> Part:
    if total <= MOST_TRIANGLES:
        return part
    points, faces = simplified(part.vertices_m, part.faces, max(int(len(part.faces) * MOST_TRIANGLES / total), 12))
    return Part(points, faces, part.color)


def _shape(part: Part, origin_m: Array) -> Shape:
    points = (part.vertices_m - origin_m).round(5)
    return Shape(
        kind="mesh",
        color=tuple(part.color),
        collides=False,
        vertices_m=tuple((float(x), float(y), float(z)) for x, y, z in points),
        triangles=tuple((int(a), int(b), int(c)) for a, b, c in part.faces),
    )
