"""Locality against simulation: what is said to be undone is, and what is undone beside the subtask is said."""

from __future__ import annotations

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import oag
from tests.bruteforce import Literal, Part, act
from tests.properties.plans import FACTS, FIXTURES, ITEMS, KINDS, Case, cases, picking, placing

FEW = settings(max_examples=130, deadline=None, suppress_health_check=[HealthCheck.too_slow])
MANY = settings(max_examples=2000, deadline=None, suppress_health_check=[HealthCheck.too_slow])
# Subtask, step, and the literal that a step makes false.
Undone = tuple[int, int, str]


def words(literal: Literal) -> str:
    """A literal as messages have it."""
    fact, wanted = literal
    text = f"{fact[0]}({', '.join(fact[1:])})"
    return text if wanted else f"not {text}"


def undone(case: Case) -> dict[Undone, tuple[Literal, Part]]:
    """What steps make false of the goals of earlier subtasks, from any start; each goal is undone once."""
    found: dict[Undone, tuple[Literal, Part]] = {}
    for world in case.starts():
        standing: dict[tuple[str, ...], bool] = {}
        for index, part in enumerate(case.parts):
            for step, action in enumerate(part.flow):
                after = act(world, part, action, KINDS)
                for fact, wanted in list(standing.items()):
                    if world.holds((fact, wanted)) and not after.holds((fact, wanted)):
                        found[index, step, words((fact, wanted))] = (fact, wanted), part
                        del standing[fact]
                world = after
            standing |= dict(part.goal)
    return found


@st.composite
def careless(draw: st.DrawFn) -> Case:
    """A plan that runs and undoes on its way what it had reached: it moves what is held, or stacks two in turn."""
    item, other = draw(st.permutations(ITEMS))
    resting = ("ontop", item, "table_0")
    taken = Part(item, None, (), ((("inside", item, "gripper"), True),), picking(item, resting).flow)
    stays: tuple[Literal, ...] = ((("inside", item, "gripper"), True), (resting, True))
    fixture = draw(st.sampled_from(FIXTURES))
    stranger = Part(fixture, None, (), (), draw(st.sampled_from(((17,), (13,), (6,), ((9, 0.1),), ((9, 0.0),)))))
    plan = [Part(item, "table_0", (), stays, taken.flow[:4]), stranger, Part(fixture, None, (), (), (17, 1))]
    if draw(st.booleans()):
        again = (("ontop", other, "table_0"), True)
        other_taken = Part(other, None, (), ((again[0], False),), picking(other, again[0]).flow)
        plan = [taken, placing(item, "ontop", other), other_taken, placing(other, "ontop", item)]
    whole = tuple(draw(st.sampled_from([plan, plan[:2], plan[1:]])))
    known = dict.fromkeys(FACTS, False) | {resting: True, ("ontop", other, "table_0"): draw(st.booleans())}
    return Case(known, (), whole, whole[-1].goal, ("inside", "ontop", "open"))


def check_locality(case: Case) -> int:
    """Every warning is right, and nothing is missing that is about something else than the target; how many there are.

    A plan that is not proved says who undid what with what lacks it.
    """
    report = oag.compose(case.task()).verify()
    if report.verdict is not oag.Verdict.PROVED:
        return 0
    said: set[Undone] = set()
    for finding in report.diagnostics:
        if finding.code == "locality/clobbers":
            assert finding.subtask is not None and finding.step is not None
            said.add(
                (finding.subtask, finding.step, finding.message.partition("undoes ")[2].partition(", the goal")[0])
            )
    happened = undone(case)
    unmeant = {key for key, ((fact, wanted), part) in happened.items() if (fact, not wanted) not in part.goal}
    assert said <= unmeant
    assert {key for key in unmeant if happened[key][1].target not in happened[key][0][0][1:2]} <= said
    return len(said)


@given(cases(most_unknown=1))
@settings(FEW)
def test_what_is_clobbered_is_said(case: Case) -> None:
    check_locality(case)


@given(careless())
@settings(FEW)
def test_what_careless_plans_clobber_is_said(case: Case) -> None:
    check_locality(case)


def test_careless_plans_do_clobber() -> None:
    """The strategy above has what it is for: a cup that is to stay on its table is driven off with."""
    away = Part("fridge_0", None, (), (), (17,))
    taken = Part("cup_0", "table_0", (), ((("ontop", "cup_0", "table_0"), True),), (17, 1, 2, 3))
    known = dict.fromkeys(FACTS, False) | {("ontop", "cup_0", "table_0"): True}
    assert check_locality(Case(known, (), (taken, away), (), ("inside", "ontop", "open"))) == 1


@pytest.mark.slow
@given(careless())
@settings(MANY)
def test_careless_plans_at_length(case: Case) -> None:
    check_locality(case)


@pytest.mark.slow
@given(cases(most_unknown=2))
@settings(MANY)
def test_clobbers_at_length(case: Case) -> None:
    check_locality(case)
