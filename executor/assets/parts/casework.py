"""Cupboards of every kind: a carcass of boards, divided into columns and rows, each row closed by a door or drawer.

Refrigerators, cabinets, wardrobes, desks, ovens and shelves are layouts of this, with what carries and covers them.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise

from executor.assets.model import Asset, Link, Region, Shape
from executor.assets.parts.fronts import Moving, front
from executor.assets.parts.layout import SEAM_M, Case, Opening
from executor.assets.parts.shapes import Color, box, surface

_SHELF_M = 0.014
_CLEARANCE_M = 0.001
_KICK_M = 0.050
_INSET_M = 0.010
_LEG_M = 0.040
_DARK = (0.07, 0.07, 0.08)
_STONE = (0.74, 0.72, 0.68)


def assemble(
    case: Case, category: str, synset: str, *, extra: Sequence[Shape], surfaces: Sequence[Region] = ()
) -> Asset:
    """Returns the asset: boards, doors and drawers, and a region for every place inside.

    Handles and regions of the larger doors come first.

    Args:
        case: Layout and dimensions.
        category: The asset's category.
        synset: BEHAVIOR's name of it.
        extra: Further shapes of the body, such as a plinth or a countertop.
        surfaces: Regions of the body besides those of the compartments, such as a countertop's.
    """
    boards: list[Shape] = list(_carcass(case))
    moving: list[tuple[float, Moving]] = []
    inside: list[tuple[float, Region]] = []
    for opening in _openings(case):
        part, drawer = front(case, opening), opening.row.closing == "drawer"
        size = (opening.y[1] - opening.y[0]) * (opening.z[1] - opening.z[0])
        rank = -size + (100.0 if drawer else 0.0)
        if part is not None:
            moving.append((rank, part))
            inside += [(rank, region) for region in part.regions]
        if not drawer:
            shelves, regions = _shelves(case, opening, None if part is None else part.joint.name)
            boards += shelves
            inside += [(rank, region) for region in regions]
    parts = [part for _, part in sorted(moving, key=lambda pair: pair[0])]
    return Asset(
        category=category,
        motion="articulated" if parts else "static",
        links=(Link("body", (*boards, *extra)), *(part.link for part in parts)),
        extent_m=case.extent_m,
        joints=tuple(part.joint for part in parts),
        handles=tuple(part.handle for part in parts),
        regions=(*(region for _, region in sorted(inside, key=lambda pair: pair[0])), *surfaces),
        synset=synset,
    )


def plinth(case: Case) -> Shape:
    """Returns a dark base that stands back from the doors, as a kick space does."""
    (x0, x1), (bottom, _), y, floor = case.x, case.z, case.extent_m[1] / 2, -case.extent_m[2] / 2
    return box((x0 + _KICK_M, -y + _INSET_M, floor), (x1 - _INSET_M, y - _INSET_M, bottom), _DARK)


def legs(case: Case, color: Color) -> list[Shape]:
    """Returns four legs under the corners."""
    (x0, x1), (bottom, _), y, floor = case.x, case.z, case.extent_m[1] / 2, -case.extent_m[2] / 2
    return [
        box((x, side, floor), (x + _LEG_M, side + _LEG_M, bottom), color)
        for x in (x0 + _INSET_M, x1 - _INSET_M - _LEG_M)
        for side in (-y + _INSET_M, y - _INSET_M - _LEG_M)
    ]


def slab(case: Case, overhang_m: float, color: Color = _STONE) -> Shape:
    """Returns what lies on the carcass: a board of `case.top_m` that reaches over the front."""
    (x0, x1), (_, top), y, high = case.x, case.z, case.extent_m[1] / 2, case.extent_m[2] / 2
    return box((x0 - overhang_m, -y, top), (x1, y, high), color)


def top_of(case: Case, overhang_m: float = 0.0) -> Region:
    """Returns the place on the cupboard's top."""
    (x0, x1), y, high = case.x, case.extent_m[1] / 2, case.extent_m[2] / 2
    return surface("body", (x1 - x0 + overhang_m) / 2, y, high, x_m=(x0 - overhang_m + x1) / 2)


