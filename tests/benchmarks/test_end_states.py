"""Ends of plans: a goal that does not hold contradicts the proof, and a step that failed says nothing of it."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

import bddl
from benchmarks.end_states import Compared, compared, finished_units
from executor.campaign.versions import outcome_version
from executor.records import Failure, FailureKind
from oag.measurements import GoalReading

FACTS = (bddl.Atom("open", ("box_0",)), bddl.Not(bddl.Atom("open", ("box_1",))))
HOLDS, BROKEN = GoalReading("(open box_0)", True, True), GoalReading("(open box_1)", False, True)


def ran(failure: FailureKind | None, readings: tuple[GoalReading, ...], at_end: tuple[GoalReading, ...]) -> Any:
    ended = None if failure is None else Failure(failure, "why")
    return SimpleNamespace(failure=ended, subtasks=(SimpleNamespace(readings=readings),), goal_readings=at_end)


@pytest.mark.parametrize(
    ("rollout", "expected"),
    [
        (ran(None, (HOLDS,), (HOLDS, GoalReading("(open box_1)", False, False))), Compared(2, 1, ())),
        (ran(None, (HOLDS,), (HOLDS, BROKEN)), Compared(2, 1, ("(not (open box_1))",))),
        (ran(FailureKind.GOAL_NOT_REACHED, (HOLDS, BROKEN), ()), Compared(2, 1, ("(not (open box_1))",))),
        (ran(FailureKind.SLIPPED, (BROKEN,), ()), Compared(0, 0, (), "why")),
    ],
)
def test_only_a_step_that_failed_ends_a_comparison_early(rollout: Any, expected: Compared) -> None:
    assert compared(rollout, FACTS) == expected


def test_finished_units_are_kept_and_a_cut_line_is_dropped(tmp_path: Path) -> None:
    path = tmp_path / "units.jsonl"
    unit = {"version": outcome_version(), "seed": 1, "cargo": True, "cpu_s": 2.0}
    path.write_text(f'{json.dumps(unit)}\n{json.dumps(unit | {"version": "other", "seed": 2})}\n{{"seed": 3, ')
    assert finished_units(path) == {(1, True): unit}
    assert path.read_text().count("\n") == 2 and path.read_text().endswith("\n")
