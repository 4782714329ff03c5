"""Plans with several mistakes: where no smaller fix proves one, the whole plan is repaired, changed little."""

from __future__ import annotations

import copy
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

import oag
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
