"""Exact decisions: what all runs of a plan have in common, over every start state that agrees with what is known.

A run is a start state together with a value for everything that becomes unknown on the way. Three-valued progression
answers "unknown" where several unknown facts depend on each other, through a formula or through the invariants. Here
such a plan is decided by a solver: one question first, whether some run misses an obligation; only if so, which
obligation no run meets, or else what has to be assumed, as few literals as will do.

Source: docs/semantics.md, Exact decisions.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from typing import NamedTuple

import bddl
from bddl.solver import FALSE, TRUE, Assumed, Script, Solver, SolverAnswer, conjunction, disjunction, negation, solve
from oag.model.facts import Condition, Fact, Value, condition_of
from oag.progression.compiled import CompiledSubtask
from oag.progression.obligations import Decision, Grade, Obligation
from oag.progression.progress import Trace
from oag.table.invariants import converse
from oag.table.library import Clause, Needed
from oag.table.state import START, State

# Values that are assumed in the questions about one plan, all questions together: some seconds. What decides for each
# unknown fact whether it is needed asks as many questions as there are such facts, about all of them.
MOST_ASSUMED = 100_000


class Undecided(Exception):
    """The solver's time was up, or there was too much to ask it; what progression says stands."""


def decide(unrolled: Unrolled) -> Decision:
    """Returns what the open obligations of a plan come to.

    Raises:
        Undecided: The solver's time was up, or there was too much to ask it.
        bddl.SolverMissing: z3 is not installed.
    """
    if not unrolled.open:
        return Decision(unrolled.fails, run=None if unrolled.fails is None else ())
    if unrolled.fails is None:
        missed = negation(conjunction(each.term for each in unrolled.open))
        answer = solve(f"{unrolled.text()}\n(assert {missed})")
        if answer.status == "unknown":
            raise Undecided(answer.reason)
        if answer.status == "unsat":
            return Decision(None, dict.fromkeys((each.number for each in unrolled.open), Grade.HOLDS))
    return _Deciding(unrolled).run()


def left_open(trace: Trace) -> bool:
    """Decides whether progression alone may have said less, or something else, than holds of all runs.

    It may where a formula stayed unknown, where one of several unknown things was assumed, and where one of two
    assumptions entails the other. What comes after a failure does not matter.
    """
    failed = trace.failures[0].obligation if trace.failures else len(trace.obligations)
    before = [assumption for assumption in trace.assumptions if assumption.obligation <= failed]
    conditions = {assumption.condition for assumption in before}
    return None in conditions or (trace.chose and bool(before)) or any(_entailed(c, conditions) for c in conditions)


def _entailed(condition: Condition | None, others: Collection[Condition | None]) -> bool:
    """True when an assumption that something is not so follows from an invariant, or from another assumption."""
    if condition is None or condition.positive:
        return False
    other = converse(condition.fact)
    return other is not None and (other == condition.fact or Condition(other, True) in others)


