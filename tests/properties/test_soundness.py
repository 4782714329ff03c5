"""Properties 1 to 4, 6 and 7: verdicts against a simulation of every complete start state."""

from __future__ import annotations

from dataclasses import replace

import pytest
from hypothesis import HealthCheck, event, given, settings

import oag
from tests.bruteforce import World, decided, run
from tests.properties.plans import KINDS, Case, cases

FEW = settings(max_examples=100, deadline=None, suppress_health_check=[HealthCheck.too_slow])
MANY = settings(max_examples=2000, deadline=None, suppress_health_check=[HealthCheck.too_slow])


def ends(case: Case) -> list[tuple[World, tuple[str, int, int] | None]]:
    """Every complete start state with the first place where the plan fails from it."""
    return [(start, run(start, case.parts, case.goal, KINDS)) for start in case.starts()]


def check_verdict(case: Case) -> None:
    """1, 3 and 4: PROVED means that every start succeeds, REFUTED that none does, CONDITIONAL that some do."""
    report = oag.compose(case.task()).verify()
    outcomes = ends(case)
    event(report.verdict.value)
    verdict, grades = decided(case.starts(), case.parts, case.goal, KINDS)
    if not (case.loose and report.verdict is oag.Verdict.CONDITIONAL):
        assert report.verdict.value == verdict, str(report)
    if not case.loose:
        found = [((o.kind, o.subtask, o.step), o.grade.value) for o in report.obligations]
        assert found[: len(grades)] == grades, str(report)
    if report.verdict is oag.Verdict.PROVED:
        assert all(failed is None for _, failed in outcomes), str(report)
    if report.verdict is oag.Verdict.REFUTED:
        assert all(failed is not None for _, failed in outcomes), str(report)
    if outcomes and all(failed is None for _, failed in outcomes):
        assert report.verdict is not oag.Verdict.REFUTED
    if outcomes and not case.unknown:
        # A start that is completely known leaves nothing open, so the two verdicts have to be the same.
        assert bool(report) is (outcomes[0][1] is None), str(report)


def check_place(case: Case) -> None:
    """2: from every start that meets the assumptions, the plan stops where the refutation says."""
    report = oag.compose(case.task()).verify()
    if report.verdict is not oag.Verdict.REFUTED:
        return
    assert report.trace is not None and report.certificate is not None
    failure = report.certificate.to_json()["failure"]
    first = report.trace.failures[0].obligation
    assumed = [a.condition for a in report.trace.assumptions if a.obligation <= first and a.about_start]
    for start, failed in ends(case):
        if all(c is None or start.holds((c.fact, c.positive)) for c in assumed):
            assert failed is not None and list(failed) == failure, str(report)


def check_monotone(case: Case) -> None:
    """6: knowing more never takes a proof away; knowing less never makes one of a refutation."""
    before = oag.compose(case.task()).verify().verdict
    for fact in case.unknown:
        for value in (False, True):
            more = replace(case, known={**case.known, fact: value}, unknown=tuple(u for u in case.unknown if u != fact))
            after = oag.compose(more.task()).verify()
            if after.trace is None:
                continue
            if before is oag.Verdict.PROVED:
                assert after.verdict is oag.Verdict.PROVED, str(after)
            if before is oag.Verdict.REFUTED:
                assert after.verdict is oag.Verdict.REFUTED, str(after)
    for fact in list(case.known)[:3]:
        closed = tuple(name for name in case.closed if name != fact[0])
        known = {k: v for k, v in case.known.items() if k != fact}
        fewer = replace(case, known=known, unknown=(*case.unknown, fact), closed=closed)
        if before is oag.Verdict.REFUTED:
            assert oag.compose(fewer.task()).verify().verdict is not oag.Verdict.PROVED


@given(cases())
@FEW
def test_p1_p4_verdicts_agree_with_every_start_state(case: Case) -> None:
    check_verdict(case)


@given(cases())
@FEW
def test_p2_refutations_stop_where_they_say(case: Case) -> None:
    check_place(case)


@given(cases(most_unknown=3))
@settings(FEW, max_examples=40)
def test_p6_knowledge_is_monotone(case: Case) -> None:
    check_monotone(case)


@given(cases(most_unknown=4))
@settings(FEW, max_examples=100)
def test_p7_adding_the_assumptions_gives_a_proof(case: Case) -> None:
    check_assumptions(case)


def check_assumptions(case: Case) -> None:
    """7: with its assumptions stated a plan is proved, and with any one of them left out it is not."""
    report = oag.compose(case.task()).verify()
    if report.verdict is not oag.Verdict.CONDITIONAL:
        return
    assert report.trace is not None
    facts = {a.condition.fact: a.condition.positive for a in report.trace.assumptions if a.condition is not None}
    known = {**case.known, **facts}
    if any(value and known.get((f[0], f[2], f[1])) for f, value in known.items() if len(f) == 3):
        return
    full = replace(case, known=known, unknown=tuple(f for f in case.unknown if f not in facts))
    assert oag.compose(full.task()).verify().verdict is oag.Verdict.PROVED
    for left_out in facts:
        fewer = {fact: value for fact, value in known.items() if fact != left_out}
        case_without = replace(case, known=fewer, unknown=(*full.unknown, left_out))
        assert oag.compose(case_without.task()).verify().verdict is not oag.Verdict.PROVED


@pytest.mark.slow
@given(cases(most_unknown=8))
@MANY
def test_p1_p2_p4_at_length(case: Case) -> None:
    check_verdict(case)
    check_place(case)


@pytest.mark.slow
@given(cases(most_unknown=3))
@MANY
def test_p6_at_length(case: Case) -> None:
    check_monotone(case)


@pytest.mark.slow
@given(cases(most_unknown=4))
@MANY
def test_p7_at_length(case: Case) -> None:
    check_assumptions(case)
