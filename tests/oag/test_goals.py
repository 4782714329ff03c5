"""The task goal that is read off the subtasks: what counts at the end, and what later subtasks replace."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

import bddl
import oag
from oag.task_definition import default_goal

PICK: list[Any] = [17, 1, 2, 3, {"7": 0.2}]
PLACE: list[Any] = [18, {"13": 0.3}, 5]
SHUT: list[Any] = [17, 1, 2, 3, 19, 5]
Row = tuple[str, str, str, list[Any] | None, str | None]


def kitchen() -> oag.Scene:
    """Two glasses on a table, an open refrigerator, a closed drawer."""
    things = {"refrigerator_0": "refrigerator", "drawer_0": "drawer", "table_0": "table"}
    objects = {key: {"category": name, "bbox_extent": [1, 1, 1]} for key, name in things.items()}
    glass = {"category": "water_glass", "bbox_extent": [0.05, 0.05, 0.1]}
    facts = ["(ontop glass_0 table_0)", "(ontop glass_1 table_0)", "(open refrigerator_0)"]
    objects |= {"glass_0": glass, "glass_1": glass}
    return oag.Scene.from_json({"objects": objects, "facts": facts, "closed": ["ontop", "inside", "open"]})


def task_of(*rows: Row) -> oag.Task:
    """A task without a goal; each row has a target, its initial condition, goal, flow and goal support."""
    subtasks = []
    for target, init, goal, flow, support in rows:
        subtask: dict[str, Any] = {"target": target, "init": init, "goal": goal, "support_goal": support}
        subtasks.append(subtask if flow is None else {**subtask, "flow": flow})
    return oag.Task.from_json({"sub_tasks": subtasks}, scene=kitchen())


def picking(item: str, goal: str | None = None) -> Row:
    return item, "(and)", goal or f"(inside {item} gripper)", PICK, None


def placing(item: str, relation: str = "inside", support: str = "refrigerator_0") -> Row:
    return item, f"(inside {item} gripper)", f"({relation} {item} {support})", PLACE, support


def moving(item: str, relation: str, support: str) -> Row:
    return item, "(and)", f"({relation} {item} {support})", [*PICK, *PLACE], support


@pytest.mark.parametrize(
    ("rows", "goal"),
    [
        ((picking("glass_0"), placing("glass_0")), "(inside glass_0 refrigerator_0)"),
        (
            (picking("glass_0", "(and (not (ontop glass_0 table_0)) (inside glass_0 gripper))"), placing("glass_0")),
            "(and (not (ontop glass_0 table_0)) (inside glass_0 refrigerator_0))",
        ),
        (
            (picking("glass_0"), placing("glass_0"), picking("glass_1"), placing("glass_1")),
            "(and (inside glass_0 refrigerator_0) (inside glass_1 refrigerator_0))",
        ),
        (
            (moving("glass_0", "inside", "refrigerator_0"), moving("glass_0", "ontop", "table_0")),
            "(ontop glass_0 table_0)",
        ),
        ((moving("glass_0", "inside", "refrigerator_0"), picking("glass_0")), "(inside glass_0 gripper)"),
        (
            (
                ("drawer_0", "(and)", "(exists (?d - drawer) (open ?d))", [1, 2, 3, 4, 5], None),
                ("drawer_0", "(open drawer_0)", "(not (open drawer_0))", SHUT, None),
            ),
            "(not (open drawer_0))",
        ),
        (
            (
                ("drawer_0", "(and)", "(open drawer_0)", [1, 2, 3, 4, 5], None),
                ("drawer_0", "(and)", "(forall (?d - drawer) (not (open ?d)))", SHUT, None),
            ),
            "(forall (?d - drawer) (not (open ?d)))",
        ),
        ((picking("glass_0"), ("glass_0", "(and)", "(and)", [5], None)), "(and)"),
    ],
)
def test_what_a_later_subtask_replaces_does_not_count(rows: tuple[Row, ...], goal: str) -> None:
    task = task_of(*rows)
    assert bddl.format(task.goal) == goal
    report = oag.compose(task).verify()
    assert report.verdict is oag.Verdict.PROVED, str(report)
    # Without flows, what the goals ask for has to do.
    if rows[-1][3] != [5]:
        assert bddl.format(task_of(*(row[:3] + (None, row[4]) for row in rows)).goal) == goal


@pytest.mark.parametrize(
    ("rows", "goal"),
    [
        # Another thing is moved, or another door is closed.
        ((moving("glass_0", "inside", "refrigerator_0"), moving("glass_1", "ontop", "table_0")), 2),
        (
            (
                ("refrigerator_0", "(and)", "(open refrigerator_0)", [], None),
                ("drawer_0", "(and)", "(forall (?d - drawer) (not (open ?d)))", [], None),
            ),
            2,
        ),
        # The same is said again, or nothing is moved.
        ((moving("glass_0", "inside", "refrigerator_0"), ("glass_0", "(and)", "(and)", [17], None)), 1),
        (
            (
                ("drawer_0", "(and)", "(exists (?d - drawer) (open ?d))", [1, 2, 3, 4, 5], None),
                ("drawer_0", "(and)", "(open drawer_0)", [], None),
            ),
            2,
        ),
    ],
)
def test_what_no_later_subtask_is_about_counts(rows: tuple[Row, ...], goal: int) -> None:
    assert len(bddl.conjuncts(task_of(*rows).goal)) == goal


def test_what_is_undone_by_accident_still_counts() -> None:
    """The glass that was to stay on the table is carried away by a drive to the drawer."""
    task = task_of(
        ("glass_0", "(and)", "(ontop glass_0 table_0)", [17, 1, 2, 3], "table_0"),
        ("drawer_0", "(and)", "(not (open drawer_0))", [17], None),
    )
    report = oag.compose(task).verify()
    assert report.verdict is oag.Verdict.REFUTED
    assert [error.code for error in report.errors] == ["goal/undone"]


def test_a_count_is_replaced_by_more_of_it() -> None:
    one, two = (f"(forn ({count}) (?g - water_glass) (inside ?g refrigerator_0))" for count in (1, 2))
    task = task_of(
        ("glass_0", "(and)", f"(and (inside glass_0 refrigerator_0) {one})", [*PICK, *PLACE], "refrigerator_0"),
        ("glass_1", "(and)", f"(and (inside glass_1 refrigerator_0) {two})", [*PICK, *PLACE], "refrigerator_0"),
    )
    assert oag.compose(task).verify(), str(oag.compose(task).verify())
    assert set(map(str, bddl.conjuncts(task.goal))) == {
        "(inside glass_0 refrigerator_0)",
        "(inside glass_1 refrigerator_0)",
        bddl.format(bddl.parse_formula(two)),
    }


def test_goals_that_are_not_well_formed_are_read_all_the_same() -> None:
    first, second = task_of(picking("glass_0"), placing("glass_0")).subtasks
    wrong = (bddl.Atom("ontop", ("glass_0",)), bddl.Atom("inside", ("glass_0", "gripper", "table_0")))
    subtasks = (replace(first, goal=wrong[0]), replace(second, goal=wrong[1]))
    assert bddl.conjuncts(default_goal(subtasks)) == wrong


@pytest.mark.slow
def test_many_subtasks() -> None:
    rows = [placing(f"glass_{number % 2}") for number in range(3000)]
    assert len(bddl.conjuncts(task_of(*rows).goal)) == 2


SHUT_DRAWER: Row = ("drawer_0", "(not (open drawer_0))", "(open drawer_0)", [17, 1, 2, 3, 4, 5, 6], None)
CLOSE_DRAWER: Row = ("drawer_0", "(open drawer_0)", "(not (open drawer_0))", SHUT, None)


def findings_about_the_goal(goal: str, *rows: Row) -> dict[str, str]:
    """Return the messages of `goal/...` by code, of a plan that is proved for a goal."""
    task = task_of(*rows)
    report = oag.compose(replace(task, goal=bddl.parse_formula(goal), goal_given=True)).verify()
    assert report.verdict is oag.Verdict.PROVED, str(report)
    return {found.code: found.message for found in report.diagnostics if found.code.startswith("goal/")}


def moving(item: str) -> tuple[Row, Row]:
    placed = f"(inside {item} refrigerator_0)"
    return picking(item), (item, f"(inside {item} gripper)", placed, PLACE, "refrigerator_0")


@pytest.mark.parametrize(
    ("goal", "omitted"),
    [
        ("(inside glass_0 refrigerator_0)", "(inside glass_1 refrigerator_0)"),
        ("(and (inside glass_0 refrigerator_0) (inside glass_1 refrigerator_0))", None),
        ("(forall (?x - water_glass) (inside ?x refrigerator_0))", None),
        ("(exists (?x - refrigerator) (and (inside glass_0 ?x) (inside glass_1 ?x)))", None),
        # A goal that speaks of a thing as a place alone says nothing of where that is.
        ("(and (inside glass_0 refrigerator_0) (not (ontop glass_0 glass_1)))", "(inside glass_1 refrigerator_0)"),
    ],
)
def test_effects_that_the_goal_omits_are_noted(goal: str, omitted: str | None) -> None:
    found = findings_about_the_goal(goal, *moving("glass_0"), *moving("glass_1"))
    assert set(found) == ({"goal/omits-effect"} if omitted else set())
    assert omitted is None or found["goal/omits-effect"].startswith(f"{omitted} holds at the end")


def test_an_omitted_door_is_noted_and_one_that_ends_as_it_was_is_not() -> None:
    rows = moving("glass_0")
    found = findings_about_the_goal("(inside glass_0 refrigerator_0)", SHUT_DRAWER, *rows)
    assert found["goal/omits-effect"].startswith("(open drawer_0) holds")
    assert not findings_about_the_goal("(inside glass_0 refrigerator_0)", SHUT_DRAWER, CLOSE_DRAWER, *rows)


@pytest.mark.parametrize("goal", ["(not (open drawer_0))", "(exists (?x - water_glass) (ontop ?x table_0))"])
def test_a_goal_that_holds_at_the_start_is_warned_of(goal: str) -> None:
    found = findings_about_the_goal(goal, SHUT_DRAWER, CLOSE_DRAWER, *moving("glass_0"))
    assert "holds at the start already" in found["goal/holds-at-start"]
