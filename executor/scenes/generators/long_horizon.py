"""The paper's four long-horizon tasks, each in a kitchen drawn from a seed.

    pair = draw("T2", seed=12000)
    executor.rollout(oag.compose(pair.task, scene=pair.scene), pair.scene, seed=12000, vary=False)

| family | query | drawn |
| --- | --- | --- |
| T1 | put the glass into the refrigerator | refrigerator, its neighbours, table, clutter, shelves in use, robot |
| T2 | put the apple into the refrigerator | the same, with a whole apple or half of one |
| T3 | put the apple into the bowl | cabinets, table, which of them has the apple and which the bowl, clutter, robot |
| T4 | put the cup on the table | cabinets, table, a cup or a glass on a cabinet, clutter on both, robot |

The kitchens share rows of units, a table with free floor around it, and clutter.

Source: the paper's long-horizon tasks (its Section 4.2 and appendix); the ranges are ours (docs/scenes.md).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np

import llm
from executor.assets.footprint import Footprint
from executor.assets.library import asset_for
from executor.geometry import rotation_z
from executor.scenes.pair import UNCHANGED, LayoutChanges, ScenePair, draw_first_valid
from executor.scenes.placement import (
    AtEdge,
    Clearance,
    NextTo,
    PlaceSpec,
    first_free,
    place,
    scatter,
    stand_robot,
)
from executor.scenes.room import CABINETS, UNITS, NoRoom, Room, Units, against, build_walls, row, row_length_m
from oag import SceneObject
from oag.model.scene import FULL_SCALE, PAPER_SCALE
from oag.sizes import Sizing

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
"""Gap between units [m]; a door as wide as its body would otherwise rub along its neighbour."""

PASSAGES_M = (0.50, 0.80)
"""Free floor between the table and the rows of units: in the narrowest aisles the robot, 0.34 m wide, just drives."""

TIGHT = 0.25
"""Share of kitchens in which the table stands in front of the piece and obstructs the robot or the door."""

TIGHT_FRONTS_M = (0.60, 0.95)
"""Range of the free floor between table and piece in tight kitchens [m]; a door is 0.55 to 0.70 m wide."""

TIGHT_LATERAL_M = 0.45  # Most lateral offset of the table's centre from the piece's centre [m].

INSET_M = (0.08, 0.16)  # [m] Near enough for a hand that reaches in over that edge.
NEAR_EDGE = Clearance(edge_m=0.01)
"""Clearance of a target, which may stand nearer to an edge than clutter."""

# The place on a round table is the square inside its edge, so that things on it are farther from the edge already.
_ROUND_INSET_M = (0.02, 0.08)


@dataclass(frozen=True, slots=True)
class Table:
    """A table placed in the room.

    Attributes:
        table_id: Its id.
        edges: Accessible edges of its top, in its own frame.
        inset_m: Range of the distance of targets from such an edge.
    """

    table_id: str
    edges: tuple[str, ...]
    inset_m: tuple[float, float]


def chance(room: Room, probability: float) -> bool:
    """Return True with a probability."""
    return bool(room.rng.uniform() < probability)


def one_of(room: Room, *options: str) -> str:
    """Draw one of the options."""
    return options[int(room.rng.integers(len(options)))]


def furnish(
    room: Room, units: Units, middle: SceneObject, *, hinge: str, front_m: float, hinge_gap_m: float = 0.0
) -> Table:
    """Place the row with the task's piece, possibly units along a side wall, and the table.

    Args:
        middle: The piece, not yet placed; it stands at the east wall.
        hinge: Side of its hinge, "left" or "right".
        front_m: Free floor in front of it, except in tight kitchens.
        hinge_gap_m: Least gap that its door needs on that side.

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
    """Place a table in front of a piece at the east wall, so that the robot must work between the two."""
    table = _drawn_table(room)
    mine = Footprint.of(piece)
    behind_m = float(mine.corners_m[:, 0].min()) - gap_m - table.extent_m[0] + room.depth_m / 2
    span = room.width_m / 2 - table.extent_m[1] / 2
    offset_m = float(room.rng.uniform(-TIGHT_LATERAL_M, TIGHT_LATERAL_M))
    along = float(np.clip(mine.y_m + offset_m, -span, span))
    # Move it against the wall behind it if the gap is narrow: things behind it would be unreachable.
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
    """Place a table on one of three sides of the room, against that wall or free before it, clear of reserved floor."""
    side = one_of(room, *SIDES)
    table = _drawn_table(room)
    free = chance(room, 0.4)
    passage_m = float(room.rng.uniform(*PASSAGES_M))
    span = (room.width_m if side == "west" else room.depth_m) / 2 - table.extent_m[1] / 2

    nowhere = f"found no place at the {side} side of {room.name}"

    def drawn() -> Iterator[tuple[float, float, float]]:
        for _ in range(_TABLE_TRIES):
            along = float(room.rng.uniform(-span, span))
            away = float(room.rng.uniform(0.55, 0.8)) if free else 0.01
            yield along, away, float(room.rng.uniform(-0.25, 0.25)) if free else 0.0

    def objection(pose: tuple[float, float, float]) -> str | None:
        along, away, turn = pose
        try:
            against(room, side, table, along, behind_m=away, turn_rad=turn)
        except NoRoom:
            return nowhere
        mine = Footprint.of(room.objects[table.id])
        has_passage = room.blocker(table.id, mine, passage_m) is None
        if room.has_inside(mine) and mine.gap_m(keep_free) >= 0.0 and has_passage:
            return None
        del room.objects[table.id]
        return nowhere

    first_free(table.id, drawn(), objection)
    edges = ("-x", "+x", "-y", "+y") if free else ("-x",)
    return Table(table.id, edges, _ROUND_INSET_M if table.model == "table_round" else INSET_M)


