"""A nightstand with a drawer, and a wardrobe with two doors."""

from __future__ import annotations

from executor.assets.casework import Case, Column, Row, assemble
from executor.assets.entry import Entry, Option, Quantity, Span
from executor.assets.handles import HANDLE_PARAMETERS, Grip
from executor.assets.model import Asset
from executor.assets.parameters import require_size
from executor.assets.plinth import legs, plinth, slab, top_of
from oag import SceneObject

BELOW = Option("below", ("niche", "drawer"))
SHELVES = Quantity("shelves", 2, 1, 3, whole=True)
_OVERHANG_M = 0.015
_OAK, _OAK_FRONT, _OAK_TOP = (0.47, 0.31, 0.17), (0.55, 0.38, 0.22), (0.40, 0.25, 0.13)
_LINEN, _LINEN_FRONT = (0.66, 0.61, 0.53), (0.76, 0.72, 0.65)


def nightstand(obj: SceneObject) -> Asset:
    """Returns a nightstand: a drawer over a niche or over a second drawer.

    Raises:
        AssetError: When its size or a parameter does not make one.
    """
    extent = require_size(obj, (0.32, 0.32, 0.42))
    niche = BELOW.read(obj) == "niche"
    below = Row("niche", "open", 1.0) if niche else Row("drawer_2", "drawer", 1.0)
    case = Case(
        extent_m=extent,
        columns=(Column((below, Row("drawer", "drawer", 0.8))),),
        grip=Grip.of(obj),
        base_m=0.12,
        top_m=0.025,
        body=_OAK,
        front=_OAK_FRONT,
    )
    extra = [*legs(case, _OAK_TOP), *slab(case, _OVERHANG_M, _OAK_TOP)]
    return assemble(case, obj.category, "stand.n.04", extra=extra, surfaces=[top_of(case, _OVERHANG_M)])


def wardrobe(obj: SceneObject) -> Asset:
    """Returns a wardrobe: two doors, hinged at the outer sides, a partition between them, shelves on the right.

    Raises:
        AssetError: When its size or a parameter does not make one.
    """
    extent = require_size(obj, (0.45, 0.70, 1.20))
    columns = (
        Column((Row("left_door", "left", shelves=1),)),
        Column((Row("right_door", "right", shelves=SHELVES.count(obj)),)),
    )
    case = Case(
        extent_m=extent, columns=columns, grip=Grip.of(obj), base_m=0.07, body=_LINEN, front=_LINEN_FRONT, inner=_OAK
    )
    return assemble(case, obj.category, "wardrobe.n.01", extra=[plinth(case)], surfaces=[])


ENTRIES = (
    Entry(
        "nightstand",
        "nightstand",
        "stand.n.04",
        nightstand,
        Span(0.40, 0.50),
        Span(0.40, 0.55),
        Span(0.50, 0.62),
        (BELOW, *HANDLE_PARAMETERS),
    ),
    Entry(
        "wardrobe_two_doors",
        "wardrobe",
        "wardrobe.n.01",
        wardrobe,
        Span(0.58, 0.68),
        Span(0.85, 1.10),
        Span(1.50, 1.90),
        (SHELVES, *HANDLE_PARAMETERS),
    ),
)
