"""The graph's feasibility relation E_{S_0}: which step can follow which, whatever the rest of the state.

Source: the paper's feasibility relation: (o, a, t) -> (o', a', t + 1) iff eff(a) and pre(a') together are satisfiable.
"""

from __future__ import annotations

from functools import cache
from itertools import product

from oag.facts import EMPTY, Value, gripping, holding
from oag.library import Context, effect, requirements
from oag.primitives import Primitive


@cache
def feasible(first: Primitive, second: Primitive, *, same_object: bool) -> bool:
    """Decides whether one primitive can directly follow another.

    Args:
        first: What ran.
        second: What is to run.
        same_object: Whether both act on one object.

    Returns:
        False when, for items and for fixtures alike and whatever the hand holds, the first leaves a value that the
        second forbids, as in RETREAT followed by GRASP.
    """
    for is_item, hand in product((True, False), _HANDS):
        before = Context("x", "s", None, is_item, ())
        after = before if same_object else Context("y", "s", None, is_item, ())
        left = dict(effect(first, before, hand))
        if all(
            any(condition.grade(left.get(condition.fact)) is not False for condition in clause)
            for clause in requirements(second, after, left.get(("hand",), hand))
        ):
            return True
    return False


_HANDS: tuple[Value, ...] = (EMPTY, holding("x"), gripping("x"), holding("y"), gripping("y"))
