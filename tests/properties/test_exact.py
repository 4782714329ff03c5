"""Properties 1 to 4, 6 and 7 for conditions beyond literals: what is said of a plan holds of all its runs."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest
from hypothesis import HealthCheck, event, given, settings
from hypothesis import strategies as st

import oag
from oag.model.symbols import EEF, HAND, NEAR, Fact, Value
from oag.verify.diagnose import Explainer
from oag.verify.verify import verify
from tests.bruteforce import World, consistent, decided, needs
from tests.properties.formulas import BESIDE, FACTS, KINDS, FormulaCase, formula_cases

FEW = settings(max_examples=80, deadline=None, suppress_health_check=[HealthCheck.too_slow])
MANY = settings(max_examples=2000, deadline=None, suppress_health_check=[HealthCheck.too_slow])


def judged(case: FormulaCase, *, exact: bool = False) -> oag.Report | None:
    """The report of a case; None when it is not well formed."""
    task = case.task()
    report = verify(task, case.scene(), exact=True) if exact else oag.compose(task).verify()
    return None if report.trace is None else report


def graded(report: oag.Report) -> list[tuple[Any, str]]:
    """The grades of a report, up to the first obligation that fails."""
    found = [((o.kind, o.subtask, o.step), o.grade.value) for o in report.obligations]
    failed = [index for index, (_, grade) in enumerate(found) if grade == "FAILS"]
    return found[: failed[0] + 1] if failed else found


def check_verdict(case: FormulaCase) -> None:
    """1 and 3: the verdict, and the grade of every obligation up to the first that fails, are those of all runs."""
    report = judged(case)
    if report is None:
        return
    verdict, grades = decided(case.starts(), case.parts, case.goal, KINDS)
    event(verdict)
    if case.loose:
        assert report.verdict.value in (verdict, "CONDITIONAL"), str(report)
        return
    assert (report.verdict.value, graded(report)) == (verdict, grades), str(report)


def check_exact_mode(case: FormulaCase) -> None:
    """4: deciding everything by the solver, what needs no solver included, changes nothing."""
    report, exact = judged(case), judged(case, exact=True)
    if report is None or exact is None:
        return
    assert (report.verdict, graded(report)) == (exact.verdict, graded(exact)), f"{report}\n\n{exact}"


def check_counterexample(case: FormulaCase, flips: list[bool]) -> None:
    """2: from the returned start, whatever it leaves out, the oracle takes the same way and stops at the same place."""
    report = judged(case)
    if report is None or report.verdict is not oag.Verdict.REFUTED:
        return
    found = report.counterexample
    assert found is not None
    state = dict(found.start)
    left_out = [fact for fact in FACTS if fact not in state]
    others = {fact for fact, value in zip(left_out, flips, strict=False) if value}
    world = world_of(state, others) if consistent(world_of(state, others)) else world_of(state, set())
    assert consistent(world)
    assert world in case.starts()
    moments = iter(found.moments)
    for place, holds, after in needs(case.parts, case.goal, KINDS):
        if place == found.stops_at[:3]:
            assert not holds(world)
            assert next(moments, None) is None
            return
        assert holds(world), f"{found}\n{place}\n{report}"
        if after is not None:
            state.update(next(moments).changes)
            world = next(each for each in after(world) if shows(each, state))
    raise AssertionError(f"the run ends before {found.stops_at[:3]}")


def world_of(state: dict[Fact, Value], others: set[Fact]) -> World:
    """The oracle's state for the facts of a start, some others being true as well."""
    arm, _, where = str(state[EEF]).partition(" ")
    hand = str(state[HAND]).partition(" ")[2] or None
    true = frozenset(fact for fact, value in state.items() if value is True)
    return World(true | others, base=str(state[NEAR]), arm=(arm, where), hand=hand)


def shows(world: World, state: dict[Fact, Value]) -> bool:
    """Whether a state has the values given for what may be beside what; others make no difference."""
    return all((fact in world.true) is state[fact] for fact in BESIDE if fact in state)


def check_assumptions(case: FormulaCase) -> None:
    """7: with what is assumed of the start the plan is proved; with any one of it left out it is not."""
    report = judged(case)
    if report is None or report.verdict is not oag.Verdict.CONDITIONAL:
        return
    assert report.trace is not None
    assumed = [a for a in report.trace.assumptions if a.condition is not None]
    assert len(assumed) == len(report.trace.assumptions)
    if not all(a.about_start for a in assumed):
        event("assumes something of a later moment")
        return
    facts = {a.condition.fact: a.condition.positive for a in assumed if a.condition is not None}
    assert verdict_with(case, facts) == "PROVED", str(report)
    # Where it is open what carries what, an answer may be left open that the oracle has.
    for left_out in () if case.loose else facts:
        fewer = {fact: value for fact, value in facts.items() if fact != left_out}
        assert verdict_with(case, fewer) == "CONDITIONAL", f"{left_out} can be left out\n{report}"


