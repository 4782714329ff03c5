"""A small scene, formulas of all nine forms over it, its states, and classical truth by the definitions."""

from __future__ import annotations

from collections.abc import Callable
from itertools import combinations, permutations, product

from hypothesis import strategies as st

import bddl
from bddl import And, Atom, Exists, ForAll, Formula, ForN, ForNPairs, ForPairs, Imply, Not, Or

OBJECTS = {"cup_0": "cup", "cup_1": "cup", "box_0": "box", "cup_2": "cup", "box_1": "box", "jar_0": "jar"}
ATOMS = tuple(
    [Atom("open", (name,)) for name in OBJECTS] + [Atom("nextto", pair) for pair in product(OBJECTS, repeat=2)]
)
CATEGORIES = ("cup", "box", "jar", "object", "absent")
# Variables that may hide each other, and one that hides an object.
VARIABLES = ("x", "y", "cup_0")

Holds = Callable[[Atom], bool]


def holds(formula: Formula, state: Holds, pairs: str, bound: dict[str, str] | None = None) -> bool:
    """Return the truth of a formula in a complete state; `bound` says what each variable in scope stands for."""
    bound = bound or {}

    def inner(body: Formula, **more: str) -> bool:
        return holds(body, state, pairs, bound | more)

    def among(category: str) -> list[str]:
        return [name for name, own in OBJECTS.items() if category in (own, "object")]

    match formula:
        case Atom(predicate=predicate, args=args):
            return state(Atom(predicate, tuple(bound.get(name, name) for name in args)))
        case Not(body=body):
            return not inner(body)
        case And(parts=parts):
            return all([inner(part) for part in parts])
        case Or(parts=parts):
            return any([inner(part) for part in parts])
        case Imply(left=left, right=right):
            return not inner(left) or inner(right)
        case ForAll(variable=variable, category=category, body=body):
            return all([inner(body, **{variable: name}) for name in among(category)])
        case Exists(variable=variable, category=category, body=body):
            return any([inner(body, **{variable: name}) for name in among(category)])
        case ForN(variable=variable, category=category, body=body, count=count):
            return len([name for name in among(category) if inner(body, **{variable: name})]) == count
        case ForPairs(body=body):
            first, second = formula.binders
            firsts, seconds = among(first.category), among(second.category)

            def true_pair(name: str, other: str) -> bool:
                return name != other and inner(body, **({first.variable: name} | {second.variable: other}))

            true = {(i, j) for i, a in enumerate(firsts) for j, b in enumerate(seconds) if true_pair(a, b)}
            if pairs == "matching":
                count = min(len(firsts), len(seconds)) if formula.number is None else formula.number
                return can_pair_off(true, len(firsts), len(seconds), count)
            rows = [
                [inner(body, **({first.variable: a} | {second.variable: b})) for b in seconds if a != b] for a in firsts
            ]
            count = formula.number
            if count is None:
                count = min(len(rows), len(rows[0])) if rows else 0
            columns = {j for row in rows for j, value in enumerate(row) if value}
            return sum(map(any, rows)) >= count and len(columns) >= count


def can_pair_off(true: set[tuple[int, int]], height: int, width: int, count: int) -> bool:
    """Whether so many true cells can be chosen, no two in one row or column, by trying all choices."""
    return any(
        all((row, column) in true for row, column in zip(rows, columns, strict=True))
        for rows in combinations(range(height), count)
        for columns in permutations(range(width), count)
    )


def _larger(inner: st.SearchStrategy[Formula]) -> st.SearchStrategy[Formula]:
    parts = st.lists(inner, max_size=3).map(tuple)
    binder = st.sampled_from(VARIABLES), st.sampled_from(CATEGORIES)
    counts = st.integers(0, 4)
    return st.one_of(
        st.builds(Not, inner),
        st.builds(And, parts),
        st.builds(Or, parts),
        st.builds(Imply, inner, inner),
        st.builds(ForAll, *binder, inner),
        st.builds(Exists, *binder, inner),
        st.builds(ForN, *binder, inner, count=counts),
        st.builds(ForPairs, *binder, *binder, inner),
        st.builds(ForNPairs, *binder, *binder, inner, count=counts),
    )


_names = st.sampled_from((*VARIABLES, "cup_1", "box_0"))
# The names x and y are no objects; where no quantifier binds them, they are objects of their own all the same.
_leaves = st.one_of(
    st.builds(lambda name: Atom("open", (name,)), _names),
    st.builds(lambda *names: Atom("nextto", names), _names, _names),
)
formulas = st.recursive(_leaves, _larger, max_leaves=6)
pair_semantics: st.SearchStrategy[bddl.PairSemantics] = st.sampled_from(("matching", "reference"))


class Complete:
    """A complete state: a value for every atom whatsoever, fixed by a number."""

    def __init__(self, seed: int, tenths: int) -> None:
        self.seed = seed
        self.tenths = tenths

    def __call__(self, atom: Atom) -> bool:
        # Text hashes differ from run to run; these do not.
        digest = sum(ord(letter) * (index + 7) ** 3 for index, letter in enumerate(str(atom)))
        return (digest * 2654435761 + self.seed * 40503) % 1009 % 10 < self.tenths

    def __repr__(self) -> str:
        return f"Complete({self.seed}, {self.tenths})"


states = st.builds(Complete, st.integers(0, 10_000), st.integers(0, 10))
