"""Goals small enough to try every state, and what trying every state says of them."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations, permutations, product

from hypothesis import strategies as st

import bddl
from bddl.grounding import PAIR_SEMANTICS

OBJECTS = {"a1": "a", "a2": "a", "a3": "a", "b1": "b", "b2": "b"}
# Fixed values of some atoms; the others are unknown.
Partial = frozenset[tuple[bddl.Atom, bool]]

_NAMES = ("a1", "a2", "b1", "x", "y")


@st.composite
def _atoms(draw: st.DrawFn) -> bddl.Atom:
    if draw(st.booleans()):
        return bddl.Atom("open", (draw(st.sampled_from(_NAMES)),))
    return bddl.Atom("inside", (draw(st.sampled_from(("a1", "x"))), draw(st.sampled_from(("b1", "y")))))


def _larger(inner: st.SearchStrategy[bddl.Formula]) -> st.SearchStrategy[bddl.Formula]:
    parts = st.lists(inner, max_size=3).map(tuple)
    category = st.sampled_from(("a", "b"))
    counts = st.integers(0, 3)
    return st.one_of(
        st.builds(bddl.Not, inner),
        st.builds(bddl.And, parts),
        st.builds(bddl.Or, parts),
        st.builds(bddl.Imply, inner, inner),
        st.builds(bddl.ForAll, st.just("x"), category, inner),
        st.builds(bddl.Exists, st.just("y"), category, inner),
        st.builds(bddl.ForN, st.just("x"), category, inner, count=counts),
        st.builds(bddl.ForPairs, st.just("x"), category, st.just("y"), category, inner),
        st.builds(bddl.ForNPairs, st.just("x"), category, st.just("y"), category, inner, count=counts),
    )


readings = st.sampled_from(PAIR_SEMANTICS)


def goals(most_atoms: int = 6) -> st.SearchStrategy[bddl.Formula]:
    """Return goals of every form over few ground atoms, many of which their parts share."""
    return st.recursive(_atoms(), _larger, max_leaves=6).filter(
        lambda goal: len(bddl.ground(goal, OBJECTS).atoms) <= most_atoms
    )


def holds(goal: bddl.Formula, true: frozenset[bddl.Atom], bound: dict[str, str] | None = None) -> bool:
    """Decide a goal in a complete state by the plainest reading of each form."""
    names = bound or {}

    def of(category: str) -> list[str]:
        return [name for name, own in OBJECTS.items() if own == category]

    match goal:
        case bddl.Atom(predicate=predicate, args=args):
            return bddl.Atom(predicate, tuple(names.get(name, name) for name in args)) in true
        case bddl.Not(body=body):
            return not holds(body, true, names)
        case bddl.And(parts=parts):
            return all(holds(part, true, names) for part in parts)
        case bddl.Or(parts=parts):
            return any(holds(part, true, names) for part in parts)
        case bddl.Imply(left=left, right=right):
            return not holds(left, true, names) or holds(right, true, names)
        case bddl.ForAll(variable=variable, category=category, body=body):
            return all(holds(body, true, {**names, variable: name}) for name in of(category))
        case bddl.Exists(variable=variable, category=category, body=body):
            return any(holds(body, true, {**names, variable: name}) for name in of(category))
        case bddl.ForN(variable=variable, category=category, body=body, count=count):
            return sum(holds(body, true, {**names, variable: name}) for name in of(category)) == count
        case bddl.ForPairs(variable=v, category=c, other_variable=w, other_category=d, body=body):
            count = min(len(of(c)), len(of(d))) if goal.number is None else goal.number
            return any(
                all(
                    left != right and holds(body, true, {**names, v: left, w: right})
                    for left, right in zip(lefts, rights, strict=True)
                )
                for lefts in combinations(of(c), count)
                for rights in permutations(of(d), count)
            )
    raise TypeError(goal)


def partial_states(atoms: tuple[bddl.Atom, ...]) -> Iterator[Partial]:
    """Yield every choice of true, false or unknown for each atom, those that fix fewer atoms first."""
    for size in range(len(atoms) + 1):
        for chosen in combinations(atoms, size):
            for values in product((True, False), repeat=size):
                yield frozenset(zip(chosen, values, strict=True))


def smallest_ways(goal: bddl.Formula, pairs: bddl.PairSemantics = "matching") -> list[Partial]:
    """Return the partial states that make a goal true by Kleene's tables, of which no part does, smallest first."""
    found: list[Partial] = []
    for partial in partial_states(bddl.ground(goal, OBJECTS).atoms):
        smaller = any(way <= partial for way in found)
        if not smaller and bddl.evaluate(goal, dict(partial), OBJECTS, pairs=pairs) is True:
            found.append(partial)
    return found


def missing(way: Partial, state: Partial) -> int:
    """Return how many literals of a way do not hold in a state."""
    return len(way - state)
