"""The task goal that is read off the subtasks refutes no plan for what its later subtasks are there to do."""

from __future__ import annotations

from dataclasses import replace

from hypothesis import HealthCheck, event, given, settings
from hypothesis import strategies as st

import oag
from oag.model.symbols import held_by
from tests.properties.plans import ITEMS, RESTING_FACTS, Case, carrying, cases

FEW = settings(max_examples=100, deadline=None, suppress_health_check=[HealthCheck.too_slow])


def verified(case: Case, goal: str | None) -> oag.Report:
    """The report on a random plan with another task goal, or with none."""
    data = {key: value for key, value in case.task_json().items() if key != "goal"}
    data |= {} if goal is None else {"goal": goal}
    return oag.compose(oag.Task.from_json(data, scene=case.scene())).verify()


@st.composite
def journeys(draw: st.DrawFn) -> Case:
    """Items carried from place to place, one after the other, or a plan that may be anything."""
    case = draw(cases(most_unknown=0))
    if draw(st.booleans()):
        return case
    parts = []
    resting = {item: draw(st.sampled_from([fact for fact in RESTING_FACTS if fact[1] == item])) for item in ITEMS}
    known = {fact: fact in resting.values() for fact in case.known}
    for _ in range(draw(st.integers(1, 4))):
        item = draw(st.sampled_from(ITEMS))
        there = draw(st.sampled_from([("ontop", "table_0"), ("inside", "fridge_0"), ("ontop", "cabinet_0")]))
        journey = carrying(item, resting[item], there[1], there[0])
        if draw(st.booleans()):
            held = ((("inside", item, "gripper"), True),)
            journey = tuple(replace(p, goal=held) if p.flow[-1] == 7 else p for p in journey)
        parts.extend(journey)
        resting[item] = (there[0], item, there[1])
    return replace(case, known=known, parts=tuple(parts))


@given(journeys())
@FEW
def test_a_plan_that_runs_through_misses_its_own_goal_by_accident_only(case: Case) -> None:
    if verified(case, "(and)").verdict is not oag.Verdict.PROVED:
        return
    report = verified(case, None)
    event(report.verdict.value)
    if report.verdict is oag.Verdict.PROVED:
        return
    trace = report.trace
    assert trace is not None and trace.failures
    for failure in trace.failures:
        assert failure.condition is not None
        thing = held_by(failure.condition.value) or failure.condition.fact[1]
        writer = trace.steps[failure.entry.time // 2 - 1].subtask
        assert report.task.subtasks[writer].target != thing, str(report)
