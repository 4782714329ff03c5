"""What holds at every instant, whatever is known: where things rest is irreflexive and antisymmetric, and kinds count.

That the hand, the arm and the base have one state each holds by the form of facts (see `facts`).

Source: docs/semantics.md, States.
"""

from __future__ import annotations

from collections.abc import Callable, Container, Iterator, Mapping

from oag.model.categories import has_inside
from oag.model.facts import ANY, Fact, Value
from oag.table.library import RESTING, Effect


def impossible(objects: Mapping[str, str], articulated: Container[str]) -> Iterator[Fact]:
    """Yields the facts and patterns that no state makes true: what has no joint is not open, nor has all an inside.

    Args:
        objects: Category of each object.
        articulated: Ids of those that have a joint.
    """
    for name, category in objects.items():
        if name not in articulated:
            yield "open", name
        if not has_inside(category):
            yield "inside", ANY, name


def converse(fact: Fact) -> Fact | None:
    """Returns the fact that cannot be true together with this one (itself, for a thing on itself); None if none is."""
    if len(fact) == 3 and fact[0] in RESTING:
        return fact[0], fact[2], fact[1]
    return None


def excluded(fact: Fact, read: Callable[[Fact], Value]) -> bool:
    """True when what is known keeps a fact from being true: nothing is on itself, and no two things on each other."""
    other = converse(fact)
    return other is not None and (other == fact or read(other) is True)


def with_consequences(fact: Fact, value: Value) -> Effect:
    """Returns what is known once something is stated or assumed of the start: the fact, and what it excludes."""
    other = converse(fact)
    return ((fact, value),) if other is None or value is not True else ((fact, value), (other, False))
