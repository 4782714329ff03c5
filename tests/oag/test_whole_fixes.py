"""Plans with several mistakes: where no smaller fix proves one, the whole plan is repaired, changed little."""

from __future__ import annotations

import copy
from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

import oag
from oag.primitives.table import Placement
from oag.verify.fix_subtasks import picking, placing
from tests.oag.other_tasks import OTHERS
from tests.oag.paper import NAMES, scene, task_json

PLANS: dict[str, tuple[oag.Scene, dict[str, Any]]] = {name: (scene(name), task_json(name)) for name in NAMES}
PLANS |= {name: (oag.Scene.from_json(world), data) for name, (world, data) in OTHERS.items() if name != "eight"}


def _report(name: str, kept: list[int]) -> oag.Report:
    """Return the report of a plan with some of its subtasks, in an order."""
    kitchen, right = PLANS[name]
    data = copy.deepcopy(right)
    parts = [index % len(data["sub_tasks"]) for index in kept]
    data["sub_tasks"] = [data["sub_tasks"][index] for index in dict.fromkeys(parts)]
    return oag.compose(oag.Task.from_json(data, scene=kitchen)).verify()


@pytest.mark.slow
@given(st.sampled_from(sorted(PLANS)), st.lists(st.integers(0, 11), min_size=1, max_size=6))
def test_what_is_left_of_a_plan_in_any_order_gets_a_fix_that_proves_it(name: str, kept: list[int]) -> None:
    report = _report(name, kept)
    proving = [fix for fix in report.fixes if fix.proves]
    assert proving or report.verdict is not oag.Verdict.REFUTED
    for fix in proving:
        task, world = fix.apply(report.task), fix.apply_to_scene(report.scene)
        assert oag.compose(task, world).verify().verdict is oag.Verdict.PROVED


def test_a_plan_without_its_doors_and_picks_is_repaired_as_a_whole() -> None:
    # Only "open the cabinet, put the cup into it" is left of a plan for two containers.
    kitchen, right = PLANS["two_containers"]
    data = copy.deepcopy(right)
    data["sub_tasks"] = [part for part in data["sub_tasks"] if part["task_activity_name"].startswith(("put", "close"))]
    report = oag.compose(oag.Task.from_json(data, scene=kitchen)).verify()
    assert report.verdict is oag.Verdict.REFUTED
    first = report.fixes[0]
    assert first.proves and first.kind == "several"
    repaired = first.apply(report.task)
    assert {part.name for part in report.task.subtasks} & {part.name for part in repaired.subtasks}
    assert repaired.goal == report.task.goal


def _kitchen(cups: int) -> oag.Scene:
    """Return a kitchen with cups on a table, a shut oven, and an open cabinet."""
    objects: dict[str, Any] = {
        "table_0": {"category": "table", "bbox_extent": [0.8, 0.8, 0.8]},
        "counter_0": {"category": "counter", "bbox_extent": [0.8, 0.8, 0.8]},
        "oven_0": {"category": "oven", "bbox_extent": [0.6, 0.6, 0.6]},
        "cabinet_0": {"category": "cabinet", "bbox_extent": [0.6, 0.6, 0.6]},
    }
    names = [f"cup_{number}" for number in range(cups)]
    objects |= {name: {"category": "cup", "bbox_extent": [0.05, 0.05, 0.05]} for name in names}
    facts = ["(open cabinet_0)", "(not (open oven_0))", *(f"(ontop {name} table_0)" for name in names)]
    return oag.Scene.from_json(
        {"name": "kitchen", "objects": objects, "facts": facts, "closed": ["ontop", "inside", "open"]}
    )


def _without_goal(kitchen: oag.Scene, *parts: oag.SimpleTask) -> oag.Report:
    """Return the report of a plan that states no goal of its own."""
    task = oag.Task.from_json({"sub_tasks": [part.to_json() for part in parts]}, scene=kitchen)
    return oag.compose(task).verify()


def _take(number: int) -> oag.SimpleTask:
    return picking(f"cup_{number}", Placement("ontop", "table_0"))


def _put(number: int, where: str) -> oag.SimpleTask:
    return placing(f"cup_{number}", Placement("inside", where))


def test_a_plan_that_states_no_goal_is_repaired_to_what_it_aims_at() -> None:
    # Three things are taken by one hand, and one is put behind a shut door.
    report = _without_goal(_kitchen(3), _take(0), _take(1), _take(2), _put(2, "oven_0"))
    first = report.fixes[0]
    assert first.proves and first.kind == "several"
    repaired = first.apply(report.task)
    for goal in (repaired.goal, report.task.goal):
        given = replace(repaired, goal=goal, goal_given=True)
        assert oag.compose(given, scene=report.scene).verify().verdict is oag.Verdict.PROVED
    # None stays on the table, which is what taking them aims at.
    assert {"cup_0", "cup_1", "cup_2"} <= {part.target for part in repaired.subtasks}


def test_a_shut_door_is_opened_before_something_else_is_meant() -> None:
    report = _without_goal(_kitchen(1), _take(0), _put(0, "oven_0"))
    assert report.fixes[0].kind == "insert-subtask"
    assert "open oven_0" in report.fixes[0].summary
    # Another place is offered as well, but later: it makes the plan one for something else.
    assert any(fix.kind.startswith("change-") and fix.proves for fix in report.fixes[1:])


def test_one_mistake_made_again_and_again_is_mended_everywhere() -> None:
    kitchen, parts = _kitchen(12), []
    for number in range(0, 12, 2):
        parts += [_take(number), _take(number + 1), _put(number, "cabinet_0"), _put(number + 1, "cabinet_0")]
    report = _without_goal(kitchen, *parts)
    assert report.verdict is oag.Verdict.REFUTED and len(report.errors) == 6
    first = report.fixes[0]
    assert first.proves and len(first.edits) == 6
    assert oag.compose(first.apply(report.task), scene=kitchen).verify().verdict is oag.Verdict.PROVED
