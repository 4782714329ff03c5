"""T1 and T2: a kitchen with a shut refrigerator, and something on a table that belongs into it."""

from __future__ import annotations

from executor.scenes.long_horizon.furniture import NEAR_EDGE, clutter, finish, furnish, one_of
from executor.scenes.rooms import Edge, NoRoom, Room, Units, place
from executor.scenes.rooms.graspable import draw_graspable
from executor.scenes.rooms.tops import regions_of
from oag import SceneObject

MODELS = (
    "upright_one_door",
    "fridge_one_door",
    "fridge_top_freezer",
    "fridge_freezer_drawer",
    "fridge_side_by_side",
)
FRONT_M = 1.05
"""Free floor in front of the refrigerator, for its door and who opens it."""

# The door of this model turns about the body's edge and reaches beside the body.
_HINGE_GAP_M = {"upright_one_door": 0.06}
_STOCK = ("can", "bottle", "carton", "medicine_bottle", "orange")


def glass_kitchen(room: Room) -> None:
    """Lays out T1: the thing on the table is a water glass.

    Raises:
        NoRoom: Something does not fit; so does the other layout.
    """
    _kitchen(room, draw_graspable(room, "tumbler", "glass_0"), leave_out=("mug", "cup"))


def apple_kitchen(room: Room) -> None:
    """Lays out T2: the thing on the table is an apple, or half of one."""
    _kitchen(room, draw_graspable(room, one_of(room, "red_apple", "half_apple"), "apple_0"), leave_out=("red_apple",))


def _kitchen(room: Room, target: SceneObject, leave_out: tuple[str, ...]) -> None:
    units = Units.drawn(room)
    fridge, hinge = _refrigerator(room)
    gap_m = _HINGE_GAP_M.get(fridge.model, 0.0)
    table = furnish(room, units, fridge, hinge=hinge, front_m=FRONT_M, hinge_gap_m=gap_m)
    place(room, target, table.table_id, at=Edge(one_of(room, *table.edges), table.inset_m), clear=NEAR_EDGE)
    clutter(room, table.table_id, target.id, int(room.rng.integers(2, 7)), leave_out)
    _stock(room, fridge)
    finish(room, leave_out)


def _refrigerator(room: Room) -> tuple[SceneObject, str]:
    """A refrigerator and the side of its hinge; of two doors the larger one, on the right, is the one to open."""
    model, hinge = one_of(room, *MODELS), one_of(room, "left", "right")
    if model == "fridge_side_by_side":
        return room.draw(model, "refrigerator_0"), "right"
    parameters: dict[str, object] = {"hinge": hinge}
    if model == "upright_one_door":
        low, high = float(room.rng.uniform(0.38, 0.46)), float(room.rng.uniform(0.68, 0.78))
        parameters["shelf_heights_m"] = [round(low, 3), round(high, 3)]
    return room.draw(model, "refrigerator_0", parameters=parameters), hinge


def _stock(room: Room, fridge: SceneObject) -> None:
    """Puts up to three things at the back of the refrigerator's shelves, the front left free."""
    shelves = [space.name for space in regions_of(fridge) if space.joint == regions_of(fridge)[0].joint]
    for _ in range(int(room.rng.integers(0, 4))):
        thing = room.draw(one_of(room, *_STOCK))
        try:
            place(room, thing, fridge.id, region=one_of(room, *shelves), at=Edge("+x", (0.06, 0.11)))
        except NoRoom:
            continue
