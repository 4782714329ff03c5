"""T3 and T4: a kitchen with a row of cabinets and a table, and something that goes from one to the other."""

from __future__ import annotations

from executor.scenes.long_horizon.furniture import (
    chance,
    clutter,
    flanked,
    front_floor,
    on_units,
    one_of,
    side_units,
    stand_table,
)
from executor.scenes.rooms import Room, Units, build_walls, place, stand_robot
from executor.scenes.rooms.graspable import draw_graspable
from executor.scenes.rooms.units import CABINETS
from oag import SceneObject

FRONT_M = 0.85
"""Free floor in front of the cabinet, for who takes something from it."""

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
    table_id, edges, inset_m, round_table = _furnish(room)
    bowl_inset_m = _ROUND_BOWL_INSET_M if round_table else _BOWL_INSET_M
    arrangement = one_of(room, "apple on cabinet", "apple on cabinet", "bowl on cabinet", "both on table")
    bowl_at, apple_at = (
        "cabinet_0" if arrangement == "bowl on cabinet" else table_id,
        "cabinet_0" if arrangement == "apple on cabinet" else table_id,
    )
    edge = one_of(room, *edges)
    place(
        room,
        bowl,
        bowl_at,
        edge="-x" if bowl_at == "cabinet_0" else edge,
        inset_m=_BOWL_INSET_M if bowl_at == "cabinet_0" else bowl_inset_m,
        edge_m=0.01,
    )
    place(
        room,
        apple,
        apple_at,
        edge="-x" if apple_at == "cabinet_0" else edge,
        inset_m=_INSET_M if apple_at == "cabinet_0" else inset_m,
        edge_m=0.01,
        clear_m=0.08,
    )
    leave_out = ("red_apple", "plate")
    clutter(room, apple_at, apple.id, int(room.rng.integers(1, 4)), leave_out)
    clutter(room, bowl_at, bowl.id, int(room.rng.integers(1, 4)), leave_out)
    on_units(room, leave_out)
    build_walls(room)
    stand_robot(room)


def cup_kitchen(room: Room) -> None:
    """Lays out T4: a glass or a cup stands on the cabinet."""
    glass = chance(room, 0.5)
    cup = draw_graspable(room, "tumbler", "glass_0") if glass else draw_graspable(room, "cup", "cup_0")
    table_id, _, _, _ = _furnish(room)
    place(room, cup, "cabinet_0", edge="-x", inset_m=_INSET_M, edge_m=0.01)
    leave_out = ("mug", "cup")
    clutter(room, "cabinet_0", cup.id, int(room.rng.integers(1, 4)), leave_out)
    clutter(room, table_id, None, int(room.rng.integers(1, 4)), leave_out)
    on_units(room, leave_out)
    build_walls(room)
    stand_robot(room)


def _furnish(room: Room) -> tuple[str, tuple[str, ...], tuple[float, float], bool]:
    """Stands the cabinet, its neighbours and the table; returns the table, its free edges, and whether it is round."""
    units = Units.drawn(room)
    cabinet: SceneObject = units.draw(room, one_of(room, *CABINETS), "cabinet_0")
    flanked(room, units, cabinet, "left", 0.0)
    keep_free = front_floor(room, cabinet.id, "left", FRONT_M)
    if chance(room, 0.5):
        side_units(room, units, keep_free)
    table = stand_table(room, keep_free)
    return table.table_id, table.edges, table.inset_m, room.objects[table.table_id].model == "table_round"
