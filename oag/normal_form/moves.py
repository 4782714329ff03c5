"""Moves that were cut into several of one kind: one move of their sum, or, beyond what one may have, the fewest.

Source: docs/canonical.md, Rules.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import groupby

from oag.model.actions import Action, ActionFlow
from oag.model.primitives import MAX_ANGLE_DEG, MAX_DISTANCE_M, ParameterKind, Primitive, parameter_kind

_LARGEST = {ParameterKind.DISTANCE_M: MAX_DISTANCE_M, ParameterKind.ANGLE_DEG: MAX_ANGLE_DEG}
# Sums of decimal numbers are rounded to a nanometre, so that 0.1 and 0.2 make 0.3.
_DIGITS = 9


def merged_moves(flow: ActionFlow) -> ActionFlow:
    """Returns a flow in which no two moves of one kind follow each other, unless their sum is too large for one.

    Moves whose numbers are still open stay as they are.
    """
    merged: list[Action] = []
    for (primitive, summable), group in groupby(flow, key=_kind):
        actions = tuple(group)
        merged.extend(_summed(primitive, actions) if summable and len(actions) > 1 else actions)
    return tuple(merged)


def _kind(action: Action) -> tuple[Primitive, bool]:
    """Returns an action's primitive, and whether its number can be added to another."""
    summable = parameter_kind(action.primitive) in _LARGEST and isinstance(action.parameter, int | float)
    return action.primitive, summable


def _summed(primitive: Primitive, actions: Sequence[Action]) -> Iterator[Action]:
    """Yields as few moves as make the sum of some moves of one kind, the largest first."""
    largest = _LARGEST[parameter_kind(primitive)]
    numbers = (action.parameter for action in actions)
    left = round(math.fsum(number for number in numbers if isinstance(number, int | float)), _DIGITS)
    while left > largest:
        yield Action(primitive, largest)
        left = round(left - largest, _DIGITS)
    yield Action(primitive, left)
