"""No absurd plan is proved, and every sound neighbour of one is; certificates of both pass the independent check."""

from __future__ import annotations

import pytest

import oag
from tests.oag.absurd import ABSURD, SOUND, Plan


def test_the_table_is_large_enough() -> None:
    assert len(ABSURD) >= 30 and len(SOUND) >= 15


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
