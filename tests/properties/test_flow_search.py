"""Property 5: a flow is found exactly when a search through all complete states finds one."""

from __future__ import annotations

from dataclasses import replace

import pytest
from hypothesis import HealthCheck, event, given, settings
from hypothesis import strategies as st

import oag
from oag.flows import TEMPLATES
from tests.bruteforce import Fact, Part, World, added, reachable, run
from tests.properties.plans import FACTS, FIXTURES, ITEMS, KINDS, RESTING_FACTS, SURFACES, Case, legal, parts

FEW = settings(max_examples=100, deadline=None, suppress_health_check=[HealthCheck.too_slow])
MANY = settings(max_examples=2000, deadline=None, suppress_health_check=[HealthCheck.too_slow])
# A flow with these can do whatever any flow can: all other moves write what 9 writes.
ACTIONS = (1, 2, 3, 4, 5, 6, 7, 9, 17, 18, 19)


@st.composite
def starts(draw: st.DrawFn, most_unknown: int = 0) -> Case:
    """One subtask without a flow, its goal perhaps about anything, in any start; sometimes something is held."""
    part = replace(draw(parts()), flow=(), init=())
    if draw(st.booleans()):
        facts = draw(st.lists(st.sampled_from(FACTS), min_size=1, max_size=2, unique=True))
        goal = tuple((fact, draw(st.booleans())) for fact in facts)
        if not (len(goal) == 2 and goal[0][0][::2] == goal[1][0][::2][::-1]):
            part = replace(part, goal=goal)
        part = replace(
            part, support=part.place[1] if part.place else draw(st.sampled_from((None, *SURFACES, *FIXTURES)))
        )
    true = frozenset[Fact]()
    for fact in sorted(draw(st.sets(st.sampled_from(FACTS), max_size=4))):
        true = added(true, fact)
    unknown = draw(st.sets(st.sampled_from(FACTS), max_size=most_unknown)) if most_unknown else set()
    known = {fact: fact in true for fact in FACTS if fact not in unknown}
    return Case(known, tuple(sorted(unknown)), (part,), ())


def sound(part: Part) -> bool:
    """Whether a subtask is well formed whatever its flow."""
    supports = part.support is None or part.support != part.target
    true = {fact for fact, value in part.goal if value}
    clash = true & {fact for fact, value in part.goal if not value}
    converse = any(len(f) == 3 and ((f[0], f[2], f[1]) in true or f[1] == f[2]) for f in true)
    placed = part.place is None or part.place[1] == part.support
    return supports and placed and not clash and not converse


def task_of(case: Case) -> oag.Task:
    data = case.task_json()
    for subtask in data["sub_tasks"]:  # type: ignore[attr-defined]
        del subtask["flow"]
    return oag.Task.from_json({**data, "goal": "(and)"}, scene=case.scene())


def lengths(case: Case, start: World) -> list[int]:
    """The lengths of the shortest flows to the states in which the goal holds, by search through complete states."""
    part = case.parts[0]
    allowed = tuple(
        action for action in ACTIONS if legal(action, part) and not (action == 3 and part.target in SURFACES)
    )
    reached = reachable(start, part, allowed, KINDS)
    return sorted(length for world, length in reached.items() if all(map(world.holds, part.goal)))


def check_complete(case: Case) -> None:
    """From a start that is known: found exactly when there is one, and it works."""
    if not sound(case.parts[0]):
        return
    graph = oag.compose(task_of(case))
    report = graph.verify()
    (start,) = case.starts()
    found = lengths(case, start)
    flow = graph.task.subtasks[0].flow
    event("found" if found else "none exists")
    assert (flow is not None) is bool(found), str(report)
    if flow is None:
        assert report.verdict is oag.Verdict.REFUTED and report.errors[0].code == "flow/no-flow"
        result = oag.recheck(report.certificate)
        assert result, result.reason
    else:
        assert report, str(report)
        numbers = tuple(int(action.primitive) for action in flow)
        assert run(start, (replace(case.parts[0], flow=numbers),), (), KINDS) is None
        templates = (len(template) for template in TEMPLATES)
        assert len(flow) == found[0] or len(flow) in templates


def check_unknown(case: Case) -> None:
    """From a start known in part: a proved flow works from every completion, a refutation holds in every one."""
    if not sound(case.parts[0]):
        return
    graph = oag.compose(task_of(case))
    report = graph.verify()
    event(report.verdict.value)
    flow = graph.task.subtasks[0].flow
    if report.verdict is oag.Verdict.PROVED:
        assert flow is not None
        part = replace(case.parts[0], flow=tuple(int(action.primitive) for action in flow))
        assert all(run(start, (part,), (), KINDS) is None for start in case.starts())
    if report.verdict is oag.Verdict.REFUTED:
        assert all(not lengths(case, start) for start in case.starts())
        assert oag.recheck(report.certificate)


@given(starts())
@FEW
def test_p5_a_flow_is_found_exactly_when_one_exists(case: Case) -> None:
    check_complete(case)


@given(starts(most_unknown=4))
@FEW
def test_p5_claims_about_unknown_starts_hold_in_all_of_them(case: Case) -> None:
    check_unknown(case)


@pytest.mark.slow
@given(starts())
@MANY
def test_p5_at_length(case: Case) -> None:
    check_complete(case)


@pytest.mark.slow
@given(starts(most_unknown=6))
@MANY
def test_p5_unknown_at_length(case: Case) -> None:
    check_unknown(case)


def test_the_start_states_are_of_both_kinds() -> None:
    """The generator's worlds are those that the simulation knows."""
    assert set(RESTING_FACTS) <= set(FACTS) and set(ITEMS) == set(KINDS.items)
