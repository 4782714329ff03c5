"""Out of a compartment: a lift in it takes nothing out, backing out and driving away do; out of a bowl a lift does."""

from __future__ import annotations

from typing import Any

import pytest

import oag
from tests.oag.other_tasks import closing, opening, placing, scene, subtask, task

KITCHEN: dict[str, Any] = scene(
    "kitchen",
    {"cup_0": "cup", "apple_0": "apple", "bowl_0": "bowl"},
    {"fridge_0": "fridge", "table_0": "table"},
    ["(inside cup_0 fridge_0)", "(inside apple_0 bowl_0)", "(ontop bowl_0 table_0)"],
)
GRASP = [17, 1, 2, 3]
BACK_OUT = {
    "RETREAT": [6],
    "lift, RETREAT": [{"7": 0.2}, 6],
    "NAVIGATE_TO_SUPPORT": [{"7": 0.2}, 18],
}


def taking(item: str, container: str, flow: list[Any] | None) -> dict[str, Any]:
    there = f"(inside {item} {container})"
    after = "table_0" if flow is not None and 18 in flow else None
    made = subtask(f"take_{item}", item, container, after, there, f"(not {there})", flow or [])
    if flow is None:
        del made["flow"]
    return made


def verified(*subtasks: dict[str, Any], goal: str) -> oag.Report:
    return oag.compose(task("take_out", goal, *subtasks), oag.Scene.from_json(KITCHEN)).verify()


def test_a_lift_takes_nothing_out_of_a_compartment_and_the_fix_backs_out() -> None:
    report = verified(opening("fridge_0"), taking("cup_0", "fridge_0", [*GRASP, {"7": 0.2}]), goal="(open fridge_0)")
    assert report.verdict is oag.Verdict.REFUTED
    (error,) = report.errors
    assert (error.code, error.subtask) == ("flow/goal-not-reached", 1)
    fix = report.fixes[0]
    assert fix.proves
    flow = fix.apply(report.task).subtasks[1].flow
    assert flow is not None and flow[-1].primitive is oag.Primitive.RETREAT
    assert "RETREAT or driving has to follow" in str(report)


@pytest.mark.parametrize("moves", BACK_OUT.values(), ids=BACK_OUT)
def test_who_backs_out_or_drives_away_has_taken_it_out(moves: list[Any]) -> None:
    report = verified(opening("fridge_0"), taking("cup_0", "fridge_0", [*GRASP, *moves]), goal="(open fridge_0)")
    assert report.verdict is oag.Verdict.PROVED, str(report)
    assert oag.recheck(report.certificate)


def test_a_lift_takes_a_thing_out_of_a_bowl() -> None:
    report = verified(taking("apple_0", "bowl_0", [*GRASP, {"7": 0.2}]), goal="(inside apple_0 gripper)")
    assert report.verdict is oag.Verdict.PROVED, str(report)
    assert oag.recheck(report.certificate)


@pytest.mark.parametrize(
    ("item", "container", "tail"),
    [("cup_0", "fridge_0", ["LIFT_EEF_UP", "RETREAT"]), ("apple_0", "bowl_0", ["LIFT_EEF_UP"])],
)
def test_a_searched_flow_backs_out_of_a_compartment_and_of_nothing_else(
    item: str, container: str, tail: list[str]
) -> None:
    before = [opening("fridge_0")] if container == "fridge_0" else []
    after = [placing(item, "ontop", "table_0"), *([closing("fridge_0")] if before else [])]
    data = task("take_out", f"(ontop {item} table_0)", *before, taking(item, container, None), *after)
    graph = oag.compose(data, oag.Scene.from_json(KITCHEN))
    assert graph.verify()
    flow = graph.task.subtasks[len(before)].flow
    assert flow is not None
    assert [action.primitive.name for action in flow][4:] == tail


def test_what_is_carried_out_in_one_subtask_stays_proved_in_the_common_form() -> None:
    one = subtask(
        "move_cup",
        "cup_0",
        "fridge_0",
        "table_0",
        "(inside cup_0 fridge_0)",
        "(ontop cup_0 table_0)",
        [*GRASP, {"7": 0.2}, 18, {"13": 0.4}, {"8": 0.2}, 5, 6],
    )
    plan = oag.Task.from_json(
        task("move", "(ontop cup_0 table_0)", opening("fridge_0"), one), scene=oag.Scene.from_json(KITCHEN)
    )
    form = oag.canonical(plan)
    assert len(form.subtasks) == 3
    assert oag.compose(plan).verify() and oag.compose(form).verify()