def _flanked(room: Room, units: Units, middle: SceneObject, hinge: str, hinge_gap_m: float) -> None:
    """Place a piece at the east wall, alone or with units on one side or both, flush or with gaps."""
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
    """Place one or two units along a side wall, if the room has the floor for them."""
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
    """Put things on a support: some next to the target, the rest anywhere on it.

    Args:
        target: Id of the target; None without one.
        leave_out: Models that would make the query ambiguous.
    """
    models = [model for model in PANTRY if model not in leave_out]
    near_count = 0 if target is None else int(room.rng.integers(1, max(count, 1) + 1))
    placed: tuple[str, ...] = ()
    if target is not None:
        near, clear = NextTo(target, (0.05, 0.16)), Clearance(other_m=0.035)
        placed = scatter(room, models, PlaceSpec(support, next_to=near, clear=clear), near_count)
    used = {room.objects[name].model for name in placed}
    scatter(
        room,
        [m for m in models if m not in used],
        PlaceSpec(support, clear=Clearance(other_m=0.05)),
        count - len(placed),
    )


def _front_floor(room: Room, object_id: str, hinge: str, reach_m: float) -> Footprint:
    """Return the floor that opening a door at the east wall needs: in front of it, and beyond the hinge.

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
    """Put things on bare units, build the walls, and place the robot.

    Args:
        room: The room, with everything that the task is about.
        leave_out: Models that would make the query ambiguous.
    """
    _on_units(room, leave_out)
    build_walls(room)
    stand_robot(room)


def _on_units(room: Room, leave_out: tuple[str, ...]) -> None:
    supports = {support for name in room.objects for support in room.holders(name)}
    bare = [obj.id for obj in room.objects.values() if obj.model in UNITS and obj.id not in supports]
    for unit in bare:
        what = one_of(room, "nothing", "things", "things", "microwave")
        if what == "microwave":
            try:
                place(
                    room,
                    room.draw("microwave_side_hinge"),
                    PlaceSpec(unit, at=AtEdge("+x", (0.27, 0.30)), yaw_rad=0.0),
                )
            except NoRoom:
                continue
        elif what == "things":
            clutter(room, unit, None, int(room.rng.integers(1, 4)), leave_out)


QUERIES: Mapping[str, str] = MappingProxyType(
    {
        "T1": "put the glass into the refrigerator",
        "T2": "put the apple into the refrigerator",
        "T3": "put the apple into the bowl",
        "T4": "put the cup on the table",
    }
)
FAMILIES = tuple(QUERIES)
_TABLE_TRIES = 40
_TRIES = 60  # Of 100 seeds none needed more than four.
_DEPTH_M, _WIDTH_M = (3.0, 3.6), (3.4, 4.2)

REFRIGERATORS = (
    "upright_one_door",
    "fridge_one_door",
    "fridge_top_freezer",
    "fridge_freezer_drawer",
    "fridge_side_by_side",
)
FRIDGE_FRONT_M = 1.05
"""Free floor in front of the refrigerator, for its door and the robot."""

# The door of this model turns about the body's edge and reaches beside the body.
_HINGE_GAP_M = {"upright_one_door": 0.06}
_STOCK = ("can", "bottle", "carton", "medicine_bottle", "orange")

CABINET_FRONT_M = 0.85
"""Free floor in front of the cabinet, for the robot."""

_CABINET = "cabinet_0"
_BOWL_INSET_M = (0.11, 0.18)
_ROUND_BOWL_INSET_M = (0.09, 0.12)


def draw(
    family: str, seed: int, *, keep_sizes: bool = False, full_size: bool = False, changes: LayoutChanges = UNCHANGED
) -> ScenePair:
    """Draw the scene and the task of a seed; equal seeds give equal pairs.

    A layout in which something does not fit, or that fails in physics, is drawn again from the same seed. The robot's
    abilities do not influence this.

    Args:
        family: "T1", "T2", "T3" or "T4".
        seed: Any integer from 0.
        keep_sizes, full_size, changes: As for `executor.scenes.generators.families.pair_of`.

    Raises:
        ValueError: There is no such family.
        NotDrawn: No layout held after many tries, for example because a target never fits at its own size.
    """
    if family not in QUERIES:
        raise ValueError(f"there is no family {family!r}; the long-horizon families are {', '.join(FAMILIES)}")

    def layout(attempt: int) -> Room:
        rng = np.random.default_rng([seed, FAMILIES.index(family), attempt])
        name, draw_perturbation = f"{family.lower()}_{seed:06d}", changes.draw_perturbation(attempt)
        room = Room(
            name, "kitchen", rng, float(rng.uniform(*_DEPTH_M)), float(rng.uniform(*_WIDTH_M)), draw_perturbation
        )
        _LAYOUTS[family](room)
        return room

    sizing = Sizing(seed, keep_sizes)
    return draw_first_valid(
        f"{family}-{seed:06d}",
        family,
        QUERIES[family],
        layout,
        most_tries=_TRIES,
        plan=lambda query, scene: llm.propose(query, scene, sizing=sizing).task,
        robot_scale=FULL_SCALE if full_size else PAPER_SCALE,
        changes=changes,
    )


def _glass_kitchen(room: Room) -> None:
    """Lays out T1: the thing on the table is a water glass."""
    glass = room.draw("tumbler", "glass_0", target=True)
    _refrigerator_kitchen(room, glass, leave_out=("mug", "cup"))


def _apple_kitchen(room: Room) -> None:
    """Lays out T2: the thing on the table is an apple, or half of one."""
    apple = room.draw(one_of(room, "red_apple", "half_apple"), "apple_0", target=True)
    _refrigerator_kitchen(room, apple, leave_out=("red_apple",))


def _refrigerator_kitchen(room: Room, target: SceneObject, leave_out: tuple[str, ...]) -> None:
    units = Units.drawn(room)
    fridge, hinge = _refrigerator(room)
    gap_m = _HINGE_GAP_M.get(fridge.model, 0.0)
    table = furnish(room, units, fridge, hinge=hinge, front_m=FRIDGE_FRONT_M, hinge_gap_m=gap_m)
    place(
        room,
        target,
        PlaceSpec(table.table_id, at=AtEdge(one_of(room, *table.edges), table.inset_m), clear=NEAR_EDGE),
    )
    clutter(room, table.table_id, target.id, int(room.rng.integers(2, 7)), leave_out)
    _stock(room, fridge)
    finish(room, leave_out)


def _refrigerator(room: Room) -> tuple[SceneObject, str]:
    """Draw a refrigerator and its hinge side; of two doors the larger one, on the right, is the one to open."""
    model, hinge = one_of(room, *REFRIGERATORS), one_of(room, "left", "right")
    if model == "fridge_side_by_side":
        return room.draw(model, "refrigerator_0", target=True), "right"
    parameters: dict[str, object] = {"hinge": hinge}
    if model == "upright_one_door":
        low, high = float(room.rng.uniform(0.38, 0.46)), float(room.rng.uniform(0.68, 0.78))
        parameters["shelf_heights_m"] = [round(low, 3), round(high, 3)]
    return room.draw(model, "refrigerator_0", parameters=parameters, target=True), hinge


def _stock(room: Room, fridge: SceneObject) -> None:
    """Put up to three things at the back of the refrigerator's shelves, the front left free."""
    regions = asset_for(fridge).regions
    shelves = [space.name for space in regions if space.joint == regions[0].joint]
    for _ in range(int(room.rng.integers(0, 4))):
        thing = room.draw(one_of(room, *_STOCK))
        try:
            place(room, thing, PlaceSpec(fridge.id, region=one_of(room, *shelves), at=AtEdge("+x", (0.06, 0.11))))
        except NoRoom:
            continue


