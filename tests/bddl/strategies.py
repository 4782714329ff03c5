"""Hypothesis strategies for formulas and problems of the `scene` profile."""

from __future__ import annotations

from hypothesis import strategies as st

import bddl

OBJECTS = {"glass_0": "glass", "apple.n.01_1": "apple", "table_0": "table", "Fridge-2": "refrigerator"}
CATEGORIES = ("glass", "apple", "table", "object", "absent")
VARIABLES = ("x", "y", "glass_0")

names = st.sampled_from((*OBJECTS, "gripper", "x", "y"))


@st.composite
def atoms(draw: st.DrawFn, predicates: tuple[str, ...] = tuple(bddl.PREDICATES)) -> bddl.Atom:
    """Return atoms with legal arity; their names may or may not be variables of a quantifier around them."""
    spec = bddl.PREDICATES[draw(st.sampled_from(predicates))]
    return bddl.Atom(spec.name, tuple(draw(names) for _ in spec.parameters))


def formulas(leaves: st.SearchStrategy[bddl.Formula] | None = None) -> st.SearchStrategy[bddl.Formula]:
    """Return formulas of every form, quantifiers that hide objects included."""
    return st.recursive(leaves or atoms(), _larger, max_leaves=12)


def _larger(inner: st.SearchStrategy[bddl.Formula]) -> st.SearchStrategy[bddl.Formula]:
    parts = st.lists(inner, max_size=3).map(tuple)
    variable, category = st.sampled_from(VARIABLES), st.sampled_from(CATEGORIES)
    return st.one_of(
        st.builds(bddl.Not, inner),
        st.builds(bddl.And, parts),
        st.builds(bddl.Or, parts),
        st.builds(bddl.Imply, inner, inner),
        st.builds(bddl.ForAll, variable, category, inner),
        st.builds(bddl.Exists, variable, category, inner),
        st.builds(bddl.ForN, variable, category, inner, count=st.integers(0, 3)),
        st.builds(bddl.ForPairs, variable, category, variable, category, inner),
        st.builds(bddl.ForNPairs, variable, category, variable, category, inner, count=st.integers(0, 3)),
    )


literals = st.one_of(atoms(), st.builds(bddl.Not, atoms()))


@st.composite
def problems(draw: st.DrawFn) -> bddl.Problem:
    """Return problems whose objects cover every name and category that the formulas use."""
    fixed = {**OBJECTS, "x": "thing", "y": "absent"}
    order = draw(st.permutations(sorted(fixed)))
    return bddl.Problem(
        draw(st.sampled_from(("put_away", "Task-1"))),
        "omnigibson",
        tuple(bddl.TypedObject(name, fixed[name]) for name in order),
        draw(st.lists(literals, max_size=4).map(tuple)),
        draw(formulas()),
    )
