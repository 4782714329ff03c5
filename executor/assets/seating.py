"""What people lie and sit on: beds, sofas and chairs. They furnish rooms; a thing can lie on them."""

from __future__ import annotations

from executor.assets.entry import Entry, Span
from executor.assets.model import Asset, Link, Region, Shape
from executor.assets.parameters import require_size
from executor.assets.shapes import box
from oag import SceneObject

_REGION_HEIGHT_M = 0.30
_HEADBOARD_M, _ARM_M, _BACK_M, _POST_M = 0.05, 0.14, 0.16, 0.04
_FRAME, _LINEN, _BLANKET, _PILLOW = (0.36, 0.22, 0.12), (0.80, 0.79, 0.76), (0.35, 0.42, 0.50), (0.86, 0.85, 0.82)
_FABRIC, _CUSHION, _WOOD = (0.40, 0.43, 0.46), (0.47, 0.50, 0.53), (0.50, 0.33, 0.18)


def bed(obj: SceneObject) -> Asset:
    """Returns a bed: its headboard at the back (+x), a mattress with a blanket and a pillow.

    Raises:
        AssetError: When its size does not make one; so do the others of this file.
    """
    length, width, height = require_size(obj, (1.20, 0.60, 0.60))
    x, y, z = length / 2, width / 2, height / 2
    frame, lying = -z + 0.26, -z + 0.44
    head = x - _HEADBOARD_M
    shapes = (
        box((head, -y, -z), (x, y, z), _FRAME),
        box((-x, -y, -z + 0.08), (head, y, frame), _FRAME),
        box((-x + 0.06, -y + 0.06, -z), (head, y - 0.06, -z + 0.08), _FRAME),
        box((-x + 0.02, -y + 0.02, frame), (head, y - 0.02, lying), _LINEN),
        box((-x + 0.01, -y + 0.01, frame + 0.02), (head - 0.62, y - 0.01, lying + 0.004), _BLANKET, collides=False),
        box((head - 0.42, -0.32, lying), (head - 0.04, 0.32, lying + 0.08), _PILLOW),
    )
    return _seat(obj, "bed", shapes, "bed.n.01", (-x + 0.02, head - 0.44), y - 0.02, lying)


def sofa(obj: SceneObject) -> Asset:
    """Returns a sofa: a seat between two arms, before a back."""
    length, width, height = require_size(obj, (0.60, 0.90, 0.60))
    x, y, z = length / 2, width / 2, height / 2
    sitting, arm = -z + 0.42, -z + 0.58
    back = x - _BACK_M
    shapes = (
        box((-x, -y, -z), (x, -y + _ARM_M, arm), _FABRIC),
        box((-x, y - _ARM_M, -z), (x, y, arm), _FABRIC),
        box((back, -y + _ARM_M, -z), (x, y - _ARM_M, z), _FABRIC),
        box((-x + 0.02, -y + _ARM_M, -z), (back, y - _ARM_M, sitting), _CUSHION),
    )
    return _seat(obj, "sofa", shapes, "sofa.n.01", (-x + 0.02, back), y - _ARM_M, sitting)


def chair(obj: SceneObject) -> Asset:
    """Returns a chair: a seat on four legs, a back at +x."""
    length, width, height = require_size(obj, (0.30, 0.30, 0.60))
    x, y, z = length / 2, width / 2, height / 2
    sitting = -z + 0.45
    posts = [
        box((low, side, -z), (low + _POST_M, side + _POST_M, sitting - 0.03), _WOOD)
        for low in (-x, x - _POST_M)
        for side in (-y, y - _POST_M)
    ]
    seat = box((-x, -y, sitting - 0.03), (x, y, sitting), _WOOD)
    back = box((x - _POST_M, -y, sitting), (x, y, z), _WOOD)
    return _seat(obj, "chair", (*posts, seat, back), "chair.n.01", (-x, x - _POST_M), y, sitting)


def _seat(
    obj: SceneObject,
    link: str,
    shapes: tuple[Shape, ...],
    synset: str,
    along_x: tuple[float, float],
    half_y: float,
    level: float,
) -> Asset:
    low, high = along_x
    place = Region(
        name="top",
        kind="surface",
        link=link,
        center_m=((low + high) / 2, 0.0, level + _REGION_HEIGHT_M / 2),
        half_extents_m=((high - low) / 2, half_y, _REGION_HEIGHT_M / 2),
        opening=(0.0, 0.0, 1.0),
    )
    return Asset(
        category=obj.category,
        motion="static",
        links=(Link(link, shapes),),
        extent_m=obj.extent_m,
        regions=(place,),
        synset=synset,
    )


ENTRIES = (
    Entry("bed_single", "bed", "bed.n.01", bed, Span(1.90, 2.05), Span(0.90, 1.30), Span(0.80, 1.00)),
    Entry("sofa_two_seats", "sofa", "sofa.n.01", sofa, Span(0.80, 0.92), Span(1.35, 1.75), Span(0.74, 0.86)),
    Entry("chair_wooden", "chair", "chair.n.01", chair, Span(0.40, 0.46), Span(0.40, 0.45), Span(0.80, 0.92)),
)