class _Deciding:
    """The questions about one plan."""

    def __init__(self, unrolled: Unrolled) -> None:
        self._unrolled = unrolled
        self._session = Solver(unrolled.text())
        self._script = Script(prefix="o")
        # What is open before the first obligation that fails, each with the name under which it can be asked about.
        self._open = [(each, self._script.name(each.term)) for each in unrolled.open]
        self._met = self._name_for_all()
        self._left = MOST_ASSUMED

    def run(self) -> Decision:
        """Returns what the questions come to."""
        fails = self._unrolled.fails
        if not self._satisfiable([(self._met, True)]):
            count = self._first_impossible()
            fails = self._open[count][0].number
            self._open = self._open[:count]
            self._met = self._name_for_all()
        one = self._one_run()
        given = self._placed(self._needed_of(one)) if self._open else {}
        miss = self._one_miss() if given and fails is None else None
        return Decision(fails, self._grades(), given, None if fails is None else _written(one), miss)

    def _first_impossible(self) -> int:
        """Returns how many open obligations some run meets in a row; the one after them is met by none of these."""
        possible, impossible = 0, len(self._open)
        while impossible - possible > 1:
            middle = (possible + impossible) // 2
            if self._satisfiable((name, True) for _, name in self._open[:middle]):
                possible = middle
            else:
                impossible = middle
        return possible

    def _one_run(self) -> dict[Unknown, bool]:
        """Returns a run that meets all open obligations, with as much false as possible, the last mentioned first."""
        names = self._unrolled.names
        chosen: list[Assumed] = [(self._met, True)]
        true = self._ask(chosen).true
        for name in reversed(names.values()):
            if name in true:
                answer = self._ask([*chosen, (name, False)])
                true = answer.true if answer.status == "sat" else true
            chosen.append((name, name in true))
        return {unknown: name in true for unknown, name in names.items()}

    def _one_miss(self) -> tuple[tuple[int, Fact, Value], ...]:
        """Returns a run that misses an open obligation; there is one when something has to be assumed."""
        true = self._ask([(self._met, False)]).true
        return _written({unknown: name in true for unknown, name in self._unrolled.names.items()})

    def _needed_of(self, run: Mapping[Unknown, bool]) -> dict[Unknown, bool]:
        """Returns the values of a run that the open obligations need: without any one of them, some run misses one."""
        names = self._unrolled.names
        assumed = [(names[unknown], value) for unknown, value in run.items()]
        clash = self._ask([*assumed, (self._met, False)]).core
        kept = {name: value for name, value in assumed if (name, value) in clash}
        for name in reversed(list(kept)):
            others = [(other, value) for other, value in kept.items() if other != name]
            if not self._satisfiable([*others, (self._met, False)]):
                del kept[name]
        return {unknown: value for unknown, value in run.items() if names[unknown] in kept}

    def _grades(self) -> dict[int, Grade]:
        """Returns the grades in order, while each obligation is required for the ones after it."""
        grades: dict[int, Grade] = {}
        for each, name in self._open:
            grades[each.number] = Grade.POSSIBLE if self._satisfiable([(name, False)]) else Grade.HOLDS
            self._session.require(name)
        return grades

    def _placed(self, given: Mapping[Unknown, bool]) -> dict[int, tuple[Condition, ...]]:
        """Returns what is given by the obligation that first speaks of it, or of what it excludes."""
        placed: dict[int, tuple[Condition, ...]] = {}
        left = dict(given)
        for each, _ in self._open:
            spoken = [u for unknown in each.unknowns for u in _tied(unknown) if u in left]
            conditions = tuple(Condition(u.fact, True, left.pop(u)) for u in dict.fromkeys(spoken))
            if conditions:
                placed[each.number] = conditions
        return placed

    def _name_for_all(self) -> str:
        """Returns a constant that is true exactly when all open obligations are met, and reads what is new."""
        met = self._script.name(conjunction(name for _, name in self._open))
        self._session.add(self._script.text())
        self._script = Script(prefix=f"o{met}")
        return met

    def _satisfiable(self, assumed: Iterable[Assumed]) -> bool:
        return self._ask(assumed).status == "sat"

    def _ask(self, assumed: Iterable[Assumed]) -> SolverAnswer:
        values = tuple(assumed)
        self._left -= len(values)
        if self._left < 0:
            raise Undecided("too much is unknown")
        answer = self._session.check(values)
        if answer.status == "unknown":
            raise Undecided(answer.reason)
        return answer


def _written(run: Mapping[Unknown, bool]) -> tuple[tuple[int, Fact, Value], ...]:
    """Returns a run as (time, fact, value); at time 0 the start."""
    return tuple((max(unknown.time, START), unknown.fact, value) for unknown, value in run.items())


def _tied(unknown: Unknown) -> tuple[Unknown, ...]:
    """Returns an unknown, and the one that an invariant ties to it if there is one."""
    other = converse(unknown.fact)
    return (unknown,) if other is None else (unknown, unknown._replace(fact=other))


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
        ground = bddl.ground(formula, self._objects)
        terms = [self._condition(condition_of(atom, True), state, found) for atom in ground.atoms]
        return self._script.term(ground.root, terms.__getitem__)

    def _condition(self, condition: Condition, state: State, found: dict[Unknown, None]) -> str:
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
        term = TRUE if truth else FALSE
        if not self._every:
            return term
        name = self._known.get((condition, time))
        if name is None:
            name = self._known[condition, time] = self._script.define(term)
        return name


def unroll(
    trace: Trace, subtasks: Sequence[CompiledSubtask], goal: Needed, objects: Mapping[str, str], *, every: bool = False
) -> Unrolled:
    """Returns the terms of all obligations of a plan that was followed.

    Args:
        trace: The plan as it was followed; only its start, its steps and the places of its obligations are read.
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
    if obligation.kind == "task-goal":
        return goal
    subtask = subtasks[obligation.subtask]
    if obligation.kind == "precondition":
        step = trace.steps[obligation.time // 2]
        return subtask.rows.row(step.primitive, step.hand)[0]
    return subtask.init if obligation.kind == "init" else subtask.goal