def _carcass(case: Case) -> Iterator[Shape]:
    """Sides, back, top and bottom; partitions and decks come from the layout."""
    (x0, x1), (z0, z1), y, t = case.x, case.z, case.extent_m[1] / 2, case.wall_m
    yield box((x0, -y, z0), (x1, -y + t, z1), case.body)
    yield box((x0, y - t, z0), (x1, y, z1), case.body)
    yield box((x1 - t, -y + t, z0), (x1, y - t, z1), case.body)
    yield box((x0, -y + t, z1 - t), (x1 - t, y - t, z1), case.body)
    yield box((x0, -y + t, z0), (x1 - t, y - t, z0 + t), case.body)
    edges = _edges([column.share for column in case.columns], y, -y)
    for edge in edges[1:-1]:
        yield box((x0, edge - t / 2, z0 + t), (x1 - t, edge + t / 2, z1 - t), case.body)
    for index, column in enumerate(case.columns):
        high, low = _clear(edges, index, t)
        for level in _edges([row.share for row in column.rows], z0, z1)[1:-1]:
            yield box((x0, low, level - t / 2), (x1 - t, high, level + t / 2), case.body)


def _openings(case: Case) -> Iterator[Opening]:
    (x0, x1), (z0, z1), y, t = case.x, case.z, case.extent_m[1] / 2, case.wall_m
    edges = _edges([column.share for column in case.columns], y, -y)
    last = len(case.columns) - 1
    for index, column in enumerate(case.columns):
        high, low = _clear(edges, index, t)
        levels = _edges([row.share for row in column.rows], z0, z1)
        for place, row in enumerate(column.rows):
            yield Opening(
                row=row,
                x=(x0, x1 - t),
                y=(low, high),
                z=_clear(levels, place, t),
                panel_y=(edges[index + 1] + SEAM_M, edges[index] - SEAM_M),
                panel_z=(levels[place] + SEAM_M, levels[place + 1] - SEAM_M),
                beside_hinge=(row.closing == "left" and index > 0) or (row.closing == "right" and index < last),
            )


def _shelves(case: Case, opening: Opening, joint: str | None) -> tuple[list[Shape], list[Region]]:
    """Shelves of one compartment and the places on its floor and on them, from the bottom up."""
    (x0, x1), (y0, y1), (z0, z1), row = opening.x, opening.y, opening.z, opening.row
    tops = [z0 + (z1 - z0) * (index + 1) / (row.shelves + 1) for index in range(row.shelves)]
    front_x, c = x0 + case.shelf_setback_m, _CLEARANCE_M
    boards = [box((front_x, y0 + c, top - _SHELF_M), (x1 - c, y1 - c, top), case.inner) for top in tops]
    floors, ceilings = [z0, *tops], [*(top - _SHELF_M for top in tops), z1]
    regions = []
    for index, (floor, ceiling) in enumerate(zip(floors, ceilings, strict=True)):
        start = x0 if index == 0 else front_x
        center = ((start + x1) / 2, (y0 + y1) / 2, (floor + ceiling) / 2)
        half = ((x1 - start) / 2, (y1 - y0) / 2, (ceiling - floor) / 2)
        name = f"{row.name}_shelf_{index}" if index else f"{row.name}_bottom"
        kind = case.niche if joint is None else "interior"
        regions.append(Region(name, kind, "body", center, half, (-1.0, 0.0, 0.0), joint))
    return boards, regions


def _edges(shares: Sequence[float], start: float, end: float) -> list[float]:
    """Boundaries that divide a length by shares, both ends included."""
    total, edges = sum(shares), [start]
    for share in shares:
        edges.append(edges[-1] + (end - start) * share / total)
    edges[-1] = end
    return edges


def _clear(edges: Sequence[float], index: int, wall: float) -> tuple[float, float]:
    """What is clear between the boards at two neighbouring boundaries; outer boards lie inside their boundary."""
    start, end = list(pairwise(edges))[index]
    inward = 1.0 if end > start else -1.0
    first = wall if index == 0 else wall / 2
    second = wall if index == len(edges) - 2 else wall / 2
    return start + inward * first, end - inward * second
