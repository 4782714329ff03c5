"""What the kitchens of the long-horizon tasks share: rows of units, a table with room around it, and clutter."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from executor.assets.footprint import Footprint
from executor.geometry import rotation_z
from executor.scenes.rooms import (
    AtEdge,
    Beside,
    Clearance,
    NoRoom,
    Room,
    Units,
    against,
    build_walls,
    place,
    row,
    row_length_m,
    scatter,
    stand_robot,
)
from executor.scenes.rooms.room import UNITS
from oag import SceneObject

TABLES = ("table_four_legs", "table_four_legs", "table_round")
PANTRY = (
    "can",
    "bottle",
    "carton",
    "medicine_bottle",
    "book_lying",
    "plate",
    "die",
    "mug",
    "cup",
    "orange",
    "red_apple",
)
SIDES = ("north", "south", "west")
FLUSH_M = 0.005
"""What fitters leave between units: a door as wide as its body would rub along its neighbour otherwise."""

PASSAGES_M = (0.50, 0.80)
"""Free floor between the table and the rows of units: in the narrowest aisles the robot, 0.34 m wide, just drives."""

TIGHT = 0.25
"""The share of kitchens in which the table stands before the piece: in the way of whoever opens it, or of its door."""

TIGHT_FRONTS_M = (0.60, 0.95)
"""The floor between the two there: a door is 0.55 to 0.70 m wide."""

TIGHT_BESIDE_M = 0.45  # How far the middle of the table is beside that of the piece.

INSET_M = (0.08, 0.16)  # So near that a hand from that edge gets there.
NEAR_EDGE = Clearance(edge_m=0.01)
"""What is to be taken may stand nearer to an edge than clutter does."""

# The place on a round table is the square inside its edge, so that things on it are farther from the edge already.
_ROUND_INSET_M = (0.02, 0.08)


@dataclass(frozen=True, slots=True)
class Table:
    """A table that was stood in the room.

    Attributes:
        table_id: Its id.
        edges: Edges of its top, in its own frame, that one can step up to.
        inset_m: How far from such an edge things that are to be taken stand.
    """

    table_id: str
    edges: tuple[str, ...]
    inset_m: tuple[float, float]


def chance(room: Room, probability: float) -> bool:
    """Decides at random."""
    return bool(room.rng.uniform() < probability)


def one_of(room: Room, *options: str) -> str:
    """Returns one of the options."""
    return options[int(room.rng.integers(len(options)))]


def furnish(
    room: Room, units: Units, middle: SceneObject, *, hinge: str, front_m: float, hinge_gap_m: float = 0.0
) -> Table:
    """Stands the row with the piece that the task is about, perhaps units along a side wall, and the table.

    Args:
        room: The room, empty.
        units: The kitchen's units.
        middle: The piece, not yet placed; it comes to the east wall.
        hinge: Side of its hinge, "left" or "right".
        front_m: Free floor in front of it, but in the kitchens that are tight.
        hinge_gap_m: The least gap that its door needs on that side.

    Raises:
        NoRoom: Something does not fit.
    """
    _flanked(room, units, middle, hinge, hinge_gap_m)
    tight_m = float(room.rng.uniform(*TIGHT_FRONTS_M)) if chance(room, TIGHT) else None
    keep_free = _front_floor(room, middle.id, hinge, front_m if tight_m is None else tight_m)
    if chance(room, 0.5):
        _side_units(room, units, keep_free)
    return _stand_table(room, keep_free) if tight_m is None else _stand_in_front(room, room.objects[middle.id], tight_m)


def _stand_in_front(room: Room, piece: SceneObject, gap_m: float) -> Table:
    """Stands a table so far before a piece at the east wall that who opens that has to get along between the two."""
    table = _drawn_table(room)
    mine = Footprint.of(piece)
    behind_m = float(mine.corners_m[:, 0].min()) - gap_m - table.extent_m[0] + room.depth_m / 2
    span = room.width_m / 2 - table.extent_m[1] / 2
    beside_m = float(room.rng.uniform(-TIGHT_BESIDE_M, TIGHT_BESIDE_M))
    along = float(np.clip(mine.y_m + beside_m, -span, span))
    # Against the wall behind it where there is hardly a gap, so that nothing is put where nobody gets to.
    against(room, "west", table, along, behind_m=behind_m if behind_m > PASSAGES_M[0] else 0.01)
    placed = Footprint.of(room.objects[table.id])
    for other in room.objects.values():
        if other.id not in (table.id, piece.id) and placed.gap_m(Footprint.of(other)) < PASSAGES_M[0]:
            raise NoRoom(table.id, f"leaves no aisle between it and {other.id}")
    edges = ("-x", "+x", "-y", "+y") if behind_m > PASSAGES_M[0] else ("-x",)
    return Table(table.id, edges, _ROUND_INSET_M if table.model == "table_round" else INSET_M)


def _drawn_table(room: Room) -> SceneObject:
    """A table, not yet placed, its longer side along the wall."""
    table = room.draw(one_of(room, *TABLES), "table_0")
    depth_m, width_m = sorted(table.extent_m[:2])
    return replace(table, bbox_extent=(depth_m, width_m, table.extent_m[2]))


def _stand_table(room: Room, keep_free: Footprint) -> Table:
    """Stands a table on one of three sides of the room, against that wall or free before it, off what is kept free."""
    side = one_of(room, *SIDES)
    table = _drawn_table(room)
    free = chance(room, 0.4)
    passage_m = float(room.rng.uniform(*PASSAGES_M))
    for _ in range(40):
        span = (room.width_m if side == "west" else room.depth_m) / 2 - table.extent_m[1] / 2
        along = float(room.rng.uniform(-span, span))
        away = float(room.rng.uniform(0.55, 0.8)) if free else 0.01
        turn = float(room.rng.uniform(-0.25, 0.25)) if free else 0.0
        try:
            against(room, side, table, along, behind_m=away, turn_rad=turn)
        except NoRoom:
            continue
        mine = Footprint.of(room.objects[table.id])
        has_passage = room.blocker(table.id, mine, passage_m) is None
        if room.has_inside(mine) and mine.gap_m(keep_free) >= 0.0 and has_passage:
            edges = ("-x", "+x", "-y", "+y") if free else ("-x",)
            return Table(table.id, edges, _ROUND_INSET_M if table.model == "table_round" else INSET_M)
        del room.objects[table.id]
    raise NoRoom(table.id, f"found no place at the {side} side of {room.name}")


def _flanked(room: Room, units: Units, middle: SceneObject, hinge: str, hinge_gap_m: float) -> None:
    """Stands something at the east wall, alone or with units on one side or both, flush or with gaps."""
    where = one_of(room, "none", "left", "right", "both")
    sides = ("left", "right") if where == "both" else () if where == "none" else (where,)
    pieces = [middle]
    gaps: list[float] = []
    for side in sides:
        unit = units.draw(room, one_of(room, *units.models))
        flush = chance(room, 0.5)
        gap_m = FLUSH_M if flush else round(float(room.rng.uniform(0.01, 0.10)), 3)
        gap_m = max(gap_m, hinge_gap_m if side == hinge else 0.0)
        pieces = [unit, *pieces] if side == "left" else [*pieces, unit]
        gaps = [gap_m, *gaps] if side == "left" else [*gaps, gap_m]
    slack = room.width_m / 2 - row_length_m(room, pieces, gaps) / 2
    if slack < 0.0:
        raise NoRoom(middle.id, "its row is longer than the wall")
    row(room, "east", pieces, float(room.rng.uniform(-slack, slack)), gaps_m=gaps)


def _side_units(room: Room, units: Units, keep_free: Footprint) -> None:
    """Stands one or two units along a side wall, where the room has the floor for them."""
    wall = one_of(room, "north", "south")
    pieces = [units.draw(room, one_of(room, *units.models)) for _ in range(int(room.rng.integers(1, 3)))]
    slack = room.depth_m / 2 - row_length_m(room, pieces) / 2
    try:
        row(room, wall, pieces, float(room.rng.uniform(-slack, slack)) if slack > 0.0 else 0.0)
        crowded = any(Footprint.of(room.objects[piece.id]).gap_m(keep_free) < 0.0 for piece in pieces)
    except NoRoom:
        crowded = True
    if crowded:
        for piece in pieces:
            room.objects.pop(piece.id, None)


def clutter(room: Room, support: str, target: str | None, count: int, leave_out: tuple[str, ...]) -> None:
    """Puts things on a support: some beside the target, the rest anywhere on it.

    Args:
        room: The room.
        support: What they stand on.
        target: Id of the thing to stand beside; None where there is none.
        count: How many at most.
        leave_out: Models that would make the query ambiguous.
    """
    models = [model for model in PANTRY if model not in leave_out]
    beside = 0 if target is None else int(room.rng.integers(1, max(count, 1) + 1))
    placed: tuple[str, ...] = ()
    if target is not None:
        near, clear = Beside(target, (0.05, 0.16)), Clearance(other_m=0.035)
        placed = scatter(room, models, support, beside, beside=near, clear=clear)
    used = {room.objects[name].model for name in placed}
    scatter(room, [m for m in models if m not in used], support, count - len(placed), clear=Clearance(other_m=0.05))


def _front_floor(room: Room, object_id: str, hinge: str, reach_m: float) -> Footprint:
    """The floor that somebody needs who opens a door at the east wall: in front, and on beyond the hinge.

    In a corner there is none beyond the hinge, and the door opens towards the wall as far as it goes.
    """
    mine = Footprint.of(room.objects[object_id])
    side = 1.0 if hinge == "left" else -1.0
    beyond_m = 0.6 * reach_m
    x, y = rotation_z(mine.yaw_rad)[:2, :2] @ [-mine.half_x_m - reach_m / 2, side * beyond_m / 2]
    return Footprint(
        mine.x_m + float(x),
        mine.y_m + float(y),
        mine.yaw_rad,
        reach_m / 2,
        mine.half_y_m + beyond_m / 2,
    )


def finish(room: Room, leave_out: tuple[str, ...]) -> None:
    """Puts things on the units that are bare, builds the walls, and stands the robot somewhere.

    Args:
        room: The room, with everything that the task is about.
        leave_out: Models that would make the query ambiguous.
    """
    _on_units(room, leave_out)
    build_walls(room)
    stand_robot(room)


def _on_units(room: Room, leave_out: tuple[str, ...]) -> None:
    """Puts a microwave oven or a few things on units that nothing stands on yet."""
    supports = {support for name in room.objects for support in room.holders(name)}
    bare = [obj.id for obj in room.objects.values() if obj.model in UNITS and obj.id not in supports]
    for unit in bare:
        what = one_of(room, "nothing", "things", "things", "microwave")
        if what == "microwave":
            try:
                place(room, room.draw("microwave_side_hinge"), unit, at=AtEdge("+x", (0.27, 0.30)), yaw_rad=0.0)
            except NoRoom:
                continue
        elif what == "things":
            clutter(room, unit, None, int(room.rng.integers(1, 4)), leave_out)
