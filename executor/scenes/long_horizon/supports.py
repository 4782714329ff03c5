"""T3 and T4: a kitchen with a row of cabinets and a table, and something that goes from one to the other."""

from __future__ import annotations

from executor.scenes.long_horizon.furniture import NEAR_EDGE, Table, chance, clutter, finish, furnish, one_of
from executor.scenes.rooms import Clearance, Edge, Room, Units, place
from executor.scenes.rooms.graspable import draw_graspable
from executor.scenes.rooms.units import CABINETS

FRONT_M = 0.85
"""Free floor in front of the cabinet, for who takes something from it."""

_CABINET = "cabinet_0"
_INSET_M = (0.08, 0.16)
_BOWL_INSET_M = (0.11, 0.18)
_ROUND_BOWL_INSET_M = (0.09, 0.12)


def bowl_kitchen(room: Room) -> None:
    """Lays out T3: an apple and a bowl, one on the cabinet and one on the table, or both on the table.

    Raises:
        NoRoom: Something does not fit; so does the other layout.
    """
    apple = draw_graspable(room, one_of(room, "red_apple", "half_apple"), "apple_0")
    bowl = room.draw("porcelain_bowl", "bowl_0")
    table = _furnish(room)
    bowl_inset_m = _ROUND_BOWL_INSET_M if room.objects[table.table_id].model == "table_round" else _BOWL_INSET_M
    arrangement = one_of(room, "apple on cabinet", "apple on cabinet", "bowl on cabinet", "both on table")
    side = one_of(room, *table.edges)
    bowl_at, bowl_edge = table.table_id, Edge(side, bowl_inset_m)
    apple_at, apple_edge = table.table_id, Edge(side, table.inset_m)
    if arrangement == "bowl on cabinet":
        bowl_at, bowl_edge = _CABINET, Edge("-x", _BOWL_INSET_M)
    elif arrangement == "apple on cabinet":
        apple_at, apple_edge = _CABINET, Edge("-x", _INSET_M)
    place(room, bowl, bowl_at, at=bowl_edge, clear=NEAR_EDGE)
    place(room, apple, apple_at, at=apple_edge, clear=Clearance(NEAR_EDGE.edge_m, 0.08))
    leave_out = ("red_apple", "plate")
    clutter(room, apple_at, apple.id, int(room.rng.integers(1, 4)), leave_out)
    clutter(room, bowl_at, bowl.id, int(room.rng.integers(1, 4)), leave_out)
    finish(room, leave_out)


def cup_kitchen(room: Room) -> None:
    """Lays out T4: a glass or a cup stands on the cabinet."""
    glass = chance(room, 0.5)
    cup = draw_graspable(room, "tumbler", "glass_0") if glass else draw_graspable(room, "cup", "cup_0")
    table = _furnish(room)
    place(room, cup, _CABINET, at=Edge("-x", _INSET_M), clear=NEAR_EDGE)
    leave_out = ("mug", "cup")
    clutter(room, _CABINET, cup.id, int(room.rng.integers(1, 4)), leave_out)
    clutter(room, table.table_id, None, int(room.rng.integers(1, 4)), leave_out)
    finish(room, leave_out)


def _furnish(room: Room) -> Table:
    """Stands the cabinet, its neighbours and the table, and returns the table."""
    units = Units.drawn(room)
    cabinet = units.draw(room, one_of(room, *CABINETS), _CABINET)
    return furnish(room, units, cabinet, hinge="left", front_m=FRONT_M)
