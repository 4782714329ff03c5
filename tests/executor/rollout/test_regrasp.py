"""A glass that can only be taken steeply where it stands, and only be put level where it goes, is taken twice."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import oag
from bddl import format
from executor.geometry import pitch_of, transform_from_quaternion
from executor.records.rollout import Rollout
from executor.results.run_record import filled_task
from executor.rollouts.regrasp import MOST_SUPPORTS, found_no_place, regrasps
from executor.rollouts.running import resume, rollout
from executor.scenes import library
from oag.revision.measurements import SupportDrive
from tests.executor.recordings import invented_rollout
from tests.executor.rollout.tasks import T1_OPEN_FLOWS, T1_ROLES, graph

LOW_SHELVES_M = (0.26, 0.43, 0.60, 0.77, 0.94)
"""Seventeen centimetres apart: no hand that comes from above gets in."""

CANS, RING_M, CAN_M = 6, 0.10, (0.066, 0.066, 0.09)
"""So near around the glass that no level hand gets in between, and low enough for one from above."""


def _among_cans() -> oag.Scene:
    nominal = library.load("kitchen_t1").to_json()
    objects = nominal["objects"]
    assert isinstance(objects, dict)
    refrigerator, (x, y, z) = objects["refrigerator_0"], objects["glass_0"]["position"]
    refrigerator["bbox_extent"] = [0.68, 0.6, 1.2]
    refrigerator["parameters"] |= {"open_fraction": 0.85, "shelf_heights_m": list(LOW_SHELVES_M)}
    bottom = z - objects["glass_0"]["bbox_extent"][2] / 2
    for number in range(CANS):
        angle = number * 2 * np.pi / CANS + 0.5
        place = [x + RING_M * float(np.cos(angle)), y + RING_M * float(np.sin(angle)), bottom + CAN_M[2] / 2]
        objects[f"can_{number}"] = {"category": "can", "model": "can", "position": place, "bbox_extent": list(CAN_M)}
    facts = ["(ontop glass_0 table_0)", "(open refrigerator_0)"]
    return oag.Scene.from_json({**nominal, "facts": facts})


def _task(scene: oag.Scene) -> oag.ObjectActionGraph:
    fields = {"task_detail_message": "", "support_init": None, "support_goal": None}
    chosen = zip(T1_ROLES[1:3], T1_OPEN_FLOWS[1:3], strict=True)
    task = {
        "task_activity_name": "put_glass_into_low_shelves",
        "task_detail_message": "",
        "goal": "(inside glass_0 refrigerator_0)",
        "scales": {"glass_0": 0.71},
        "sub_tasks": [fields | role | {"flow": flow} for role, flow in chosen],
    }
    return oag.compose(oag.Task.from_json(task, scene=scene), scene=scene)


def test_the_plan_with_both_subtasks_more_is_proved_and_names_the_first_support_first() -> None:
    task = graph("kitchen_t1", T1_ROLES[:3], T1_OPEN_FLOWS[:3], "(inside glass_0 refrigerator_0)", {"glass_0": 0.71})
    scene = library.load("kitchen_t1")
    found = list(regrasps(task.task, 2, scene))
    assert 1 <= len(found) <= MOST_SUPPORTS
    assert found[0][0] == "table_0"
    for support, longer in found:
        assert oag.compose(longer, scene=scene).verify().verdict is oag.Verdict.PROVED
        down, again = longer.subtasks[2:4]
        assert format(down.goal) == format(again.init) == f"(ontop glass_0 {support})"
        assert (*longer.subtasks[:2], *longer.subtasks[4:]) == task.task.subtasks
    assert list(regrasps(task.task, 1, scene)) == [], "nothing was taken before"


@pytest.fixture(scope="module")
def done() -> Rollout:
    """The rollout with the cans."""
    return rollout(_task(_among_cans()), seed=0, vary=False)


def _pitches_deg(done: Rollout, primitive: str) -> list[float]:
    """The hand's pitch at the end of every step of a kind."""
    moved = done.trajectory
    found = []
    for record in done.subtasks:
        for step in record.steps:
            if step.primitive == primitive:
                row = np.flatnonzero((moved.subtask == step.subtask) & (moved.step == step.step))[-1]
                pose = moved.eef_pose[row].astype(float)
                found.append(float(np.rad2deg(pitch_of(transform_from_quaternion(pose[:3], pose[3:])))))
    return found


@pytest.mark.slow
@pytest.mark.physics
def test_what_no_single_grasp_does_is_done_by_two(done: Rollout) -> None:
    assert done.succeeded, done.failure
    names = [record.name for record in done.subtasks]
    assert names == ["pick_up_glass", "set_glass_0_down", "take_glass_0_again", "put_glass_into_refrigerator"]
    steep, level = _pitches_deg(done, "GRASP")
    assert steep > 40.0 and level < 35.0
    assert all(reading.satisfied for reading in done.goal_readings)
    assert set(done.trajectory.subtask) == {0, 1, 2, 3}, "what failed before is not part of the record"


@pytest.mark.slow
@pytest.mark.physics
def test_the_longer_plan_with_its_numbers_does_the_same_by_itself_and_from_its_checkpoints(done: Rollout) -> None:
    longer = oag.compose(filled_task(done), scene=_among_cans())
    assert resume(oag.compose(done.task, scene=_among_cans()), done, 2).state_hash == done.state_hash
    again = rollout(longer, seed=0, vary=False)
    assert again.succeeded and len(again.subtasks) == len(done.subtasks)


def test_only_a_search_that_found_no_place_asks_for_another_grasp() -> None:
    place = graph("kitchen_t1", T1_ROLES[:3], T1_OPEN_FLOWS[:3], "(inside glass_0 refrigerator_0)", {}).task.subtasks[2]
    failed = invented_rollout(failed=True).subtasks[-1]
    nominal = (SupportDrive("refrigerator_0", stance="nominal: the flow's numbers reach no free spot"),)
    there = replace(failed.steps[-1], primitive="NAVIGATE_TO_SUPPORT", measurements=nominal, failure=None)
    nowhere = replace(failed, steps=(there, failed.steps[-1]))
    assert found_no_place(nowhere, place, "glass_0")
    assert not found_no_place(nowhere, place, None), "with nothing in hand there is nothing to take again"
    assert not found_no_place(failed, place, "glass_0"), "it failed for another reason"
    assert not found_no_place(replace(nowhere, steps=(there,), readings=()), place, "glass_0"), "it succeeded"
    given = replace(place, flow=oag.flow_from_json([18, {"13": 0.4}, 5, 6]))
    assert not found_no_place(nowhere, given, "glass_0"), "numbers that a flow gives are run as they are written"
