"""Options are all smallest ways to make a goal true, cheapest first, and come one at a time."""

from __future__ import annotations

from itertools import combinations, islice, permutations, product

import pytest
from hypothesis import given
from hypothesis import strategies as st

import bddl
from bddl.errors import SearchLimit
from bddl.progress import options
from tests.bddl.small_goals import OBJECTS, Partial, goals, holds, missing, partial_states, readings, smallest_ways


def as_partial(option: tuple[bddl.Literal, ...]) -> Partial:
    return frozenset((literal.atom, literal.value) for literal in option)


def texts(goal: str, **given: object) -> list[str]:
    """Return the options of a goal as text."""
    found = options(bddl.parse_formula(goal, objects=OBJECTS), OBJECTS, **given)  # type: ignore[arg-type]
    return [" ".join(map(str, option)) for option in found]


@given(goals(), readings)
def test_options_are_all_smallest_ways(goal: bddl.Formula, pairs: bddl.PairSemantics) -> None:
    found = [as_partial(option) for option in options(goal, OBJECTS, pairs=pairs)]
    expected = smallest_ways(goal, pairs)
    assert [len(way) for way in found] == [len(way) for way in expected]
    assert set(found) == set(expected)


@given(goals())
def test_the_goal_is_true_in_every_state_with_an_option(goal: bddl.Formula) -> None:
    atoms = bddl.ground(goal, OBJECTS).atoms
    for option in islice(options(goal, OBJECTS), 20):
        fixed = {literal.atom: literal.value for literal in option}
        assert len(fixed) == len(option)
        rest = [atom for atom in atoms if atom not in fixed]
        for values in product((True, False), repeat=len(rest)):
            state = fixed | dict(zip(rest, values, strict=True))
            assert holds(goal, frozenset(atom for atom, value in state.items() if value))


@given(goals(), st.data())
def test_options_from_a_state_are_the_same_by_what_they_change(goal: bddl.Formula, data: st.DataObject) -> None:
    atoms = bddl.ground(goal, OBJECTS).atoms
    state: Partial = data.draw(st.sampled_from(list(partial_states(atoms))))
    found = [as_partial(option) for option in options(goal, OBJECTS, dict(state))]
    assert set(found) == set(smallest_ways(goal))
    costs = [(missing(way, state), len(way)) for way in found]
    assert costs == sorted(costs)


def test_options_of_a_choice() -> None:
    assert texts("(and (or (open a1) (and (open a2) (open a3))) (not (open b1)))") == [
        "(open a1) (not (open b1))",
        "(open a2) (open a3) (not (open b1))",
    ]


def test_an_alternative_that_contradicts_itself_is_no_option() -> None:
    assert texts("(or (and (open a1) (not (open a1))) (open a2))") == ["(open a2)"]
    assert texts("(or (and (open a1) (or (not (open a1)) (open a3))) (open a2))") == [
        "(open a2)",
        "(open a1) (open a3)",
    ]


def test_the_literals_of_a_counted_option_hold_it_exactly() -> None:
    goal = bddl.ForN("x", "a", bddl.Atom("open", ("x",)), count=2)
    found = {" ".join(map(str, option)) for option in options(goal, OBJECTS)}
    assert found == {
        "(open a1) (open a2) (not (open a3))",
        "(open a1) (not (open a2)) (open a3)",
        "(not (open a1)) (open a2) (open a3)",
    }


@pytest.mark.parametrize(("rows", "columns"), list(product(range(5), repeat=2)))
@pytest.mark.parametrize("count", [0, 1, 2, 3, 4, None])
def test_pairings_are_all_found_once(rows: int, columns: int, count: int | None) -> None:
    names = [f"a{i}" for i in range(rows)], [f"b{i}" for i in range(columns)]
    objects = dict.fromkeys(names[0], "a") | dict.fromkeys(names[1], "b")
    body = bddl.Atom("inside", ("x", "y"))
    goal = (
        bddl.ForPairs("x", "a", "y", "b", body)
        if count is None
        else bddl.ForNPairs("x", "a", "y", "b", body, count=count)
    )
    wanted = min(rows, columns) if count is None else count
    expected = {
        frozenset(zip(chosen, places, strict=True))
        for chosen in combinations(names[0], wanted)
        for places in permutations(names[1], wanted)
    }
    found = list(options(goal, objects))
    assert all(literal.value for option in found for literal in option)
    assert len(found) == len(expected)
    assert {frozenset(literal.atom.args for literal in option) for option in found} == expected


@pytest.mark.parametrize("size", [2, 3, 4])
def test_a_negated_pairing_leaves_an_object_without_a_partner_first(size: int) -> None:
    """By König's theorem, all pairs outside of too few rows and columns have to be apart; a single line is cheapest."""
    names = [f"a{i}" for i in range(size)]
    goal = bddl.Not(bddl.ForPairs("x", "a", "y", "a", bddl.Atom("nextto", ("x", "y"))))
    found = list(islice(options(goal, dict.fromkeys(names, "a"), steps=500), 2 * size if size > 2 else 1))
    alone = {
        frozenset((name, other) if first else (other, name) for other in names if other != name)
        for name in names
        for first in (True, False)
    }
    if size > 3:
        assert {frozenset(literal.atom.args for literal in option) for option in found} == alone
    assert {len(option) for option in found} == {size - 1}
    assert not any(literal.value for option in found for literal in option)


