"""The rule that drops what changes nothing.

Source: docs/canonical.md, Rules.
"""

from __future__ import annotations

from collections.abc import Sequence

import bddl
from oag.normal_form.rewrite import Rewrite
from oag.normal_form.survey import Place


def drops(places: Sequence[Place]) -> list[Rewrite]:
    """Returns what may be left out next: of what is superfluous in one part, or in parts side by side, the last.

    Without a later one, an earlier one may no longer be superfluous, when what leads back to where the robot stood is
    gone. Without an earlier one, a later one may go on with a movement. Neighbours that are a part each go together.
    """
    found: list[Rewrite] = []
    part, part_of_next, next_goes = 0, -2, False
    for index in reversed(range(len(places))):
        change = _drop_one(places, index) or _drop_pair(places, index)
        if change is not None:
            alone = _is_part(places, change)
            goes = part > part_of_next + 1 or (alone and next_goes)
            if goes:
                found.append(change)
            part_of_next, next_goes = part, goes and alone
        if places[index].begins_part:
            part += 1
    return found[::-1]


def _is_part(places: Sequence[Place], change: Rewrite) -> bool:
    """True when all that a change drops is one part of the plan, and more than a drive."""
    end = change.index + change.count
    ends = end == len(places) or places[end].begins_part
    return ends and places[change.index].begins_part and not all(map(_drives, places[change.index : end]))


def _drop_one(places: Sequence[Place], index: int) -> Rewrite | None:
    """Drops a subtask that finds its goal reached and changes nothing."""
    return Rewrite("drop", index, 1, ()) if _superfluous(places, index) else None


def _drop_pair(places: Sequence[Place], index: int) -> Rewrite | None:
    """Drops a picking up and putting down that together bring everything back to where it was."""
    if not places[index].pair_idle or _follows_a_condition(places, index) or _follows_a_condition(places, index + 1):
        return None
    if any(place.relied_on for place in places[index : index + 2]):
        return None
    if index + 2 < len(places) and not places[index + 2].afresh:
        return None
    return Rewrite("drop", index, 2, ())


def _superfluous(places: Sequence[Place], index: int) -> bool:
    """True when a subtask changes nothing and none of its neighbours needs it."""
    place = places[index]
    if not place.idle or place.relied_on or _follows_a_condition(places, index):
        return False
    if index + 1 < len(places) and not _leaves_no_trace(places, index):
        return False
    if place.only_moves:
        return _says_nothing(places, index)
    return not place.open_goal and (not place.open_init or place.repeats)


def _says_nothing(places: Sequence[Place], index: int) -> bool:
    """True when the conditions of a few moves are known to hold or asked for again, and the moves end nothing."""
    place = places[index]
    if _belongs_to_previous(places, index):
        return False
    return set((*place.open_init, *place.open_goal)) <= set(_asked_next(places, index))


def _leaves_no_trace(places: Sequence[Place], index: int) -> bool:
    """True when the robot's pose after a subtask is of no account to what follows, or the one before it."""
    return places[index + 1].afresh or (index > 0 and places[index].stays)


def _follows_a_condition(places: Sequence[Place], index: int) -> bool:
    """True when a drive right before says what is not known: it may go because this subtask asks for it too."""
    for previous in reversed(places[:index]):
        if not _drives(previous):
            break
        if previous.open_init or previous.open_goal:
            return True
    return False


def _drives(place: Place) -> bool:
    """True for a subtask that only moves the robot."""
    return place.idle and place.only_moves


def _asked_next(places: Sequence[Place], index: int) -> tuple[bddl.Formula, ...]:
    """Returns what the next subtask that does anything asks for; drives in between leave it as it is."""
    following = next((place for place in places[index + 1 :] if not _drives(place)), None)
    return () if following is None else bddl.conjuncts(following.subtask.init)


def _belongs_to_previous(places: Sequence[Place], index: int) -> bool:
    """True when a few moves end the subtask before, such as a retreat after letting go."""
    place = places[index]
    if index == 0 or not place.flow or place.afresh:
        return False
    return places[index - 1].subtask.target == place.subtask.target
