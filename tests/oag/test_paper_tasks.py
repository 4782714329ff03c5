"""T1 to T4 with the paper's boundaries and flows are proved; their weak pick goals are warnings."""

from __future__ import annotations

from typing import Any

import pytest

import bddl
import oag
from oag.progression import Grade
from tests.oag.paper import EVOLVED, NAMES, UNFILLED, assert_golden, task_json, verify


@pytest.mark.parametrize("name", NAMES)
def test_initial_flows_are_proved(name: str) -> None:
    report = verify(task_json(name), name)
    assert report.verdict is oag.Verdict.PROVED, str(report)
    assert report
    assert all(obligation.grade is Grade.HOLDS for obligation in report.obligations)
    assert oag.recheck(report.certificate)
    assert_golden(name, str(report))


@pytest.mark.parametrize(("name", "index", "flow"), EVOLVED)
def test_evolved_flows_are_proved(name: str, index: int, flow: list[Any]) -> None:
    data = task_json(name)
    data["sub_tasks"][index]["flow"] = flow
    report = verify(data, name)
    assert report.verdict is oag.Verdict.PROVED, str(report)


def test_unfilled_flows_are_proved_with_a_note() -> None:
    data = task_json("T1")
    for subtask, flow in zip(data["sub_tasks"], UNFILLED, strict=True):
        subtask["flow"] = flow
    report = verify(data, "T1")
    assert report.verdict is oag.Verdict.PROVED, str(report)
    notes = [finding for finding in report.diagnostics if finding.code == "flow/unfilled"]
    assert [note.severity for note in notes] == ["note"]


@pytest.mark.parametrize("name", NAMES)
def test_a_right_plan_warns_of_nothing_and_notes_the_weak_pick_goal(name: str) -> None:
    report = verify(task_json(name), name)
    assert {finding.severity for finding in report.diagnostics} == {"note"}
    (gap,) = [finding for finding in report.diagnostics if finding.code == "context/goal-gap"]
    assert str(gap) in str(report) and str(gap) not in report.text(without=("context/goal-gap",))
    pick = gap.subtask
    assert pick == {"T1": 1, "T2": 1, "T3": 0, "T4": 0}[name]
    held = next(part for part in bddl.conjuncts(report.regressed_goals[pick]) if "gripper" in bddl.format(part))
    goal = report.task.subtasks[pick].goal
    assert gap.hint == f"accept the subtask on {bddl.format(bddl.And((goal, held)))}"


def test_regressed_goals_of_t1() -> None:
    goals = [bddl.format(goal) for goal in verify(task_json("T1"), "T1").regressed_goals]
    assert goals == [
        "(and (open refrigerator_0) (ontop glass_0 table_0) (not (inside glass_0 refrigerator_0)))",
        "(and (not (ontop glass_0 table_0)) (inside glass_0 gripper) (open refrigerator_0))",
        "(and (inside glass_0 refrigerator_0) (open refrigerator_0))",
        "(and (not (open refrigerator_0)) (inside glass_0 refrigerator_0))",
    ]


def test_a_first_flow_without_navigation_rests_on_the_reset() -> None:
    report = verify(task_json("T1"), "T1")
    assert report.certificate is not None
    assert [entry["kind"] for entry in report.certificate.assumptions] == ["reset", "reset"]
    assert report.assumptions[0].startswith("near(refrigerator_0): the reset")
    data = task_json("T1")
    data["sub_tasks"][0]["flow"] = UNFILLED[0]
    assert not any(text.startswith("near") for text in verify(data, "T1").assumptions)


@pytest.mark.parametrize("name", NAMES)
def test_without_a_given_goal_the_default_is_used_and_said(name: str) -> None:
    data = task_json(name)
    given = bddl.parse_formula(data.pop("goal"))
    report = verify(data, name)
    assert report.verdict is oag.Verdict.PROVED, str(report)
    assert not report.task.goal_given
    assert "read off the subtask goals" in str(report)
    # The default says at least what the query asked for.
    assert set(bddl.conjuncts(given)) <= set(bddl.conjuncts(report.task.goal))


def test_the_default_goal_leaves_out_what_a_later_subtask_undoes() -> None:
    data = task_json("T1")
    del data["goal"]
    goal = bddl.format(verify(data, "T1").task.goal)
    assert goal == ("(and (not (ontop glass_0 table_0)) (inside glass_0 refrigerator_0) (not (open refrigerator_0)))")


def test_a_dropped_subtask_is_seen_by_a_given_goal_only() -> None:
    data = task_json("T1")
    data["sub_tasks"].pop()
    assert verify(data, "T1").verdict is oag.Verdict.REFUTED
    del data["goal"]
    assert verify(data, "T1").verdict is oag.Verdict.PROVED


def test_every_single_deletion_is_refused_or_harmless() -> None:
    """Of T1's twenty steps sixteen cannot be left out; the others move without changing what the symbols say."""
    harmless = []
    for index, subtask in enumerate(task_json("T1")["sub_tasks"]):
        for position in range(len(subtask["flow"])):
            data = task_json("T1")
            del data["sub_tasks"][index]["flow"][position]
            if verify(data, "T1"):
                harmless.append((index, position))
    # Two geometric moves, a redundant navigation (the robot is still near), and the last release.
    assert len(harmless) == 4, harmless
    assert {(2, 1), (2, 2), (3, 5)} <= set(harmless)
