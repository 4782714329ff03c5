"""Where each subtask of a plan stands: what is known there, what it finds done already, and what it reads.

The plan is followed by the intended effects alone: nothing is assumed, and a condition that fails changes nothing. So
what is known at a place stays the same when a subtask that does nothing there is left out.

Source: docs/canonical.md, Net effects.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import bddl
from oag.model.actions import ActionFlow
from oag.model.facts import ANY, EEF, EMPTY, HAND, NEAR, Fact, Value, held_by, holding, made_true
from oag.model.scene import Scene
from oag.normal_form.formulas import facts_in
from oag.normal_form.work import (
    Work,
    context_of,
    covers,
    literal_condition,
    moves_only,
    one_after_other,
    starts_afresh,
    work_of,
    working_flow,
)
from oag.progression.compiled import articulated_ids, vessel_ids
from oag.table.library import Context, effect, requirements
from oag.table.start import start_state
from oag.table.state import State
from oag.task.task import SimpleTask

Formulas = tuple[bddl.Formula, ...]


@dataclass(frozen=True, slots=True)
class Place:
    """One subtask where it stands in a plan.

    Attributes:
        subtask: The subtask.
        flow: Its flow, or the template that stands for it; None when there is neither.
        context: What its primitives are about.
        work: What its flow does as a whole; None when it has none.
        hand: The hand's value before it.
        lifted: Whether what the hand holds before it was carried since it was grasped.
        open_init: The parts of its initial condition that are not known to hold where it starts.
        open_goal: The parts of its goal that are not known to hold where it starts.
        idle: True when everything that it writes has that value already.
        repeats: True when an earlier subtask of the same target did the same, and perhaps more.
        relied_on: True when a later subtask is superfluous because it repeats this one.
        pair_idle: True when it and the next subtask pick the target up and put it back, and find all of that done.
        stays: True when the robot's pose after it is the one before it.
        reads: What it reads of the world before writing it; patterns for quantified formulas.
    """

    subtask: SimpleTask
    flow: ActionFlow | None
    context: Context
    work: Work | None
    hand: Value
    lifted: bool
    open_init: Formulas
    open_goal: Formulas
    idle: bool
    repeats: bool
    relied_on: bool
    pair_idle: bool
    stays: bool
    reads: frozenset[Fact]

    @property
    def runs(self) -> bool:
        """True when the hand is as its flow needs it."""
        return self.work is not None and self.work.needs == self.hand

    @property
    def afresh(self) -> bool:
        """True when it does not depend on where the robot stands."""
        return self.flow is None or starts_afresh(self.flow)

    @property
    def begins_part(self) -> bool:
        """True when the hand is empty before it and where the robot stands is of no account."""
        return self.hand == EMPTY and self.afresh

    @property
    def only_moves(self) -> bool:
        """True when it neither grasps, nor lets go, nor articulates, and has a flow of its own."""
        return self.subtask.flow is not None and moves_only(self.subtask.flow)


def survey(subtasks: Sequence[SimpleTask], scene: Scene) -> list[Place]:
    """Returns where each subtask stands; all targets must be in the scene."""
    return _Survey(subtasks, scene).places()


def unknown_at_end(subtasks: Sequence[SimpleTask], scene: Scene, parts: Iterable[bddl.Formula]) -> Formulas:
    """Returns those of some formulas that are not known to hold after a plan; all targets must be in the scene."""
    followed = _Survey(subtasks, scene)
    followed.places()
    return followed.unknown(parts)


class _Survey:
    """One pass over a plan."""

    def __init__(self, subtasks: Sequence[SimpleTask], scene: Scene) -> None:
        self._subtasks = subtasks
        self._scene = scene
        self._objects = {key: thing.category for key, thing in scene.objects.items()}
        self._articulated, self._vessels = articulated_ids(scene), vessel_ids(scene)
        first = subtasks[0].target if subtasks else None
        self._state = start_state(scene, first)
        self._time = 0
        self._lifted = False
        # Target -> what was done to it, with the index of the subtask that did it first.
        self._done: dict[str, dict[frozenset[tuple[Fact, Value]], int]] = {}
        self._relied_on: set[int] = set()

    def places(self) -> list[Place]:
        """Follows the whole plan."""
        found = [self._place(index, subtask) for index, subtask in enumerate(self._subtasks)]
        return [replace(place, relied_on=index in self._relied_on) for index, place in enumerate(found)]

    def _place(self, index: int, subtask: SimpleTask) -> Place:
        hand, lifted = self._state.hand, self._lifted
        context = context_of(subtask, self._scene, self._articulated, self._vessels)
        flow = working_flow(subtask, context, hand)
        open_init, open_goal = (self.unknown(bddl.conjuncts(formula)) for formula in (subtask.init, subtask.goal))
        work = None if flow is None else work_of(subtask, flow, context, hand, lifted)
        idle = self._is_idle(work) if work is not None else not open_goal
        # Only a subtask that finds its goal reached can be superfluous, so the others need not be compared.
        # What writes nothing repeats nothing, or it would repeat everything.
        first = None if open_goal or work is None or not work.writes else self._first_to_do(subtask.target, work)
        if first is not None and idle and open_init:
            self._relied_on.add(first)
        pair_idle = work is not None and self._pair_is_idle(index, subtask, context, work, open_init)
        if work is not None and work.writes and work.needs == hand:
            done = frozenset({HAND: work.hand, **work.writes}.items())
            self._done.setdefault(subtask.target, {}).setdefault(done, index)
        before = self._pose()
        reads = self._follow(subtask, flow, context, work)
        stays = before == self._pose()
        return Place(
            subtask,
            flow,
            context,
            work,
            hand,
            lifted,
            open_init,
            open_goal,
            idle,
            first is not None,
            False,
            pair_idle,
            stays,
            reads,
        )

    def unknown(self, parts: Iterable[bddl.Formula]) -> Formulas:
        """Returns the formulas that are not known to hold now."""
        return tuple(part for part in parts if not self._holds(part))

    def _holds(self, part: bddl.Formula) -> bool:
        condition = literal_condition(part)
        if condition is not None:
            return condition.grade(self._state.value(condition.fact)) is True
        return bddl.evaluate(part, self._state.holds, objects=self._objects) is True

    def _pose(self) -> tuple[Value, Value]:
        return self._state.value(NEAR), self._state.value(EEF)

    def _is_idle(self, work: Work) -> bool:
        """Decides whether every value that a subtask writes is there already."""
        patterns: list[Fact] = []
        for fact, value in work.writes.items():
            if ANY in fact:
                patterns.append(fact)
            elif self._state.value(fact) != value:
                return False
        return all(self._covers_nothing_new(pattern, work) for pattern in patterns)

    def _covers_nothing_new(self, pattern: Fact, work: Work) -> bool:
        """Decides whether a pattern writes what is known anyway, instance by instance."""
        if pattern.count(ANY) > 1:
            return False
        for name in self._objects:
            fact = tuple(name if word == ANY else word for word in pattern)
            # Nothing is on, in or beside itself, whatever is written of it.
            if len(set(fact)) < len(fact) or fact in work.writes:
                continue
            if self._state.value(fact) != work.writes[pattern]:
                return False
        return True

    def _first_to_do(self, target: str, work: Work) -> int | None:
        """Returns the first subtask so far that did to a target what some work does, None when none did."""
        wanted = work.writes.items()
        return next((index for done, index in self._done.get(target, {}).items() if wanted <= done), None)

    def _pair_is_idle(self, index: int, subtask: SimpleTask, context: Context, work: Work, open_init: Formulas) -> bool:
        """Decides whether picking a thing up and putting it down again changes nothing and asks for nothing new."""
        if work.needs != EMPTY or work.hand != holding(context.target):
            return False
        if index + 1 == len(self._subtasks) or self._subtasks[index + 1].target != context.target:
            return False
        following = self._subtasks[index + 1]
        next_context = context_of(following, self._scene, self._articulated, self._vessels)
        flow = working_flow(following, next_context, work.hand)
        if flow is None or self.unknown(bddl.conjuncts(following.goal)):
            return False
        next_work = work_of(following, flow, next_context, work.hand, work.lifted)
        if next_work.needs != work.hand or next_work.hand != EMPTY:
            return False
        between = (*bddl.conjuncts(subtask.goal), *bddl.conjuncts(following.init))
        asked = (*open_init, *self.unknown(part for part in between if not work.decides(part)))
        before = [self._first_to_do(context.target, half) for half in (work, next_work)]
        if not self._is_idle(one_after_other(work, next_work)) or (asked and None in before):
            return False
        if asked:
            self._relied_on.update(first for first in before if first is not None)
        return True

    def _follow(
        self, subtask: SimpleTask, flow: ActionFlow | None, context: Context, work: Work | None
    ) -> frozenset[Fact]:
        """Writes a subtask's effects and returns what it reads of the world before."""
        written: set[Fact] = set()
        reads = set(facts_in(subtask.init))
        if flow is None or work is None:
            self._forget(subtask)
            return frozenset(reads | facts_in(subtask.goal))
        hand = self._state.hand
        # A thing that it takes to be in the hand and is not there is not put down.
        now = hand if held_by(work.needs) is not None else work.needs
        self._apply(((HAND, now),))
        for action in flow:
            for clause in requirements(action.primitive, context, now):
                for condition in clause:
                    if len(condition.fact) > 1:
                        reads.update(_exposed((condition.fact,), written))
                    if condition.grade(self._state.value(condition.fact)) is True:
                        break
            effects = effect(action.primitive, context, now, action.parameter)
            now = dict(effects).get(HAND, now)
            self._apply(effects)
            written.update(fact for fact, _ in effects)
        self._apply(((HAND, hand if work.hand == work.needs else work.hand),))
        self._lifted = work.lifted if work.hand != work.needs or work.needs == hand else self._lifted
        reads.update(_exposed(facts_in(subtask.goal), written))
        return frozenset(reads)

    def _apply(self, written: tuple[tuple[Fact, Value], ...]) -> None:
        self._time += 2
        self._state = self._state.after(written, self._time)

    def _forget(self, subtask: SimpleTask) -> None:
        """Starts anew after a subtask of which nothing but the goal is known."""
        hand = self._state.hand
        self._state = State()
        conditions = [
            c for c in map(literal_condition, bddl.conjuncts(subtask.goal)) if c is not None and c.fact != HAND
        ]
        self._apply(((HAND, hand), *((c.fact, made_true(c)) for c in conditions)))
        self._done.clear()


def _exposed(facts: Iterable[Fact], written: set[Fact]) -> list[Fact]:
    """Returns the facts that nothing written so far decides."""
    return [fact for fact in facts if not any(covers(pattern, fact) for pattern in written)]
