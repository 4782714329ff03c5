"""A handle that weak fingers lose: pulled in short steps, and taken hold of anew every few of them.

The whole way at once begins with an acceleration that such fingers do not hold; a short step never gets that far. With
each step the bar creeps a little in the fingers, so that they take hold of it again before it is out of them.
"""

from __future__ import annotations

from llm.evolution.cause import Cause
from llm.evolution.changes import Changes
from llm.evolution.joints import HOLD_AGAIN
from oag import Action, ActionFlow, Primitive

STEPS = ((0.05, 0.75), (0.03, 0.45), (0.02, 0.3))
"""Length of a step and where the last one ends, both as fractions of the range: a flow has at most 40 steps."""

STEPS_A_HOLD = 5
EARLY = 0.1
"""How far a joint comes at most before the grip is lost by pulling; farther on something else is the matter."""

UNMOVED = 0.004
"""A joint that came less far hardly followed the fingers: then only the shortest steps are worth an attempt."""


def in_steps(cause: Cause, flow: ActionFlow) -> Changes:
    """Yields flows that open a joint in short steps, the longest ones first; none where that was not the matter.

    Args:
        cause: An opening whose grip was lost, with where the joint began and where it came to.
        flow: The flow to correct; steps that it has already become other ones.
    """
    moved = followed(cause)
    if flow[cause.step].primitive is not Primitive.ARTICULATE_OPEN or cause.contact is not None or cause.stopped:
        return
    if moved is None or moved > EARLY:
        return
    openings = [step for step, action in enumerate(flow) if action.primitive is Primitive.ARTICULATE_OPEN]
    asked = flow[openings[-1]].parameter
    wanted = asked[1] if isinstance(asked, tuple) else 1.0
    for length, most in STEPS if moved >= UNMOVED else STEPS[-1:]:
        pulled = tuple(_pulled(length, min(wanted, most)))
        words = f"open in steps of {length:g} of the range, taking hold anew after every {STEPS_A_HOLD} of them"
        yield (*flow[: openings[0]], *pulled, *flow[openings[-1] + 1 :]), words


def followed(cause: Cause) -> float | None:
    """Returns how far a joint followed before its motion ended, as a fraction of its range; None if not measured."""
    return None if cause.joint is None else abs(cause.joint.fraction_reached - cause.joint.fraction_before)


def _pulled(length: float, end: float) -> list[Action]:
    actions: list[Action] = []
    count = max(round(end / length), 1)
    for number in range(1, count + 1):
        upper = end if number == count else round(number * length, 2)
        actions.append(Action(Primitive.ARTICULATE_OPEN, (0.0, upper)))
        if number % STEPS_A_HOLD == 0 and number < count:
            actions += HOLD_AGAIN
    return actions
