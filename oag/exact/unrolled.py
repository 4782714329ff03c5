"""A plan written out as terms over what is unknown: which values of the unknown facts let each obligation hold.

Every fact has one name for each time that its value becomes unknown (static single assignment); what is known is
written as its value, and a fact that nothing writes keeps its name. What the hand holds is known throughout (the reset
empties it, and every step that touches it writes it), so which facts a step writes does not depend on the state.

Source: docs/semantics.md, Exact decisions.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import bddl
from bddl.solver import FALSE, TRUE, Script, conjunction, disjunction, negation
from oag.model.facts import Condition, Fact, condition_of
from oag.progression.compiled import CompiledSubtask
from oag.progression.obligations import Grade, Obligation
from oag.progression.progress import Trace
from oag.table.invariants import converse
from oag.table.library import Clause, Needed
from oag.table.state import State


class Unknown(NamedTuple):
    """A fact from the moment that its value is unknown; `time` is negative for the start, else when it was blurred."""

    fact: Fact
    time: int


class OpenObligation(NamedTuple):
    """An obligation that depends on what is unknown.

    Attributes:
        number: Its index among all obligations.
        term: The term that is true exactly when it holds.
        unknowns: What it speaks of.
    """

    number: int
    term: str
    unknowns: tuple[Unknown, ...]


class Unrolled:
    """A plan's obligations as terms.

    Attributes:
        names: The constant that stands for each unknown, in order of first mention.
        open: The obligations that depend on what is unknown, in order.
        fails: Index of the first obligation that holds in no state whatever is unknown, where the plan ends at the
            latest; None when there is none.
    """

    def __init__(self, objects: Mapping[str, str], *, every: bool = False) -> None:
        """Starts with nothing.

        Args:
            objects: Categories of the scene's objects, for quantifiers.
            every: Write what is known as constants with given values too, so that nothing is decided beforehand.
        """
        self.names: dict[Unknown, str] = {}
        self.open: list[OpenObligation] = []
        self.fails: int | None = None
        self._objects = objects
        self._every = every
        self._script = Script()
        self._known: dict[tuple[Condition, int], str] = {}

    def text(self) -> str:
        """Returns the SMT-LIB text that gives the terms their meaning, and what the invariants say of the start."""
        lines = [self._script.text()]
        for left, right in self.exclusions():
            apart = disjunction(negation(self.names[each]) for each in (left, right))
            lines.append(f"(assert {apart})")
        return "\n".join(lines)

    def exclusions(self) -> Iterator[tuple[Unknown, Unknown]]:
        """Yields the pairs of unknowns of which at most one is true; a pair of twice the same is false.

        Source: docs/semantics.md, States: `inside` and `ontop` are irreflexive and antisymmetric.
        """
        for unknown in self.names:
            excluding = converse(unknown.fact)
            if excluding is not None and excluding >= unknown.fact:
                other = unknown._replace(fact=excluding)
                if other in self.names:
                    yield unknown, other

    def add(self, number: int, wanted: Needed, state: State) -> None:
        """Adds what is needed at one place, where `state` is what is known there."""
        if self.fails is not None:
            return
        found: dict[Unknown, None] = {}
        if isinstance(wanted, tuple):
            term = conjunction([self._clause(clause, state, found) for clause in wanted])
        else:
            term = self._formula(wanted, state, found)
        if term == FALSE:
            self.fails = number
        elif term != TRUE:
            self.open.append(OpenObligation(number, term, tuple(found)))

    def _clause(self, clause: Clause, state: State, found: dict[Unknown, None]) -> str:
        """Returns the term of a clause, and notes what it speaks of unless that makes no difference."""
        if len(clause) == 1:
            return self._condition(clause[0], state, found)
        mentioned: dict[Unknown, None] = {}
        term = disjunction([self._condition(condition, state, mentioned) for condition in clause])
        if term != TRUE:
            found.update(mentioned)
        return term

    def _formula(self, formula: bddl.Formula, state: State, found: dict[Unknown, None]) -> str:
        """Returns the term of a formula beyond literals."""
        ground = bddl.ground(formula, self._objects)
        terms = [self._condition(condition_of(atom, True), state, found) for atom in ground.atoms]
        return self._script.term(ground.root, terms.__getitem__)

    def _condition(self, condition: Condition, state: State, found: dict[Unknown, None]) -> str:
        """Returns the term of one condition, and notes the unknown that it speaks of."""
        fact = condition.fact
        value, time = state.read(fact)
        truth = condition.grade(value)
        if truth is not None:
            return self._constant(condition, time, truth)
        unknown = Unknown(fact, time)
        name = self.names.get(unknown)
        if name is None:
            name = self.names[unknown] = f"u{len(self.names)}"
            self._script.declare(name)
        found[unknown] = None
        return name if condition.positive else negation(name)

    def _constant(self, condition: Condition, time: int, truth: bool) -> str:
        """Returns the term of a condition whose truth is known."""
        term = TRUE if truth else FALSE
        if not self._every:
            return term
        name = self._known.get((condition, time))
        if name is None:
            name = self._known[condition, time] = self._script.define(term)
        return name


def unroll(
    trace: Trace,
    subtasks: Sequence[CompiledSubtask],
    goal: Needed,
    objects: Mapping[str, str],
    *,
    every: bool = False,
) -> Unrolled:
    """Returns the terms of all obligations of a plan that was followed.

    Args:
        trace: The plan as it was followed; only its start, its steps and the places of its obligations are read.
        subtasks: The subtasks of the trace.
        goal: The task goal.
        objects: Categories of the scene's objects.
        every: See `Unrolled`.
    """
    unrolled = Unrolled(objects, every=every)
    state, done = trace.start, 0
    for number, obligation in enumerate(trace.obligations):
        while 2 * done + 1 < obligation.time:
            done += 1
            state = state.after(trace.steps[done - 1].effect, 2 * done)
        wanted = _wanted(obligation, trace, subtasks, goal)
        if wanted != () and (every or _rests_on_assumptions(obligation)):
            unrolled.add(number, wanted, state)
    return unrolled


def _rests_on_assumptions(obligation: Obligation) -> bool:
    """True unless an obligation follows from what the start and the steps wrote."""
    return obligation.grade is not Grade.HOLDS or any(link.producer % 2 for link in obligation.links)


def _wanted(obligation: Obligation, trace: Trace, subtasks: Sequence[CompiledSubtask], goal: Needed) -> Needed:
    """Returns what an obligation needs."""
    if obligation.kind == "task-goal":
        return goal
    subtask = subtasks[obligation.subtask]
    if obligation.kind == "precondition":
        step = trace.steps[obligation.time // 2]
        return subtask.rows.row(step.primitive, step.hand)[0]
    return subtask.init if obligation.kind == "init" else subtask.goal
