"""The rules that drop what changes nothing.

Source: docs/canonical.md, Rules.
"""

from __future__ import annotations

from collections.abc import Sequence

import bddl
from oag.normal_form.join import join_movement
from oag.normal_form.rewrite import Rewrite
from oag.normal_form.survey import Place


def drop_done(places: Sequence[Place], index: int) -> Rewrite | None:
    """Drops a subtask that finds its goal reached and changes nothing."""
    place = places[index]
    if not place.idle or place.relied_on or _is_awaited(places, index):
        return None
    following = places[index + 1] if index + 1 < len(places) else None
    if following is not None and not following.afresh and (index == 0 or not place.stays):
        return None
    if place.only_moves:
        if _belongs_to_previous(places, index):
            return None
        if not set((*place.open_init, *place.open_goal)) <= set(_asked_next(places, index)):
            return None
    elif place.open_goal or (place.open_init and not place.repeats):
        return None
    return Rewrite("drop", index, 1, ())


def drop_done_pair(places: Sequence[Place], index: int) -> Rewrite | None:
    """Drops a repeated picking up and putting down that brings everything back to where it was."""
    if not places[index].pair_idle or _is_awaited(places, index):
        return None
    if index + 2 < len(places) and not places[index + 2].afresh:
        return None
    return Rewrite("drop", index, 2, ())


def _is_awaited(places: Sequence[Place], index: int) -> bool:
    """True when a subtask is to take over the moves of a neighbour first, or to be taken over by one."""
    place = places[index]
    if join_movement(places, index) is not None and (place.only_moves or places[index + 1].only_moves):
        return True
    if index == 0:
        return False
    for previous in reversed(places[:index]):
        if not _drives(previous):
            break
        if previous.open_init or previous.open_goal:
            return True
    return (_drives(places[index - 1]) or place.only_moves) and join_movement(places, index - 1) is not None


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