def _bowl_kitchen(room: Room) -> None:
    """Lays out T3: an apple and a bowl, one on the cabinet and one on the table, or both on the table."""
    apple = room.draw(one_of(room, "red_apple", "half_apple"), "apple_0", target=True)
    bowl = room.draw("porcelain_bowl", "bowl_0")
    table = _cabinet_kitchen(room)
    bowl_inset_m = _ROUND_BOWL_INSET_M if room.objects[table.table_id].model == "table_round" else _BOWL_INSET_M
    arrangement = one_of(room, "apple on cabinet", "apple on cabinet", "bowl on cabinet", "both on table")
    side = one_of(room, *table.edges)
    bowl_at, bowl_edge = table.table_id, AtEdge(side, bowl_inset_m)
    apple_at, apple_edge = table.table_id, AtEdge(side, table.inset_m)
    if arrangement == "bowl on cabinet":
        bowl_at, bowl_edge = _CABINET, AtEdge("-x", _BOWL_INSET_M)
    elif arrangement == "apple on cabinet":
        apple_at, apple_edge = _CABINET, AtEdge("-x", INSET_M)
    place(room, bowl, PlaceSpec(bowl_at, at=bowl_edge, clear=NEAR_EDGE))
    place(room, apple, PlaceSpec(apple_at, at=apple_edge, clear=Clearance(NEAR_EDGE.edge_m, 0.08)))
    leave_out = ("red_apple", "plate")
    clutter(room, apple_at, apple.id, int(room.rng.integers(1, 4)), leave_out)
    clutter(room, bowl_at, bowl.id, int(room.rng.integers(1, 4)), leave_out)
    finish(room, leave_out)


def _cup_kitchen(room: Room) -> None:
    """Lays out T4: a glass or a cup stands on the cabinet."""
    model, name = ("tumbler", "glass_0") if chance(room, 0.5) else ("cup", "cup_0")
    cup = room.draw(model, name, target=True)
    table = _cabinet_kitchen(room)
    place(room, cup, PlaceSpec(_CABINET, at=AtEdge("-x", INSET_M), clear=NEAR_EDGE))
    leave_out = ("mug", "cup")
    clutter(room, _CABINET, cup.id, int(room.rng.integers(1, 4)), leave_out)
    clutter(room, table.table_id, None, int(room.rng.integers(1, 4)), leave_out)
    finish(room, leave_out)


def _cabinet_kitchen(room: Room) -> Table:
    units = Units.drawn(room)
    cabinet = units.draw(room, one_of(room, *CABINETS), _CABINET)
    return furnish(room, units, cabinet, hinge="left", front_m=CABINET_FRONT_M)


_LAYOUTS: Mapping[str, Callable[[Room], None]] = MappingProxyType(
    {"T1": _glass_kitchen, "T2": _apple_kitchen, "T3": _bowl_kitchen, "T4": _cup_kitchen}
)
