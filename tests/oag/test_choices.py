"""Goals that leave a choice get a flow for one way to meet them, or the proof that none has one."""

from __future__ import annotations

from typing import Any

import pytest

import bddl
import oag

OBJECTS = {
    "glass_0": "water_glass",
    "glass_1": "water_glass",
    "drawer_0": "drawer",
    "drawer_1": "drawer",
    "table_0": "table",
}


def scene(*facts: str) -> oag.Scene:
    """A glass on a table beside two drawers."""
    things = {
        key: {"category": kind, "bbox_extent": [0.05, 0.05, 0.1] if kind == "water_glass" else [1, 1, 1]}
        for key, kind in OBJECTS.items()
    }
    return oag.Scene.from_json({"objects": things, "facts": list(facts), "closed": ["ontop", "inside", "open"]})


def put(goal: str, **roles: Any) -> oag.ObjectActionGraph:
    """The plan that brings the glass where a goal leaves a choice; only the second drawer is open."""
    start = scene("(ontop glass_0 table_0)", "(ontop glass_1 table_0)", "(open drawer_1)")
    part = {"target": "glass_0", "support_goal": None, "init": "(ontop glass_0 table_0)", "goal": goal, **roles}
    return oag.compose({"goal": goal, "sub_tasks": [part]}, start)


@pytest.mark.parametrize(
    ("goal", "chosen"),
    [
        ("(or (inside glass_0 drawer_0) (inside glass_0 drawer_1))", "(inside glass_0 drawer_1)"),
        ("(exists (?d - drawer) (inside glass_0 ?d))", "(inside glass_0 drawer_1)"),
        ("(exists (?d - drawer) (and (open ?d) (ontop glass_0 ?d)))", "(and (open drawer_1) (ontop glass_0 drawer_1))"),
        ("(imply (ontop glass_1 table_0) (inside glass_0 drawer_1))", "(inside glass_0 drawer_1)"),
    ],
)
def test_a_flow_is_found_for_one_way(goal: str, chosen: str) -> None:
    graph = put(goal)
    assert bddl.format(graph.task.subtasks[0].goal) == chosen
    report = graph.verify()
    assert report.verdict is oag.Verdict.PROVED and graph.searched == (0,)
    assert oag.recheck(report.certificate)
    assert any(finding.code == "flow/searched" and f"for {chosen}" in finding.message for finding in report.diagnostics)


def test_a_given_support_is_kept() -> None:
    both = "(or (inside glass_0 drawer_0) (inside glass_0 drawer_1))"
    assert put(both, support_goal="drawer_0").verify().verdict is oag.Verdict.REFUTED
    assert put(both, support_goal="drawer_1").verify()


@pytest.mark.parametrize(
    "goal",
    [
        "(or (inside glass_0 drawer_0) (inside glass_1 drawer_1))",
        "(forall (?g - water_glass) (inside ?g drawer_1))",
        "(exists (?d - drawer) (and (not (open ?d)) (inside glass_0 ?d)))",
    ],
)
def test_where_no_way_has_a_flow_that_is_proved(goal: str) -> None:
    graph = put(goal)
    report = graph.verify()
    assert report.verdict is oag.Verdict.REFUTED and graph.searched == ()
    assert [error.code for error in report.errors] == ["flow/no-flow"]
    assert oag.recheck(report.certificate)


def test_a_choice_is_made_for_what_comes_after() -> None:
    """Both drawers would do for the first subtask, and one of them for the second."""
    start = scene("(ontop glass_0 table_0)", "(open drawer_0)", "(open drawer_1)")
    first = {"target": "glass_0", "support_goal": None, "init": "(ontop glass_0 table_0)"}
    first["goal"] = "(exists (?d - drawer) (inside glass_0 ?d))"
    second = {"target": "drawer_1", "init": "(inside glass_0 drawer_1)", "goal": "(not (open drawer_1))"}
    graph = oag.compose({"goal": "(not (open drawer_1))", "sub_tasks": [first, second]}, start)
    assert graph.verify()
    assert bddl.format(graph.task.subtasks[0].goal) == "(inside glass_0 drawer_1)"
