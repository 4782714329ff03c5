"""The inspector without a model: the three parts of a critique, and which step is blamed for what."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from llm.evolve import AttemptObservation, GoalReading, Inspector, MeasuredInspector, Miss, StepObservation
from llm.evolve.diagnosis import CauseKind, diagnose
from oag.measurements import AtomMeasured
from oag.revision import Attempt, Critique
from tests.llm.evolve.attempts import measured, paper_task

CLOSED = "(open refrigerator_0)"
INSIDE = "(inside glass_0 refrigerator_0)"


def attempt(subtask: int, *steps: dict[str, Any], goal: tuple[GoalReading, ...]) -> AttemptObservation:
    """Return an attempt at a subtask of T1 in which some steps ran, each with what is told of it."""
    task = paper_task("T1")
    flow = task.subtasks[subtask].flow or ()
    seen = tuple(StepObservation(n, flow[n], flow[n], **_records(told)) for n, told in enumerate(steps))
    return AttemptObservation(task, subtask, flow, seen, goal)


def _records(told: dict[str, Any]) -> dict[str, Any]:
    numbers = ("measurements", "failure_measurements")
    return told | {key: measured(**told[key]) for key in numbers if key in told}


def critiques(seen: AttemptObservation) -> list[Critique]:
    return [MeasuredInspector().inspect(seen, step) for step in range(len(seen.steps))]


def blamed(seen: AttemptObservation) -> tuple[int, CauseKind] | None:
    """Return the step and the kind of the root cause."""
    cause = diagnose(Attempt(seen.flow, "failed", critiques=tuple(critiques(seen))))
    return None if cause is None else (cause.step, cause.kind)


def door(fraction: float, *, wanted_open: bool = False) -> tuple[GoalReading, ...]:
    return (GoalReading(CLOSED, wanted_open, fraction > 0.05, AtomMeasured(open_fraction=fraction), "open"),)


def test_it_is_an_inspector() -> None:
    assert isinstance(MeasuredInspector(), Inspector)


def test_a_door_left_ajar_is_the_articulations_fault() -> None:
    """The goal is judged at the end of the flow, two steps later."""
    ran = {"before": door(0.85), "after": door(0.85)}
    short = {"before": door(0.85), "after": door(0.35), "measurements": {"fraction_reached": 0.35}}
    last = {"before": door(0.35), "after": door(0.35), "failure": "goal-not-reached", "message": "it is open"}
    seen = attempt(3, ran, ran, ran, ran, short, last, goal=door(0.35))
    told = critiques(seen)
    assert [critique.finds_fault for critique in told[:5]] == [False, False, False, False, True]
    assert told[4].motion_verified is True and told[4].state_reached is False and told[4].anomaly is None
    assert told[4].text == (
        "ARTICULATE_CLOSE(0, 0.5) ran as asked, but (not (open refrigerator_0)) does not hold after it."
    )
    assert told[4].state_contrast == "(not (open refrigerator_0)) does not hold (open_fraction 0.35)"
    assert blamed(seen) == (4, CauseKind.JOINT_SHORT)


def test_a_collision_is_an_anomaly_and_its_steps_fault() -> None:
    miss = Miss(INSIDE, 0.2, 0.0, 0.0, 0.3, -0.1)
    hit = {
        "failure": "unexpected-contact",
        "message": "panda_link5 ran into refrigerator_0 (body) with 40 N",
        "measurements": {"asked_m": 0.4, "eef_moved_m": 0.2},
        "failure_measurements": {"mover": "panda_link5", "other": "refrigerator_0"},
        "misses_after": (miss,),
    }
    seen = attempt(2, {}, hit, goal=(GoalReading(INSIDE, True, False),))
    told = critiques(seen)[1]
    assert told.motion_verified is False
    assert told.anomaly == "panda_link5 ran into refrigerator_0 (body) with 40 N"
    assert told.evidence.misses == (miss,)
    assert blamed(seen) == (1, CauseKind.BLOCKED)


def test_what_is_let_go_in_the_wrong_place_is_the_releases_fault_where_it_was_before_it_fell() -> None:
    near, far = Miss(INSIDE, 0.04, 0.0, 0.0), Miss(INSIDE, 0.1, 0.1, 0.7)
    fell = {
        "failure": "dropped",
        "message": "glass_0 fell 70 cm when the gripper opened",
        "misses_before": (near,),
        "misses_after": (far,),
    }
    seen = attempt(2, {}, {}, {}, fell, goal=(GoalReading(INSIDE, True, False),))
    assert critiques(seen)[3].evidence.misses == (near,)
    assert blamed(seen) == (3, CauseKind.MISPLACED)


def test_a_stance_that_leads_nowhere_comes_before_the_collision_that_follows() -> None:
    nominal = {"measurements": {"stance": "nominal: the flow's numbers reach no free spot"}}
    hit = {"failure": "unexpected-contact", "message": "base_body ran into table_0 (table) with 2846 N"}
    seen = attempt(2, nominal, hit, goal=(GoalReading(INSIDE, True, False),))
    assert blamed(seen) == (0, CauseKind.NOWHERE)
    assert "lead to no free spot" in critiques(seen)[0].text


@pytest.mark.parametrize(
    ("failure", "kind"),
    [
        ("unreachable", CauseKind.OUT_OF_REACH),
        ("no-collision-free-path", CauseKind.NO_WAY),
        ("side-effect", CauseKind.DISPLACED),
        ("stalled", CauseKind.BLOCKED),
        ("slipped", CauseKind.GRIP_LOST),
        ("precondition", CauseKind.OUT_OF_ORDER),
        ("too-wide-for-gripper", CauseKind.TOO_WIDE),
        ("grasp-missed", CauseKind.GRASP_MISSED),
        ("dropped", CauseKind.GRIP_LOST),
        ("unexpected-contact", CauseKind.BLOCKED),
        ("timeout", CauseKind.TOO_LONG),
    ],
)
def test_every_kind_of_failure_has_its_cause(failure: str, kind: CauseKind) -> None:
    seen = attempt(2, {}, {"failure": failure, "message": "so"}, goal=())
    assert blamed(seen) == (1, kind)


def test_what_the_aim_was_off_by_explains_the_missed_grasp() -> None:
    converged = {"measurements": {"target_left_m": 0.02}}
    missed = {"failure": "grasp-missed", "message": "1 of 2 fingers touch glass_0", "failure_measurements": {}}
    seen = attempt(1, {}, {}, converged, missed, goal=())
    cause = diagnose(Attempt(seen.flow, "failed", critiques=tuple(critiques(seen))))
    assert cause is not None and cause.kind is CauseKind.GRASP_MISSED
    assert cause.off_the_aim_m == (0.0, 0.02)


def test_a_step_that_did_what_it_should_is_told_so() -> None:
    opened = {"before": door(0.0, wanted_open=True), "after": door(0.85, wanted_open=True)}
    seen = attempt(0, {}, {}, {}, opened, goal=door(0.85, wanted_open=True))
    told = critiques(seen)[3]
    assert not told.finds_fault and told.state_reached is True
    assert told.state_contrast == "(open refrigerator_0) became true"
    assert blamed(replace(seen, steps=seen.steps[:3])) is None


def test_what_is_let_go_and_still_touched_is_no_miss() -> None:
    """A glass that stands where it should, and leans on a finger when the flow ends."""
    lacking = (GoalReading(INSIDE, True, False, AtomMeasured(touching=True, fingers_touching=1)),)
    last = {"failure": "goal-not-reached", "misses_before": (Miss(INSIDE, 0.0, 0.0, 0.0, 0.1, 0.0),)}
    seen = attempt(2, {}, {}, {}, last, goal=lacking)
    assert blamed(seen) == (3, CauseKind.STILL_TOUCHED)
    fallen = (GoalReading(INSIDE, True, False, AtomMeasured(touching=False)),)
    assert blamed(attempt(2, {}, {}, {}, last, goal=fallen)) == (3, CauseKind.MISPLACED)
