"""The paper's four long-horizon tasks, each in a kitchen drawn from a seed.

    pair = draw("T2", seed=12000)
    executor.rollout(oag.compose(pair.task, scene=pair.scene), pair.scene, seed=12000, vary=False)

| family | query | drawn |
| --- | --- | --- |
| T1 | put the glass into the refrigerator | refrigerator, its neighbours, table, clutter, shelves in use, robot |
| T2 | put the apple into the refrigerator | the same, with a whole apple or half of one |
| T3 | put the apple into the bowl | cabinets, table, which of them has the apple and which the bowl, clutter, robot |
| T4 | put the cup on the table | cabinets, table, a cup or a glass on a cabinet, clutter on both, robot |

Source: the paper's long-horizon tasks (its Section 4.2 and appendix); the ranges are ours (docs/scenes.md).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType

import numpy as np

import llm
from executor.assets.library import asset_for
from executor.scenes.kitchens import INSET_M, NEAR_EDGE, Table, chance, clutter, finish, furnish, one_of
from executor.scenes.pair import UNCHANGED, Changes, ScenePair, first_that_holds
from executor.scenes.rooms import AtEdge, Clearance, NoRoom, Room, Units, place
from executor.scenes.rooms.room import CABINETS
from oag import SceneObject
from oag.model.scenefile import FULL_SCALE, PAPER_SCALE
from oag.task.sizes import Sizing

QUERIES: Mapping[str, str] = MappingProxyType(
    {
        "T1": "put the glass into the refrigerator",
        "T2": "put the apple into the refrigerator",
        "T3": "put the apple into the bowl",
        "T4": "put the cup on the table",
    }
)
FAMILIES = tuple(QUERIES)
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
"""Free floor in front of the refrigerator, for its door and who opens it."""

# The door of this model turns about the body's edge and reaches beside the body.
_HINGE_GAP_M = {"upright_one_door": 0.06}
_STOCK = ("can", "bottle", "carton", "medicine_bottle", "orange")

CABINET_FRONT_M = 0.85
"""Free floor in front of the cabinet, for who takes something from it."""

_CABINET = "cabinet_0"
_BOWL_INSET_M = (0.11, 0.18)
_ROUND_BOWL_INSET_M = (0.09, 0.12)


def draw(
    family: str, seed: int, *, keep_sizes: bool = False, full_size: bool = False, changes: Changes = UNCHANGED
) -> ScenePair:
    """Returns the scene and the task that a seed stands for; equal seeds give equal ones.

    A layout in which something does not fit, or that physics does not bear out, is drawn anew from the same seed.
    Nothing that the robot can or cannot do has a say in this.

    Args:
        family: "T1", "T2", "T3" or "T4".
        seed: Any integer from 0.
        keep_sizes: Whether nothing is scaled to the gripper.
        full_size: Whether the robot is of full size, not the paper's 0.7.
        changes: How it differs from what the seed alone gives.

    Raises:
        ValueError: There is no such family.
        NotDrawn: No layout held, after many tries; such as where what is asked for never fits at its own size.
    """
    if family not in QUERIES:
        raise ValueError(f"there is no family {family!r}; the long-horizon families are {', '.join(FAMILIES)}")

    def layout(attempt: int) -> Room:
        rng = np.random.default_rng([seed, FAMILIES.index(family), attempt])
        name, stray = f"{family.lower()}_{seed:06d}", changes.stray(attempt)
        room = Room(name, "kitchen", rng, float(rng.uniform(*_DEPTH_M)), float(rng.uniform(*_WIDTH_M)), stray)
        _LAYOUTS[family](room)
        return room

    sizing = Sizing(seed, keep_sizes)
    return first_that_holds(
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
    place(room, target, table.table_id, at=AtEdge(one_of(room, *table.edges), table.inset_m), clear=NEAR_EDGE)
    clutter(room, table.table_id, target.id, int(room.rng.integers(2, 7)), leave_out)
    _stock(room, fridge)
    finish(room, leave_out)


def _refrigerator(room: Room) -> tuple[SceneObject, str]:
    """A refrigerator and the side of its hinge; of two doors the larger one, on the right, is the one to open."""
    model, hinge = one_of(room, *REFRIGERATORS), one_of(room, "left", "right")
    if model == "fridge_side_by_side":
        return room.draw(model, "refrigerator_0", target=True), "right"
    parameters: dict[str, object] = {"hinge": hinge}
    if model == "upright_one_door":
        low, high = float(room.rng.uniform(0.38, 0.46)), float(room.rng.uniform(0.68, 0.78))
        parameters["shelf_heights_m"] = [round(low, 3), round(high, 3)]
    return room.draw(model, "refrigerator_0", parameters=parameters, target=True), hinge


def _stock(room: Room, fridge: SceneObject) -> None:
    """Puts up to three things at the back of the refrigerator's shelves, the front left free."""
    regions = asset_for(fridge).regions
    shelves = [space.name for space in regions if space.joint == regions[0].joint]
    for _ in range(int(room.rng.integers(0, 4))):
        thing = room.draw(one_of(room, *_STOCK))
        try:
            place(room, thing, fridge.id, region=one_of(room, *shelves), at=AtEdge("+x", (0.06, 0.11)))
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
    place(room, bowl, bowl_at, at=bowl_edge, clear=NEAR_EDGE)
    place(room, apple, apple_at, at=apple_edge, clear=Clearance(NEAR_EDGE.edge_m, 0.08))
    leave_out = ("red_apple", "plate")
    clutter(room, apple_at, apple.id, int(room.rng.integers(1, 4)), leave_out)
    clutter(room, bowl_at, bowl.id, int(room.rng.integers(1, 4)), leave_out)
    finish(room, leave_out)


def _cup_kitchen(room: Room) -> None:
    """Lays out T4: a glass or a cup stands on the cabinet."""
    model, name = ("tumbler", "glass_0") if chance(room, 0.5) else ("cup", "cup_0")
    cup = room.draw(model, name, target=True)
    table = _cabinet_kitchen(room)
    place(room, cup, _CABINET, at=AtEdge("-x", INSET_M), clear=NEAR_EDGE)
    leave_out = ("mug", "cup")
    clutter(room, _CABINET, cup.id, int(room.rng.integers(1, 4)), leave_out)
    clutter(room, table.table_id, None, int(room.rng.integers(1, 4)), leave_out)
    finish(room, leave_out)


def _cabinet_kitchen(room: Room) -> Table:
    """Stands the cabinet, its neighbours and the table, and returns the table."""
    units = Units.drawn(room)
    cabinet = units.draw(room, one_of(room, *CABINETS), _CABINET)
    return furnish(room, units, cabinet, hinge="left", front_m=CABINET_FRONT_M)


_LAYOUTS: Mapping[str, Callable[[Room], None]] = MappingProxyType(
    {"T1": _glass_kitchen, "T2": _apple_kitchen, "T3": _bowl_kitchen, "T4": _cup_kitchen}
)
