"""Right plans in the manner of others: what is kept of it, and what comes of it in our rooms."""

from __future__ import annotations

from dataclasses import replace

import pytest

from benchmarks.baselines import constraint_pose, sampled_grasp
from benchmarks.baselines.methods import baseline_version, run_baseline
from executor.bench.units import BenchSetting, Unit
from executor.campaign.versions import outcome_version
from executor.planning.planner import MOVES
from executor.skills.library import LIBRARY
from oag import Primitive

OPEN = Unit("T5", 62000, 0, BenchSetting(baseline="constraint-pose"))
HEMMED_IN = replace(OPEN, index=3)
"""A cabinet before whose handle the base has no room."""


def test_only_what_makes_up_a_manner_is_done_otherwise() -> None:
    constrained, sampled = constraint_pose.LIBRARY_OF_CONSTRAINTS, sampled_grasp.LIBRARY_OF_SAMPLES
    assert set(constrained) == set(sampled) == set(Primitive) == set(LIBRARY)
    taking = {Primitive.CONVERGE, Primitive.GRASP, Primitive.UNGRASP, Primitive.RETREAT}
    assert all(library[primitive] is LIBRARY[primitive] for library in (constrained, sampled) for primitive in taking)
    assert all(constrained[primitive] is LIBRARY[primitive] for primitive in MOVES)
    left_out = {primitive for primitive in Primitive if sampled[primitive] is sampled_grasp.skip_primitive}
    assert left_out == {
        Primitive.ARTICULATE_OPEN,
        Primitive.ARTICULATE_CLOSE,
        Primitive.NAVIGATE_TO_SUPPORT,
        *MOVES,
    }


def test_results_of_baselines_have_a_version_of_their_own() -> None:
    assert baseline_version() == baseline_version() != outcome_version()


def test_where_there_is_no_room_nothing_else_is_tried() -> None:
    result = run_baseline(HEMMED_IN)
    assert result["ended"] == "failed" and result["failure"]["kind"] == "unreachable"
    assert result["failure"]["primitive"] == "NAVIGATE_TO_TARGET"
    assert (result["grasps_tried"], result["grasps_held"], result["taken_twice"]) == (0, 0, 0)


@pytest.mark.slow
def test_a_stroke_opens_a_door_and_leaving_it_out_does_not() -> None:
    opened = run_baseline(OPEN)
    assert opened["ended"] == "succeeded" and opened["grasps_held"] == 1
    grasped = run_baseline(replace(OPEN, setting=BenchSetting(baseline="sampled-grasp")))
    assert grasped["ended"] == "failed" and grasped["failure"]["kind"] == "goal-not-reached"
    assert (grasped["grasps_tried"], grasped["grasps_held"]) == (1, 1)
    assert run_baseline(OPEN)["state_hash"] == opened["state_hash"]
