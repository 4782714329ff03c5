"""What the numbers of a flow decide: a thing that is moved leaves its place, and what moves by nothing does nothing."""

from __future__ import annotations

from typing import Any

import pytest

import oag
from oag.model.robots import ROBOTS
from tests.oag.paper import scene, task_json, verify

GLASS_STAYS = "(ontop glass_0 table_0)"


def picking(flow: list[Any], goal: str) -> oag.Report:
    """The report on T1's first two subtasks, of which the second, about the glass, has this flow and any goal."""
    data = task_json("T1")
    data["sub_tasks"] = data["sub_tasks"][:2]
    data["sub_tasks"][1] |= {"flow": flow, "goal": "(and)"}
    data["goal"] = goal
    return verify(data, "T1")


@pytest.mark.parametrize(
    "motion",
    [[{str(number): 0.2}] for number in range(7, 17)]
    + [[{"20": 30}], [{"21": 30}], [6], [17], [17, 1], [17, 1, 2], [{"13": None}], [{"13": 0.2}, {"14": 0.2}]],
    ids=str,
)
def test_every_motion_of_a_held_thing_takes_it_off_its_place(motion: list[Any]) -> None:
    for end in ([], [5]):
        report = picking([17, 1, 2, 3, *motion, *end], GLASS_STAYS)
        assert report.verdict is oag.Verdict.REFUTED
        assert oag.recheck(report.certificate)
        assert picking([17, 1, 2, 3, *motion, *end], f"(not {GLASS_STAYS})")


@pytest.mark.parametrize("motion", [[], [{"7": 0.0}], [{"13": 0}, {"10": 0.0}], [{"20": 0}]], ids=str)
def test_what_is_not_moved_stays_where_it_is(motion: list[Any]) -> None:
    for end in ([], [5], [5, 6], [5, {"7": 0.2}]):
        assert picking([17, 1, 2, 3, *motion, *end], GLASS_STAYS)
        assert picking([17, 1, 2, 3, *motion, *end], f"(not {GLASS_STAYS})").verdict is oag.Verdict.REFUTED


def test_driving_with_a_handle_in_the_hand_takes_nothing_along() -> None:
    data = task_json("T1")
    data["sub_tasks"] = data["sub_tasks"][:1]
    data["sub_tasks"][0]["flow"] = [1, 2, 3, {"4": [0.0, 0.7]}, {"14": 0.1}, 5]
    data["goal"] = f"(and (open refrigerator_0) {GLASS_STAYS})"
    assert verify(data, "T1")


@pytest.mark.parametrize(
    ("subtask", "step", "action", "opens"),
    [
        (0, 3, {"4": [0.0, 0.0]}, False),
        (0, 3, {"4": [0.0, 0.04]}, False),
        (0, 3, {"4": [0.0, 0.7]}, True),
        (0, 3, {"4": [0.0, 1.2]}, True),
        (3, 4, {"19": [0.0, 0.0]}, True),
        (3, 4, {"19": [0.5, 1.0]}, True),
        (3, 4, {"19": [0.0, 0.5]}, False),
    ],
)
def test_a_joint_is_where_its_limits_leave_it(subtask: int, step: int, action: dict[str, Any], opens: bool) -> None:
    data = task_json("T1")
    data["sub_tasks"][subtask]["flow"][step] = action
    report = verify(data, "T1")
    assert bool(report) is (opens is (subtask == 0)), str(report)
    if not report:
        assert [(error.code, error.subtask) for error in report.errors] == [("flow/goal-not-reached", subtask)]
        assert oag.recheck(report.certificate)
        assert any("to the executor" in fix.summary and fix.proves for fix in report.fixes), report.fixes


def test_lifting_by_nothing_lifts_nothing() -> None:
    data = task_json("T1")
    data["sub_tasks"][1]["flow"][-1] = {"7": 0.0}
    report = verify(data, "T1")
    assert [(error.code, error.subtask) for error in report.errors] == [("flow/goal-not-reached", 1)]
    assert any("to the executor" in fix.summary and fix.proves for fix in report.fixes)


HAND = range(7, 13)


@pytest.mark.parametrize("robot", ROBOTS)
@pytest.mark.parametrize("primitive", HAND)
def test_a_motion_longer_than_the_arm_is_refused_and_a_shorter_one_is_not(primitive: int, robot: str) -> None:
    kitchen = scene("T1").with_robot(robot)
    longest_m = kitchen.robot.model.longest_motion_m(oag.Primitive(primitive))
    assert longest_m is not None
    for distance_m, fits in ((longest_m, True), (longest_m + 0.01, False), (min(longest_m + 1.0, 3.0), False)):
        data = task_json("T1")
        data["sub_tasks"][1]["flow"] = [17, 1, 2, 3, {"7": 0.2}, {str(primitive): distance_m}]
        report = oag.compose(oag.Task.from_json(data, scene=kitchen)).verify()
        found = [error for error in report.errors if error.code == "flow/parameter"]
        assert not found if fits else "moves the hand at most" in found[0].message and found[0].subtask == 1
        assert fits or any("to the executor" in fix.summary and fix.proves for fix in report.fixes)


def test_motions_that_are_added_up_stay_motions_of_the_arm() -> None:
    data = task_json("T1")
    data["sub_tasks"][1]["flow"] = [17, 1, 2, 3, {"7": 0.9}, {"7": 0.9}]
    assert verify(data, "T1")
    merged = oag.canonical(oag.Task.from_json(data, scene=scene("T1")))
    assert oag.compose(merged).verify()