def verdict_with(case: FormulaCase, facts: dict[Fact, bool]) -> str:
    """The oracle's verdict over the starts in which some facts have given values."""
    starts = [world for world in case.starts() if all((fact in world.true) is value for fact, value in facts.items())]
    assert starts
    return decided(starts, case.parts, case.goal, KINDS)[0]


def check_conditions_can_hold(case: FormulaCase) -> None:
    """What a CONDITIONAL plan rests on can all be so at once, and each alternative that is named can be so."""
    report = judged(case)
    if report is None or report.verdict is not oag.Verdict.CONDITIONAL:
        return
    starts, trace = case.starts(), report.trace
    assert trace is not None
    assert case.loose or decided(starts, case.parts, case.goal, KINDS)[0] == "CONDITIONAL", str(report)
    of_start = [a.condition for a in trace.assumptions if a.about_start and a.condition is not None]
    assert any(all((c.fact in world.true) is c.positive for c in of_start) for world in starts), str(report)
    explainer = Explainer(report.task, report.scene, trace)
    for assumption in trace.assumptions:
        obligation = trace.obligations[assumption.obligation]
        for other, may_be in explainer.alternatives(assumption.condition, obligation).items():
            written = any(step.effect and other.fact in dict(step.effect) for step in trace.steps)
            if may_be and not written:
                event("an alternative")
                assert any((other.fact in world.true) is other.positive for world in starts), str(report)


def check_monotone(case: FormulaCase) -> None:
    """6: knowing more never takes a verdict of all runs away; knowing less never turns a refutation into a proof."""
    report = judged(case)
    if report is None:
        return
    for fact in case.unknown[:3]:
        for value in (False, True):
            more = replace(case, known={**case.known, fact: value}, unknown=tuple(u for u in case.unknown if u != fact))
            after = judged(more)
            if after is not None and report.verdict is not oag.Verdict.CONDITIONAL:
                assert after.verdict is report.verdict, str(after)
    for fact in list(case.known)[:2]:
        known = {other: value for other, value in case.known.items() if other != fact}
        before = judged(replace(case, known=known, unknown=(*case.unknown, fact)))
        if before is not None and report.verdict is oag.Verdict.REFUTED:
            assert before.verdict is not oag.Verdict.PROVED, str(before)


@given(formula_cases())
@FEW
def test_p1_p3_the_verdict_is_that_of_every_run(case: FormulaCase) -> None:
    check_verdict(case)


@given(formula_cases(), st.lists(st.booleans(), min_size=12, max_size=12))
@FEW
def test_p2_a_counterexample_stops_where_it_says(case: FormulaCase, flips: list[bool]) -> None:
    check_counterexample(case, flips)


@given(formula_cases())
@FEW
def test_p3_what_is_assumed_can_be_so(case: FormulaCase) -> None:
    check_conditions_can_hold(case)


@given(formula_cases())
@settings(FEW, max_examples=60)
def test_p4_the_solver_agrees_with_what_needs_no_solver(case: FormulaCase) -> None:
    check_exact_mode(case)


@given(formula_cases(most_unknown=4))
@settings(FEW, max_examples=30)
def test_p6_knowledge_is_monotone(case: FormulaCase) -> None:
    check_monotone(case)


@given(formula_cases())
@FEW
def test_p7_assumptions_are_enough_and_none_is_spare(case: FormulaCase) -> None:
    check_assumptions(case)


@pytest.mark.slow
@given(formula_cases(most_unknown=9))
@MANY
def test_p1_p3_at_length(case: FormulaCase) -> None:
    check_verdict(case)


@pytest.mark.slow
@given(formula_cases(most_unknown=9))
@MANY
def test_p3_at_length(case: FormulaCase) -> None:
    check_conditions_can_hold(case)


@pytest.mark.slow
@given(formula_cases(most_unknown=12))
@settings(MANY, max_examples=300)
def test_p1_p3_with_much_unknown(case: FormulaCase) -> None:
    check_verdict(case)


@pytest.mark.slow
@given(formula_cases(most_unknown=8), st.lists(st.booleans(), min_size=12, max_size=12))
@MANY
def test_p2_at_length(case: FormulaCase, flips: list[bool]) -> None:
    check_counterexample(case, flips)


@pytest.mark.slow
@given(formula_cases(most_unknown=8))
@MANY
def test_p4_at_length(case: FormulaCase) -> None:
    check_exact_mode(case)


@pytest.mark.slow
@given(formula_cases(most_unknown=5))
@MANY
def test_p6_at_length(case: FormulaCase) -> None:
    check_monotone(case)


@pytest.mark.slow
@given(formula_cases(most_unknown=8))
@MANY
def test_p7_at_length(case: FormulaCase) -> None:
    check_assumptions(case)
