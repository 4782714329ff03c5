"""Property 26: every fix that is offered verifies, and does in an independent simulation what it says."""

from __future__ import annotations

import pytest
from hypothesis import HealthCheck, event, given, settings

import oag
from tests.bruteforce import completions, run
from tests.oag.mutants import parts_of
from tests.properties.plans import KINDS, Case, cases

FEW = settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.too_slow])
MANY = settings(max_examples=2000, deadline=None, suppress_health_check=[HealthCheck.too_slow])


def check_fixes(case: Case) -> None:
    """26: a fix that is said to prove the plan does; any other removes its mistake and nothing else breaks."""
    report = oag.compose(case.task()).verify()
    event(f"{report.verdict.value}, {'with' if report.fixes else 'without'} fixes")
    if report.verdict is not oag.Verdict.REFUTED:
        assert report.fixes == ()
    for fix in report.fixes:
        task, scene = fix.apply(report.task), fix.apply_to_scene(report.scene)
        after = oag.compose(task, scene).verify()
        assert bool(after) is fix.proves, str(after)
        assert len(after.errors) == fix.remaining
        if fix.proves and not fix.assumption:
            parts = parts_of(task.to_json())
            # The reset puts the robot at the first target, which may be another one now.
            starts = completions(case.known, case.unknown, parts[0].target if parts else None)
            if fix.kind not in ("change-task-goal", "several"):
                assert all(run(start, parts, case.goal, KINDS) is None for start in starts), str(fix)


def check_stable(case: Case) -> None:
    """The same plan has the same fixes, and the certificate of a repaired plan passes."""
    first, second = (oag.compose(case.task()).verify() for _ in range(2))
    assert [str(fix) for fix in first.fixes] == [str(fix) for fix in second.fixes]
    for fix in first.fixes[:1]:
        after = oag.compose(fix.apply(first.task), fix.apply_to_scene(first.scene)).verify()
        if after.certificate is not None:
            assert oag.recheck(after.certificate)


@given(cases(most_unknown=2))
@FEW
@pytest.mark.slow
def test_p26_every_offered_fix_verifies(case: Case) -> None:
    check_fixes(case)


@given(cases(most_unknown=1))
@settings(FEW, max_examples=20)
def test_fixes_are_the_same_every_time(case: Case) -> None:
    check_stable(case)


@pytest.mark.slow
@given(cases(most_unknown=4))
@MANY
def test_p26_at_length(case: Case) -> None:
    check_fixes(case)
