"""T1 and T3 end to end in the physics, on fixed seeds: success, determinism, checkpoints, honesty."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

import oag
from executor.records import Event, FailureKind, PlanRefused, Rollout, RolloutInterrupted
from executor.rollouts.rollout import RunConditions, resume, rollout
from executor.scenes import library
from oag.measurements import measurements_json
from tests.executor.rollouts.tasks import (
    T1_OPEN_FLOWS,
    T1_PAPER_FLOWS,
    T1_ROLES,
    T3_OPEN_FLOWS,
    T3_ROLES,
    graph,
    t1,
    t3,
)

pytestmark = pytest.mark.physics

FASTEST_OBJECT_M_S = 2.0


@pytest.fixture(scope="module")
def t3_rollout() -> Iterator[Rollout]:
    """One run of T3, recorded at 20 Hz."""
    yield rollout(t3(), seed=1, conditions=RunConditions(record_hz=20.0))


def test_t1_succeeds_and_says_how(t1_rollout: Rollout) -> None:
    assert t1_rollout.failure is None
    assert t1_rollout.succeeded
    assert [subtask.succeeded for subtask in t1_rollout.subtasks] == [True] * 4
    by_literal = {reading.literal: reading for reading in t1_rollout.goal_readings}
    assert by_literal["(inside glass_0 refrigerator_0)"].value is True
    assert by_literal["(open refrigerator_0)"].value is False
    for subtask in t1_rollout.subtasks:
        assert not any(action.unfilled for action in subtask.flow), "the flow must come back with its numbers"


def test_nothing_jumps_and_the_door_moves_by_the_handle(t1_rollout: Rollout) -> None:
    trajectory = t1_rollout.trajectory
    dt_s = np.diff(trajectory.time_s)
    for poses in (*trajectory.object_poses.values(), trajectory.eef_pose):
        speed = np.linalg.norm(np.diff(poses[:, :3], axis=0), axis=1) / dt_s
        assert speed.max() < FASTEST_OBJECT_M_S
    door = trajectory.joint_positions["refrigerator_0"][:, 0]
    moving = np.abs(np.diff(door)) > np.deg2rad(1.0)
    names = [step.primitive for subtask in t1_rollout.subtasks for step in subtask.steps]
    assert "ARTICULATE_OPEN" in names and "ARTICULATE_CLOSE" in names
    flows = [[step.primitive for step in subtask.steps] for subtask in t1_rollout.subtasks]
    for k in np.flatnonzero(moving):
        subtask, step = trajectory.subtask[k + 1], trajectory.step[k + 1]
        assert step >= 0 and flows[subtask][step].startswith("ARTICULATE"), "the door moved without the hand"


def test_the_glass_is_carried_by_friction_not_attached(t1_rollout: Rollout) -> None:
    """While held, the glass must follow the hand with small slip: neither rigidly exact nor lost."""
    trajectory = t1_rollout.trajectory
    carrying = trajectory.subtask == 2
    first_release = np.flatnonzero(carrying & (trajectory.robot_target[:, 10] > 0.02))[0]
    held = np.flatnonzero(carrying)[: first_release - np.flatnonzero(carrying)[0]]
    gap = np.linalg.norm(trajectory.object_poses["glass_0"][held, :3] - trajectory.eef_pose[held, :3], axis=1)
    assert np.ptp(gap) < 0.01
    assert np.ptp(gap) > 0.0


def test_resuming_from_a_checkpoint_ends_in_the_same_state(t1_rollout: Rollout) -> None:
    again = resume(t1(), t1_rollout, 3)
    assert again.state_hash == t1_rollout.state_hash
    assert again.succeeded
    assert [s.state_hash for s in again.subtasks] == [s.state_hash for s in t1_rollout.subtasks]


@pytest.mark.slow
def test_another_process_gets_the_same_hash(t3_rollout: Rollout) -> None:
    code = (
        "from executor.rollouts.rollout import RunConditions, rollout\n"
        "from tests.executor.rollouts.tasks import t3\n"
        "print(rollout(t3(), seed=1, conditions=RunConditions(record_hz=20.0)).state_hash)\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=600, check=True)
    assert done.stdout.split()[-1] == t3_rollout.state_hash


@pytest.mark.slow
def test_t3_succeeds_and_another_seed_is_another_run(t3_rollout: Rollout) -> None:
    second = rollout(t3(), seed=2)
    assert t3_rollout.succeeded, t3_rollout.failure
    assert second.succeeded, second.failure
    assert t3_rollout.state_hash != second.state_hash


@pytest.mark.slow
def test_the_papers_literal_numbers_run_as_written_and_leave_the_door_ajar() -> None:
    done = rollout(t1(T1_PAPER_FLOWS), seed=0)
    flows = [[step.action for step in subtask.steps] for subtask in done.subtasks]
    assert flows[2] == [18, {"13": 0.4}, {"9": 0.1}, 5]
    assert flows[3][4] == {"19": [0.0, 0.5]}
    assert [subtask.succeeded for subtask in done.subtasks] == [True, True, True, False]
    assert not done.succeeded
    assert done.failure is not None and done.failure.kind is FailureKind.GOAL_NOT_REACHED
    assert 0.2 < measurements_json(done.subtasks[3].steps[4].measurements)["fraction_reached"] < 0.5


def test_a_thing_wider_than_the_gripper_is_a_typed_failure() -> None:
    with pytest.raises(PlanRefused, match="task/size"):
        rollout(t3(scale=0.70), seed=0)
    # Proved for the apple that was thought of, run with a larger one.
    graph = t3(scale=0.62)
    done = rollout(graph, graph.scene.with_scales({"apple_0": 0.70 / 0.62}), seed=0)
    assert done.failure is not None
    assert done.failure.kind is FailureKind.TOO_WIDE
    assert "56 mm" in done.failure.message
    assert len(done.subtasks) == 1


def test_a_refuted_plan_moves_nothing() -> None:
    flows = [T1_OPEN_FLOWS[0], [17, 1, 2, {"7": None}], *T1_OPEN_FLOWS[2:]]
    events: list[Event] = []
    with pytest.raises(PlanRefused) as refusal:
        rollout(t1(flows), listen=events.append)
    assert events == []
    assert "REFUTED" in str(refusal.value)


@pytest.mark.slow
def test_an_interrupted_rollout_keeps_what_was_done() -> None:
    def stop_in_the_second_subtask(event: Event) -> None:
        if event.subtask == 1 and event.name == "CONVERGE":
            raise KeyboardInterrupt

    with pytest.raises(RolloutInterrupted) as interrupt:
        rollout(t1(), seed=1, listen=stop_in_the_second_subtask)
    partial = interrupt.value.partial
    assert [subtask.name for subtask in partial.subtasks] == ["open_refrigerator"]
    assert partial.subtasks[0].succeeded
    assert not partial.succeeded
    assert len(partial.trajectory.time_s) == len(partial.trajectory.packed_states) > 100


@pytest.mark.parametrize(
    ("extra", "kind", "told"),
    [
        ({"13": 1.2}, FailureKind.COLLISION, "refrigerator_0"),
        ({"9": 1.3}, FailureKind.UNREACHABLE, "of 1.3 m along MOVE_EEF_FORWARD"),
    ],
)
def test_numbers_that_lead_astray_stop_with_a_measured_reason(
    extra: dict[str, float], kind: FailureKind, told: str
) -> None:
    flows = [[extra, *T1_OPEN_FLOWS[0]], *T1_OPEN_FLOWS[1:]]
    done = rollout(t1(flows), seed=0, vary=False)
    assert done.failure is not None
    assert done.failure.kind is kind
    assert told in done.failure.message
    assert done.failure.measurements
    assert len(done.subtasks) == 1 and len(done.subtasks[0].steps) == 1


@pytest.mark.slow
def test_resuming_keeps_the_rate_of_recording(t3_rollout: Rollout) -> None:
    again = resume(t3(), t3_rollout, 1)
    assert again.state_hash == t3_rollout.state_hash
    recorded_s = again.trajectory.time_s
    assert np.array_equal(recorded_s, t3_rollout.trajectory.time_s[-len(recorded_s) :])


@pytest.mark.slow
def test_a_goal_with_a_quantifier_is_judged_over_the_scenes_objects() -> None:
    goal = (
        "(and (forall (?a - apple) (inside ?a bowl_0)) (exists (?b - bowl) (inside apple_0 ?b))"
        " (forn (1) (?x - object) (inside ?x bowl_0)) (forpairs (?a - apple) (?b - bowl) (inside ?a ?b)))"
    )
    done = rollout(graph("kitchen_t3", T3_ROLES, T3_OPEN_FLOWS, goal, {"apple_0": 0.62}), seed=4)
    assert [reading.value for reading in done.goal_readings] == [True, True, True, True]
    assert done.succeeded


def test_a_handle_stays_in_the_hand_across_subtasks() -> None:
    flows = [[17, 1, 2, 3, {"4": None}], [{"19": None}, 5, 6]]
    roles = [T1_ROLES[0], T1_ROLES[3]]
    done = rollout(graph("kitchen_t1", roles, flows, "(not (open refrigerator_0))", {}), seed=0)
    assert done.succeeded, done.failure


def test_driving_off_with_a_handle_in_the_hand_is_refused() -> None:
    flows = [[17, 1, 2, 3, {"4": None}], [17, 1, 2, {"19": None}, 5, 6]]
    roles = [T1_ROLES[0], T1_ROLES[3]]
    done = rollout(graph("kitchen_t1", roles, flows, "(not (open refrigerator_0))", {}), seed=0)
    assert done.failure is not None and done.failure.kind is FailureKind.PRECONDITION
    assert "UNGRASP" in done.failure.message


def test_a_plan_that_rests_on_something_unknown_moves_nothing() -> None:
    scene = library.load("kitchen_t3")
    unknown = replace(scene, facts=(), closed=frozenset())
    task = oag.Task.from_json(t3().task.to_json(), scene=unknown)
    with pytest.raises(PlanRefused, match="not proved"):
        rollout(oag.compose(task))
