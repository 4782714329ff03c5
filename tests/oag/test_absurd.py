"""No absurd plan is proved, and every sound neighbour of one is; certificates of both pass the independent check."""

from __future__ import annotations

import json
from collections import Counter
from dataclasses import replace

import pytest

import oag
from tests.oag.absurd import ABSURD, SOUND, Plan
from tests.oag.paper import DATA


def test_the_table_is_large_enough() -> None:
    assert len(ABSURD) >= 30 and len(SOUND) >= 15


def test_a_plan_validator_s_answers_stand_beside_the_table() -> None:
    """By unified-planning 1.3 for the same plans in plain STRIPS (`benchmarks/absurd_plans.py`)."""
    answers = json.loads((DATA / "absurd_unified_planning.json").read_text(encoding="utf-8"))
    assert list(answers) == [plan.name for plan in (*ABSURD, *SOUND)]
    assert Counter(answers[plan.name] for plan in ABSURD) == {"VALID": 32, "INVALID": 5}
    assert Counter(answers[plan.name] for plan in SOUND) == {"VALID": 19, "INVALID": 5}


@pytest.mark.parametrize("plan", ABSURD, ids=lambda plan: plan.name)
def test_an_absurd_plan_is_not_proved(plan: Plan) -> None:
    report = oag.compose(plan.task()).verify()
    assert report.verdict is not oag.Verdict.PROVED, str(report)
    assert report.diagnostics
    if report.certificate is not None:
        result = oag.recheck(report.certificate)
        assert result, result.reason


@pytest.mark.parametrize("plan", SOUND, ids=lambda plan: plan.name)
def test_a_sound_neighbour_is_proved(plan: Plan) -> None:
    report = oag.compose(plan.task()).verify()
    assert report.verdict is oag.Verdict.PROVED, str(report)
    result = oag.recheck(report.certificate, task=report.task, scene=report.scene)
    assert result, result.reason


@pytest.mark.parametrize(
    ("parameters", "opens"),
    [
        ({}, False),
        ({"color": "black"}, False),
        ({"legs": 3}, False),
        ({"open_fraction": 0.0}, True),
        ({"hinge": "left"}, True),
    ],
    ids=str,
)
def test_a_thing_of_unknown_kind_opens_where_a_parameter_is_of_a_joint(
    parameters: dict[str, object], opens: bool
) -> None:
    plan = next(plan for plan in ABSURD if plan.name == "a piano is opened")
    scene = plan.scene()
    scene = replace(scene, objects={"piano_0": replace(scene["piano_0"], parameters=parameters)})
    report = oag.compose(oag.Task.from_json(plan.task().to_json(), scene=scene)).verify()
    assert ("bddl/kind" not in [error.code for error in report.errors]) is opens, str(report)
