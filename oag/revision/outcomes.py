"""What can come of a step beside what is intended: named failures, each with what it writes.

No failure serves to prove anything: `verify` follows intended outcomes. Failures explain rollouts: of what a step can
lead to, which agrees with what was seen after it?

    miss      it does not get where it should: the base is elsewhere, the arm ends free, or the fingers close on nothing
    slip      what is held slips out of the hand and stays where it was; a handle slips away with the door anywhere
    drop      what is held falls to the floor
    collide   the motion does what it should, and pushes a fixture shut on its way

Source: docs/semantics.md, Failure outcomes.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import NamedTuple

import bddl
from bddl.visible import counted
from oag.model.facts import (
    ANY,
    EEF,
    EMPTY,
    FREE,
    HAND,
    NEAR,
    Fact,
    Value,
    condition_of,
    fact_text,
    generalisations,
    held_by,
)
from oag.model.primitives import ARTICULATIONS, Parameter, Primitive
from oag.progression.compiled import compile_subtask
from oag.report import Report
from oag.table.library import NAVIGATION, RESTING, VAGUE, Context, Effect, effect
from oag.table.state import State

INTENDED, MISS, SLIP, DROP, COLLIDE = "intended", "miss", "slip", "drop", "collide"
_REACHING = (Primitive.APPROACH, Primitive.CONVERGE)
_HANDLING = (Primitive.GRASP, Primitive.UNGRASP, *ARTICULATIONS)


class Outcome(NamedTuple):
    """One thing that can come of a step.

    Attributes:
        name: "intended", "miss", "slip", "drop" or "collide".
        about: Id of what slips, drops or is pushed shut; None for the others.
        effect: What it writes, with None for what it leaves open; everything else keeps its value.
    """

    name: str
    about: str | None
    effect: Effect

    def __str__(self) -> str:
        """Returns the outcome in words, such as `collide(refrigerator_0): not open(refrigerator_0)`."""
        head = self.name if self.about is None else f"{self.name}({self.about})"
        said = ", ".join(_text(fact, value) for fact, value in self.effect)
        return f"{head}: {said}"


def footprint(primitive: Primitive, context: Context, hand: Value) -> tuple[Fact, ...]:
    """Returns the facts and patterns that a primitive's intended outcome may write; it leaves all others alone."""
    return tuple(fact for fact, _ in effect(primitive, context, hand))


def step_outcomes(
    primitive: Primitive, context: Context, hand: Value, parameter: Parameter = None
) -> tuple[Outcome, ...]:
    """Returns the intended outcome of a primitive, then its named failures.

    Args:
        primitive: What runs, where its precondition holds.
        context: The subtask's objects.
        hand: Value of the hand before it; when it is None, nothing is said of what might slip or drop.
        parameter: Its number; None for none, and for what the executor fills in.
    """
    intended = effect(primitive, context, hand, parameter)
    return (Outcome(INTENDED, None, intended), *_failures(primitive, context, hand, intended))


def _failures(primitive: Primitive, context: Context, hand: Value, intended: Effect) -> Iterator[Outcome]:
    """Yields the named failures of a primitive."""
    held = held_by(hand)
    if primitive in NAVIGATION:
        yield Outcome(MISS, None, _but(intended, ((NEAR, None),)))
    elif primitive in _REACHING:
        yield Outcome(MISS, None, ((EEF, FREE),))
    elif primitive is Primitive.GRASP:
        yield Outcome(MISS, None, ((HAND, EMPTY),))
    elif primitive in ARTICULATIONS:
        yield Outcome(SLIP, context.target, ((HAND, EMPTY), (("open", context.target), None)))
    elif primitive is Primitive.UNGRASP and held is not None and context.placement is not None:
        yield Outcome(DROP, held, ((HAND, EMPTY), *_on_the_floor(held)))
    if primitive in _HANDLING:
        return
    if held is not None:
        where = tuple((fact, value) for fact, value in intended if fact in (NEAR, EEF))
        yield Outcome(SLIP, held, (*where, (HAND, EMPTY)))
        yield Outcome(DROP, held, (*where, (HAND, EMPTY), *_on_the_floor(held)))
    for fixture in context.articulated:
        yield Outcome(COLLIDE, fixture, (*intended, (("open", fixture), False)))


def _but(intended: Effect, other: Effect) -> Effect:
    """Returns an effect in which some facts have other values."""
    return tuple({**dict(intended), **dict(other)}.items())


def _on_the_floor(item: str) -> Effect:
    """Returns what a fall writes about an item: it rests nowhere, and what it is beside is open."""
    nowhere: Effect = tuple(((relation, item, ANY), False) for relation in RESTING)
    return (*nowhere, *(each for name in VAGUE for each in (((name, item, ANY), None), ((name, ANY, item), None))))


def outcomes(report: Report, subtask: int, step: int) -> tuple[Outcome, ...]:
    """Returns what can come of one step of a plan that was followed: what is intended first, then named failures.

    Args:
        report: From `verify`.
        subtask: Index of the subtask.
        step: Index of the step in its flow.

    Raises:
        ValueError: The plan was not followed up to such a step.
    """
    followed = () if report.trace is None else report.trace.steps
    for taken in followed:
        if (taken.subtask, taken.position) == (subtask, step):
            context = compile_subtask(report.task.subtasks[subtask], report.scene).context
            flow = report.task.subtasks[subtask].flow or ()
            return step_outcomes(taken.primitive, context, taken.hand, flow[step].parameter)
    raise ValueError(
        f"the plan was not followed to subtask {subtask}, step {step}; it has {counted(len(followed), 'step')}"
    )


def agreeing_outcomes(
    possible: tuple[Outcome, ...], before: Mapping[bddl.Atom, bool], after: Mapping[bddl.Atom, bool]
) -> tuple[Outcome, ...]:
    """Returns the outcomes of a step that agree with what was seen before and after it; none when none does.

    Args:
        possible: From `outcomes`.
        before: What detectors read before the step; `(inside glass_0 gripper)` is what the hand holds.
        after: What they read after it.
    """
    return tuple(outcome for outcome in possible if _agrees(outcome, before, after))


def _agrees(outcome: Outcome, before: Mapping[bddl.Atom, bool], after: Mapping[bddl.Atom, bool]) -> bool:
    """Decides whether what was seen after a step can be what an outcome leads to."""
    state = State().after(outcome.effect)
    written = {fact for fact, _ in outcome.effect}
    for atom, seen in after.items():
        condition = condition_of(atom, True)
        if written.isdisjoint(generalisations(condition.fact)):
            expected = before.get(atom)
        else:
            expected = condition.grade(state.value(condition.fact))
        if expected is not None and expected is not seen:
            return False
    return True


def _text(fact: Fact, value: Value) -> str:
    """Returns what an outcome writes, in words."""
    if value is not None:
        return fact_text(fact, value)
    return f"{fact[0]}{'(' + ', '.join(fact[1:]) + ')' if fact[1:] else ''} unknown"
