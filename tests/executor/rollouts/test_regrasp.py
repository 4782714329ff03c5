"""A glass that can only be taken steeply where it stands, and only be put level where it goes, is taken twice."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import oag
from bddl import format
from executor.geometry import pitch_of, transform_from_quaternion
from executor.records import Event, Rollout, SubtaskRecord
from executor.rollouts.checkpoint import Checkpoint
from executor.rollouts.rollout import MOST_SUPPORTS, Run, found_no_place, regrasps, resume, rollout
from executor.rollouts.run_record import RunRecord, filled_task
from executor.scenes import library
from executor.sim.detectors import Overlap
from oag.measurements import SupportDrive
from tests.executor.recordings import invented_rollout
from tests.executor.rollouts.tasks import T1_OPEN_FLOWS, T1_ROLES, graph

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
    assert np.all(np.diff(done.trajectory.time_s) > 0.0)
    asked = _task(_among_cans())
    assert done.inserted == {1, 2} and done.asked_for == asked.task
    ran = RunRecord(asked, asked.verify(), rollout=done).as_ran()
    assert ran.report.verdict is oag.Verdict.PROVED
    assert oag.recheck(ran.report.certificate, task=filled_task(done), scene=asked.scene)


@pytest.mark.slow
@pytest.mark.physics
def test_the_longer_plan_with_its_numbers_does_the_same_by_itself_and_from_its_checkpoints(done: Rollout) -> None:
    longer = oag.compose(filled_task(done), scene=_among_cans())
    resumed = resume(oag.compose(done.task, scene=_among_cans()), done, 2)
    assert (resumed.state_hash, resumed.detours) == (done.state_hash, done.detours)
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


class _Scripted(Run):
    """Runs nothing: placing finds no place the first time, and what is inserted then goes as it is scripted."""

    inserted_succeed = True

    def subtask(self, index: int, start: Checkpoint, *_: object, **__: object) -> tuple[SubtaskRecord, Checkpoint]:
        self.ran = [*getattr(self, "ran", []), self.task.subtasks[index].name]
        self.recorder.overlaps.append(Overlap(0.001 * len(self.ran), ("a", "b")))
        self.recorder.state_hash = f"after {len(self.ran)} of {self.task.subtasks[index].name}"
        self.simulated_s += 5.0
        good, bad = invented_rollout().subtasks[0], invented_rollout(failed=True).subtasks[-1]
        name = self.task.subtasks[index].name
        placed_before = self.ran.count("put_glass_into_refrigerator") > 1
        fails = not placed_before if name.startswith("put_") else "glass_0" in name and not self.inserted_succeed
        record = replace(bad if fails else good, index=index, name=name)
        return record, replace(start, steps=start.steps + 1250, held="glass_0", state_hash=self.recorder.state_hash)


def _scripted(
    monkeypatch: pytest.MonkeyPatch, *, succeeds: bool, last: int | None = None
) -> tuple[_Scripted, list[Event]]:
    """A run of all T1 whose third subtask finds no place at first."""
    monkeypatch.setattr(
        "executor.rollouts.rollout.found_no_place",
        lambda record, subtask, held: not record.succeeded and subtask.name == "put_glass_into_refrigerator",
    )
    heard: list[Event] = []
    task = graph("kitchen_t1", T1_ROLES, T1_OPEN_FLOWS, "(inside glass_0 refrigerator_0)", {"glass_0": 0.71})
    run = _Scripted(task, library.load("kitchen_t1").with_scales({"glass_0": 0.71}), 0, heard.append)
    run.inserted_succeed = succeeds
    run.from_checkpoint(Checkpoint(b"", (), 0.0, 100, None, None, (), (), ""), 0, last=last)
    return run, heard


@pytest.mark.physics
def test_a_run_goes_back_to_the_time_that_it_says_and_ends_where_it_was_asked_to(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    run, heard = _scripted(monkeypatch, succeeds=True, last=3)
    names = [
        "open_refrigerator",
        "pick_up_glass",
        "set_glass_0_down",
        "take_glass_0_again",
        "put_glass_into_refrigerator",
    ]
    assert [record.name for record in run.subtasks] == names, "the fourth of those asked for was not to be run"
    (event,) = heard
    assert (event.kind, event.subtask, event.subtask_count) == ("revision", 4, 6)
    assert event.simulated_s == pytest.approx((100 + 2 * 1250) * run.physics.timestep_s)
    done = run.finish()
    assert done.inserted == {2, 3} and len(done.asked_for.subtasks) == 4
    (note,) = done.detour_notes
    assert note.startswith(
        "subtasks 3 to 4 (set_glass_0_down and take_glass_0_again) of 6 were inserted on the way: no"
    )


@pytest.mark.physics
def test_what_was_inserted_in_vain_leaves_the_record_as_it_was(monkeypatch: pytest.MonkeyPatch) -> None:
    run, heard = _scripted(monkeypatch, succeeds=False)
    done = run.finish()
    assert [record.name for record in done.subtasks] == [subtask["task_activity_name"] for subtask in T1_ROLES[:3]]
    assert done.detours == () and len(done.task.subtasks) == 4
    assert done.state_hash == "after 3 of put_glass_into_refrigerator" and done.simulated_s == 15.0
    assert len(run.recorder.overlaps) == 3
    assert run.ran[3:] == ["set_glass_0_down"], (
        "there is one other top, and the failed attempt is not run a second time"
    )
    assert [event.subtask_count for event in heard] == [6, 4]
    assert "in vain" in heard[-1].message
