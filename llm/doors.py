"""Which doors stand in the way of a wish; modules 1 and 2 both ask, each for its own purpose."""

from __future__ import annotations

from llm.intent import Intent
from llm.surroundings import Surroundings


def doors_in_the_way(intent: Intent, around: Surroundings) -> tuple[str, ...]:
    """Returns the closed containers that have to be opened before an item can be taken or put where it is wanted.

    The order is that of opening: a container around another one comes first, and those around the item come before
    those around its destination.

    Args:
        intent: A wish to pick up or to place; for opening and closing nothing is in the way.
        around: The scene and its facts.
    """
    if intent.kind.is_about_a_door:
        return ()
    doors = [*reversed(around.shut_around(intent.target))]
    if intent.destination is not None:
        doors += reversed(around.shut_around(intent.destination))
        if intent.relation == "inside" and around.is_shut(intent.destination):
            doors.append(intent.destination)
    return tuple(dict.fromkeys(doors))
