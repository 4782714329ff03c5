"""Cupboards of every kind: a carcass of boards, divided into columns and rows, each row closed by a door or drawer.

Refrigerators, cabinets, wardrobes, desks, ovens and shelves are layouts of this. The front faces -x; the object's
box ends at the handles in front and at the carcass's back.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

from executor.assets.fronts import GAP_M, SEAM_M, Closing, Color, Finish, Moving, Opening, front
from executor.assets.handles import Grip
from executor.assets.model import Asset, Link, Region, Shape, Vector
from executor.assets.shapes import box

_SHELF_M = 0.014
_DEFAULT_LIMIT_RAD = 1.9
# Doors whose hinge has another panel behind it stop square to the front.
INNER_LIMIT_RAD = 1.55
_CLEARANCE_M = 0.001


@dataclass(frozen=True, slots=True)
class Row:
    """One compartment of a column.

    Attributes:
        name: Name of the moving link, or of the niche where nothing closes it.
        closing: How it is closed.
        share: Its part of the column's height, against the sum of the column's.
        shelves: Shelves inside, at even distances.
    """

    name: str
    closing: Closing
    share: float = 1.0
    shelves: int = 0


@dataclass(frozen=True, slots=True)
class Column:
    """Compartments from the bottom up; columns go from the left (+y) of somebody who faces the front."""

    rows: tuple[Row, ...]
    share: float = 1.0


@dataclass(frozen=True, slots=True)
class Case:
    """A cupboard before it is cut into shapes.

    Attributes:
        extent_m: Whole thing, handles included.
        columns: The layout.
        base_m: Height of what carries the carcass, above the floor.
        top_m: Thickness of what lies on the carcass.
        wall_m: Thickness of the carcass's boards.
        handle_height_m: Where upright handles would best be, above the floor that it stands on.
        shelf_setback_m: How far shelves stand back from the carcass's front.
        niche: What an open compartment is: "interior", or "surface" for open shelves.
    """

    extent_m: Vector
    columns: tuple[Column, ...]
    grip: Grip
    base_m: float = 0.08
    top_m: float = 0.0
    wall_m: float = 0.018
    panel_m: float = 0.020
    density_kg_m3: float = 600.0
    handle_height_m: float = 0.72
    shelf_setback_m: float = 0.020
    door_limit_rad: float = _DEFAULT_LIMIT_RAD
    body: Color = (0.62, 0.63, 0.60)
    front: Color = (0.52, 0.57, 0.55)
    inner: Color = (0.72, 0.64, 0.52)
    window: Color | None = None
    niche: str = "interior"

    @property
    def x(self) -> tuple[float, float]:
        """The carcass's front and back planes in the root frame."""
        half = self.extent_m[0] / 2
        closed = any(row.closing != "open" for column in self.columns for row in column.rows)
        protrusion = GAP_M + self.panel_m + self.grip.protrusion_m if closed else 0.0
        return -half + protrusion, half

    @property
    def z(self) -> tuple[float, float]:
        """The carcass's bottom and top in the root frame."""
        half = self.extent_m[2] / 2
        return -half + self.base_m, half - self.top_m


def assemble(case: Case, category: str, synset: str, *, extra: Sequence[Shape], surfaces: Sequence[Region]) -> Asset:
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
    for row, opening, at_hinge in _openings(case):
        limit = INNER_LIMIT_RAD if at_hinge else case.door_limit_rad
        finish = Finish(
            case.panel_m,
            case.density_kg_m3,
            case.front,
            case.inner,
            case.handle_height_m - case.extent_m[2] / 2,
            limit,
            case.window,
        )
        part = front(row.name, row.closing, opening, finish, case.grip)
        size = (opening.y[1] - opening.y[0]) * (opening.z[1] - opening.z[0])
        rank = -size + (100.0 if row.closing == "drawer" else 0.0)
        if part is not None:
            moving.append((rank, part))
            inside += [(rank, region) for region in part.regions]
        if row.closing != "drawer":
            shelves, regions = _shelves(case, row, opening, None if part is None else part.joint.name)
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


def _carcass(case: Case) -> Iterator[Shape]:
    """Sides, bottom, top and back; partitions and decks come from the layout."""
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


def _openings(case: Case) -> Iterator[tuple[Row, Opening, bool]]:
    """Every compartment, and whether another panel lies behind its hinge."""
    (x0, x1), (z0, z1), y, t = case.x, case.z, case.extent_m[1] / 2, case.wall_m
    edges = _edges([column.share for column in case.columns], y, -y)
    last = len(case.columns) - 1
    for index, column in enumerate(case.columns):
        high, low = _clear(edges, index, t)
        levels = _edges([row.share for row in column.rows], z0, z1)
        for place, row in enumerate(column.rows):
            bottom, top = _clear(levels, place, t)
            opening = Opening(
                x=(x0, x1 - t),
                y=(low, high),
                z=(bottom, top),
                panel_y=(edges[index + 1] + SEAM_M, edges[index] - SEAM_M),
                panel_z=(levels[place] + SEAM_M, levels[place + 1] - SEAM_M),
            )
            at_hinge = (row.closing == "left" and index > 0) or (row.closing == "right" and index < last)
            yield row, opening, at_hinge


def _shelves(case: Case, row: Row, opening: Opening, joint: str | None) -> tuple[list[Shape], list[Region]]:
    """Shelves of one compartment and the places on its floor and on them, from the bottom up."""
    (x0, x1), (y0, y1), (z0, z1) = opening.x, opening.y, opening.z
    tops = [z0 + (z1 - z0) * (index + 1) / (row.shelves + 1) for index in range(row.shelves)]
    front_x, c = x0 + case.shelf_setback_m, _CLEARANCE_M
    boards = [box((front_x, y0 + c, top - _SHELF_M), (x1 - c, y1 - c, top), case.inner) for top in tops]
    floors, ceilings = [z0, *tops], [*(top - _SHELF_M for top in tops), z1]
    regions = []
    for index, (floor, ceiling) in enumerate(zip(floors, ceilings, strict=True)):
        start = x0 if index == 0 else front_x
        regions.append(
            Region(
                name=f"{row.name}_bottom" if index == 0 else f"{row.name}_shelf_{index}",
                kind="surface" if joint is None and case.niche == "surface" else "interior",
                link="body",
                center_m=((start + x1) / 2, (y0 + y1) / 2, (floor + ceiling) / 2),
                half_extents_m=((x1 - start) / 2, (y1 - y0) / 2, (ceiling - floor) / 2),
                opening=(-1.0, 0.0, 0.0),
                joint=joint,
            )
        )
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
