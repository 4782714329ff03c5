"""Things that fit between the fingers, as they are drawn or once their size is adjusted."""

from __future__ import annotations

from collections.abc import Mapping

from executor.scenes.rooms.room import Room
from oag import SceneObject

BETWEEN_M = (0.052, 0.0601)
"""Widths that no named item has: module 4 would make them fit by a hair. The rooms of all seeds are drawn without."""

_REDRAWS = 30


def draw_graspable(
    room: Room,
    model: str,
    object_id: str | None = None,
    *,
    extent_m: Mapping[str, float] | None = None,
    parameters: Mapping[str, object] | None = None,
) -> SceneObject:
    """Returns a variation of a model that the hand can close around, not yet placed; furniture is as it is drawn.

    Args:
        room, model, object_id, extent_m, parameters: As for `Room.draw`.
    """
    drawn = room.draw(model, object_id, extent_m=extent_m, parameters=parameters)
    for _ in range(_REDRAWS):
        if drawn.role == "A" or not BETWEEN_M[0] < min(drawn.bbox_extent[:2]) < BETWEEN_M[1]:
            break
        drawn = room.draw(model, drawn.id, extent_m=extent_m, parameters=parameters)
    return drawn