@pytest.mark.parametrize(("rows", "columns", "count"), [(2, 3, 2), (3, 3, 2), (3, 3, 3), (3, 4, 2)])
def test_the_options_of_a_negated_pairing_are_the_smallest_sets_without_one(
    rows: int, columns: int, count: int
) -> None:
    objects = {f"a{i}": "a" for i in range(rows)} | {f"b{i}": "b" for i in range(columns)}
    goal = bddl.Not(bddl.ForNPairs("x", "a", "y", "b", bddl.Atom("inside", ("x", "y")), count=count))
    cells = list(product(range(rows), range(columns)))
    apart: list[frozenset[tuple[int, int]]] = []
    for number in range(len(cells) + 1):
        for chosen in map(frozenset, combinations(cells, number)):
            together = [cell for cell in cells if cell not in chosen]
            paired = any(
                len({i for i, _ in picked}) == count == len({j for _, j in picked})
                for picked in combinations(together, count)
            )
            if not paired and not any(smaller <= chosen for smaller in apart):
                apart.append(chosen)
    found = [
        frozenset((int(literal.atom.args[0][1:]), int(literal.atom.args[1][1:])) for literal in option)
        for option in options(goal, objects)
    ]
    assert len(found) == len(set(found)) and set(found) == set(apart)
    assert [len(option) for option in found] == sorted(len(option) for option in apart)


@pytest.mark.parametrize(("size", "other", "found"), [(20, "b", 20), (20, "a", 5)])
def test_large_pairings_are_not_multiplied_out(size: int, other: str, found: int) -> None:
    objects = {f"{kind}{i}": kind for kind in ("a", "b") for i in range(size)}
    goal = bddl.ForPairs("x", "a", "y", other, bddl.Atom("inside", ("x", "y")))
    first = list(islice(options(goal, objects, steps=300), found))
    assert len(set(first)) == found and {len(option) for option in first} == {size}


def test_too_few_and_too_many_are_the_opposite_of_exactly() -> None:
    goal = bddl.Not(bddl.ForN("x", "a", bddl.Atom("open", ("x",)), count=1))
    found = {" ".join(map(str, option)) for option in options(goal, OBJECTS)}
    assert found == {
        "(open a1) (open a2)",
        "(open a1) (open a3)",
        "(open a2) (open a3)",
        "(not (open a1)) (not (open a2)) (not (open a3))",
    }


def test_a_goal_that_holds_anyway_has_the_empty_option() -> None:
    assert list(options(bddl.And(()))) == [()]


@pytest.mark.parametrize(
    "goal",
    [
        "(or)",
        "(and (open a1) (not (open a1)))",
        "(and (or (open a1) (open a2)) (not (open a1)) (not (open a2)))",
        "(forn (4) (?x - a) (open ?x))",
        "(and (forn (1) (?x - a) (open ?x)) (forn (2) (?x - a) (open ?x)))",
        "(and (forall (?x - a) (or (open ?x) (inside ?x b1))) (forn (1) (?x - a) (open ?x))"
        " (forn (1) (?x - a) (inside ?x b1)))",
    ],
)
def test_a_goal_that_contradicts_itself_has_no_options(goal: str) -> None:
    parsed = bddl.parse_formula(goal, objects=OBJECTS, profile="behavior-compat")
    assert list(options(parsed, OBJECTS)) == []


def test_many_choices_are_not_multiplied_out() -> None:
    pairs = [bddl.Or((bddl.Atom("open", (f"a{i}",)), bddl.Atom("open", (f"b{i}",)))) for i in range(300)]
    first = list(islice(options(bddl.And(tuple(pairs))), 50))
    assert len(set(first)) == 50
    assert {len(option) for option in first} == {300}


def test_alternatives_that_one_literal_satisfies_are_not_multiplied_out() -> None:
    parts = [bddl.Or((bddl.Atom("open", ("a1",)), bddl.Atom("open", (f"b{i}",)))) for i in range(40)]
    assert [len(option) for option in options(bddl.And(tuple(parts)))] == [1, 40]


def test_a_pair_table_of_rows_that_do_not_tell_columns_apart() -> None:
    objects = {f"a{i}": "a" for i in range(9)} | {f"b{i}": "b" for i in range(9)}
    goal = bddl.ForPairs("x", "a", "y", "b", bddl.Atom("open", ("x",)))
    assert [len(option) for option in options(goal, objects)] == [9]


def test_a_search_that_is_cut_short_says_so() -> None:
    parts = tuple(bddl.Or((bddl.Atom("open", (f"a{i}",)), bddl.Atom("open", (f"a{i + 1}",)))) for i in range(30))
    found = []
    with pytest.raises(SearchLimit) as cut:
        found.extend(options(bddl.And(parts), steps=60))
    assert str(cut.value) == (
        "The search for ways to make the goal true was stopped after 60 steps; those found so far are right and the "
        "cheapest, but there may be more. Allow it more with steps=..."
    )
    found = list(islice(options(bddl.And(parts), steps=60), 1))
    assert [len(option) for option in found] == [15]


def test_a_search_that_finds_nothing_in_time_does_not_claim_that_there_is_nothing() -> None:
    """Six things cannot each be in a place of its own when there are five places."""
    inside = [[bddl.Atom("inside", (f"a{i}", f"b{j}")) for j in range(5)] for i in range(6)]
    somewhere = tuple(bddl.Or(tuple(row)) for row in inside)
    alone = tuple(
        bddl.Not(bddl.And((inside[i][j], inside[k][j]))) for j in range(5) for i in range(6) for k in range(i)
    )
    with pytest.raises(SearchLimit):
        list(options(bddl.And(somewhere + alone), steps=50))
    assert list(options(bddl.And(somewhere + alone))) == []


def test_a_deep_goal_is_no_trouble() -> None:
    goal: bddl.Formula = bddl.Atom("open", ("a1",))
    for level in range(10_000):
        name = bddl.Atom("open", (f"c{level % 50}",))
        goal = bddl.Not(bddl.Or((bddl.Not(name), goal))) if level % 2 else bddl.Imply(name, goal)
    assert next(options(goal)) is not None
