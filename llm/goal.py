"""The task goal G of a request: what must hold at the end, read off the wishes and the scene.

Source: the paper's Semantic Expansion; G is a departure (docs/proposition.md).
"""

from __future__ import annotations

import bddl
from llm.doors import doors_in_the_way
from llm.intent import IntentKind
from llm.request import Request
from llm.surroundings import Surroundings


def goal_of(request: Request, around: Surroundings) -> bddl.Formula:
    """Returns the task goal G: where things shall be, and how doors shall be.

    A later wish about the same object's place, or the same door, takes the place of an earlier one. A door that a
    placing needs open and that no wish opened is closed again. After picking something up at the end the hand is not
    free to close a door, so the goal does not ask for it. What was open is left as it was found.
    """
    places: dict[str, bddl.Formula] = {}
    doors: dict[str, bddl.Formula] = {}
    state = around
    for intent in request.intents:
        if intent.kind.is_about_a_door:
            doors[intent.target] = intent.wish
        else:
            places.pop(intent.target, None)
            places[intent.target] = intent.wish
            for door in () if state.fulfils(intent) else doors_in_the_way(intent, state):
                doors.pop(door, None)
                if intent.kind is IntentKind.PLACE:
                    doors[door] = bddl.Not(bddl.Atom("open", (door,)))
        state = state.after(intent)
    wanted = (*places.values(), *doors.values())
    return wanted[0] if len(wanted) == 1 else bddl.And(wanted)
