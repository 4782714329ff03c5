"""The domain of fallen things: plans with SET_UPRIGHT are proved, wrong ones refuted, and both are rechecked."""

from __future__ import annotations

from collections.abc import Sequence

import pytest

import oag

GOAL = "(and (ontop bottle_0 table_0) (upright bottle_0))"
SET_UPRIGHT = [18, 13, 8, "SET_UPRIGHT", 5, 6]


def home(*, appliances: bool = False) -> oag.Scene:
    """Return a scene with a bottle that lies, a can that stands, and a ball."""
    return oag.scene(
        objects={"bottle_0": "bottle", "can_0": "can", "ball_0": "ball", "table_0": "table"},
        facts=[
            "(can_stand bottle_0)",
            "(not (upright bottle_0))",
            "(can_stand can_0)",
            "(upright can_0)",
            *(f"(ontop {thing} table_0)" for thing in ("bottle_0", "can_0", "ball_0")),
        ],
        closed=["can_stand", "upright", "ontop", "inside", "open"],
        domain=oag.Domain.fallen(appliances=appliances),
    )


def verified(scene: oag.Scene, thing: str, flow: Sequence[object], goal: str = GOAL) -> oag.Report:
    subtasks = [
        {
            "task_activity_name": "pick_up",
            "target": thing,
            "support_init": "table_0",
            "init": f"(ontop {thing} table_0)",
            "goal": f"(not (ontop {thing} table_0))",
            "flow": [17, 1, 2, 3, 7],
        },
        {
            "task_activity_name": "put_down",
            "target": thing,
            "support_goal": "table_0",
            "init": f"(inside {thing} gripper)",
            "goal": goal,
            "flow": flow,
        },
    ]
    task = oag.Task.from_json({"task_activity_name": "stand_up", "goal": goal, "sub_tasks": subtasks}, scene=scene)
    return oag.compose(task).verify()


@pytest.mark.parametrize("appliances", [False, True])
def test_what_lies_is_upright_once_it_was_set_so(appliances: bool) -> None:
    report = verified(home(appliances=appliances), "bottle_0", SET_UPRIGHT)
    assert report.verdict is oag.Verdict.PROVED
    assert oag.recheck(report.certificate)


@pytest.mark.parametrize(
    ("thing", "flow", "why"),
    [
        ("bottle_0", [18, 13, 8, 5, 6], "upright"),  # Putting down alone does not say that it stands.
        ("bottle_0", [18, 13, 8, 5, "SET_UPRIGHT", 6], "SET_UPRIGHT"),  # The hand holds it no more.
        ("ball_0", SET_UPRIGHT, "can_stand"),
    ],
)
def test_wrong_plans_are_refuted_with_the_reason(thing: str, flow: Sequence[object], why: str) -> None:
    report = verified(home(), thing, flow, GOAL.replace("bottle_0", thing))
    assert report.verdict is oag.Verdict.REFUTED
    assert why in report.text()
    assert oag.recheck(report.certificate)


def test_the_wish_is_among_those_that_a_scene_admits() -> None:
    (found,) = oag.tasks(home(), ["stand-up"])
    assert found.sentence == "stand up the bottle" and found.wish.targets == ("bottle_0",)


def test_a_goal_alone_is_planned_for_what_can_stand() -> None:
    found = oag.plan(home(), GOAL)
    assert found.task is not None
    flows = [action.primitive.name for subtask in found.task.subtasks for action in subtask.flow or ()]
    assert "SET_UPRIGHT" in {name.split()[0] for name in flows}
    assert oag.plan(home(), GOAL.replace("bottle_0", "ball_0")).task is None
