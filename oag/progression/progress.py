"""Three-valued progression of what is known along a plan, with a causal link for everything that is needed.

After a failure the progression goes on as if the failed condition had held, so that a second, independent mistake is
found in the same run; what only follows from the first is counted with it and not reported.

Source: docs/semantics.md, Knowledge and Verdicts.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import NamedTuple

import bddl
from oag.model.facts import (
    EMPTY,
    FREE,
    HOME,
    ROBOT_FACTS,
    Condition,
    Fact,
    Value,
    condition_of,
    generalisations,
    known_as,
    made_true,
)
from oag.model.primitives import Primitive
from oag.progression.casetree import TOO_MANY_CASES, case_tree
from oag.progression.compiled import CompiledSubtask
from oag.progression.obligations import (
    NOTHING_DECIDED,
    Assumption,
    CausalLink,
    Decision,
    Grade,
    Obligation,
    ObligationKind,
    RootCause,
)
from oag.table.invariants import with_consequences
from oag.table.library import Clause, Effect, Needed
from oag.table.state import START, UNWRITTEN, Entry, State, step, truth_of


class Step(NamedTuple):
    """One executed step of the flattened plan; it writes at time 2 * number."""

    subtask: int
    position: int
    primitive: Primitive
    hand: Value
    effect: Effect


# How an obligation was decided: its grade, links, and cases.
_Decided = tuple[Grade, tuple[CausalLink, ...], tuple[Fact | None, ...] | None]


class Trace:
    """A plan followed as far as it is decided.

    Attributes:
        start: What is known at the start.
        state: What is known where the plan ends, or as far as it was followed.
        writes: What was written when after the start: by steps at even times, else by what is taken to have held.
        steps: The flattened plan; step n (from 1) is `steps[n - 1]`.
        obligations: In order.
        assumptions: What was unknown and needed, in order; each fact once.
        failures: Root causes, in order.
        dependents: For each root cause, how many later failures follow from it.
        vacuous: Indices of subtasks whose goal held already when they started.
        undecided_from: Index of the first subtask without a flow, where progression stops; None when there is none.
        chose: True when an unknown alternative was assumed that might not have been needed.
        counterexample: A complete start state from which the plan runs up to its first failure, as (time, fact, value);
            values at later times are of facts that a step leaves open. None when none was searched.
        miss: A run that misses an obligation, in the same form, where an exact decision found that something has to be
            assumed; else None.
        checkable: False when links and cases do not show the verdict, so that nobody else can check it.
        unsettled: Why an exact decision that was needed could not be had; None when none was needed, or it was had.
    """

    def __init__(
        self, start: State, objects: dict[str, str], decision: Decision = NOTHING_DECIDED, *, chose: bool = False
    ) -> None:
        """Starts a progression.

        Args:
            start: What is known at the start.
            objects: Categories of the scene's objects.
            decision: What was decided exactly of what progression alone leaves open.
            chose: Whether that decision rests on an assumption that might not have been needed.
        """
        self.start = self.state = start
        self.writes: list[tuple[int, Effect]] = []
        self.steps: list[Step] = []
        self.obligations: list[Obligation] = []
        self.assumptions: list[Assumption] = []
        self.failures: list[RootCause] = []
        self.dependents: list[int] = []
        self.vacuous: list[int] = []
        self.undecided_from: int | None = None
        self.chose = chose
        self.counterexample = decision.run
        self.miss = decision.miss
        self.unsettled: str | None = None
        self.checkable = True
        self._decision = decision
        self._objects = objects
        self._tainted: set[int] = set()
        # What root causes have to do with: their objects, and those of the subtasks that failed.
        self._suspects: set[str] = set()
        self._names: tuple[str, ...] = ()
        self._failed_subtask: int | None = None

    @property
    def boundary_time(self) -> int:
        """The time between the last step so far and the next one."""
        return 2 * len(self.steps) + 1

    def history(self, fact: Fact) -> Iterator[Entry]:
        """Yields the writes that covered a fact, in order; of those at one time only the most specific one."""
        ranks = {pattern: rank for rank, pattern in enumerate(generalisations(fact))}
        last, rank = self.start.read(fact), 0
        for time, effect in self.writes:
            for pattern, value in effect:
                if pattern not in ranks or (time == last.time and ranks[pattern] > rank):
                    continue
                if time != last.time and last != UNWRITTEN:
                    yield last
                last, rank = Entry(value, time), ranks[pattern]
        if last != UNWRITTEN:
            yield last

    def since(self, fact: Fact, asked: bool | str, until: int) -> Entry:
        """Returns the write that began the unbroken run of one answer to "has the fact this value?".

        Args:
            fact: Which fact.
            asked: The value asked about; runs of any other value count as one answer.
            until: Look at the fact as it was at this time.
        """
        began, answer = UNWRITTEN, None
        for entry in self.history(fact):
            if entry.time > until:
                break
            now = None if entry.value is None else entry.value == asked
            if began == UNWRITTEN or now is not answer:
                began, answer = entry, now
        return began

    def leave_open(self, reason: str) -> None:
        """Takes failures back that may rest on a wrong choice, when no exact decision could be had."""
        self.unsettled = reason
        self.checkable = False
        self.failures.clear()
        self.dependents.clear()

    def run(self, subtasks: Sequence[CompiledSubtask], goal: Needed) -> None:
        """Follows all subtasks and decides every obligation up to the task goal."""
        for index, subtask in enumerate(subtasks):
            self._names = subtask.context.names
            self._need("init", index, -1, subtask.init)
            if subtask.flow is None:
                self.undecided_from = index
                return
            if self._failed_subtask not in (None, index):
                self._failed_subtask = None
            self._run_flow(index, subtask)
        self._names = ()
        self._need("task-goal", len(subtasks), -1, goal)

    def _run_flow(self, index: int, subtask: CompiledSubtask) -> None:
        if subtask.goal != () and truth_of(subtask.goal, self.state.value, self._objects):
            self.vacuous.append(index)
        for position, action in enumerate(subtask.flow or ()):
            primitive, parameter, hand = action.primitive, action.parameter, self.state.hand
            self._need("precondition", index, position, subtask.rows.row(primitive, hand, parameter)[0])
            # A condition on the hand that failed, or was unknown, is taken to have held by now.
            time = self.boundary_time + 1
            written, self.state = step(self.state, subtask.rows, primitive, parameter, time)
            self.writes.append((time, written))
            self.steps.append(Step(index, position, primitive, hand, written))
            if self._failed_subtask == index:
                self._tainted.add(time)
        self._need("goal", index, -1, subtask.goal)

    def _write(self, effect: Effect) -> None:
        """Takes something to be so from now on, at the boundary."""
        self.state = self.state.after(effect, self.boundary_time)
        self.writes.append((self.boundary_time, effect))

    def _need(self, kind: ObligationKind, subtask: int, position: int, wanted: Needed) -> None:
        number = len(self.obligations)
        for condition in self._decision.given.get(number, ()):
            self._assume(CausalLink(condition, self.state.read(condition.fact).time, None), number)
        if isinstance(wanted, tuple):
            grade, links, cases = self._clauses(number, subtask, wanted)
        else:
            grade, links, cases = self._formula(number, subtask, wanted)
        self.obligations.append(Obligation(kind, subtask, position, self.boundary_time, grade, links, cases))

    def _clauses(self, number: int, subtask: int, wanted: tuple[Clause, ...]) -> _Decided:
        grade = self._decision.grades.get(number, Grade.HOLDS)
        links = [self._decide(clause) for clause in wanted]
        sure = [link for link in links if link is not None and link.value is not None]
        if len(sure) == len(links):
            return grade, tuple(sure), None
        shown = self._by_cases(number, subtask, wanted)
        if shown is not None:
            return shown
        failed: list[tuple[Condition, Entry]] = []
        violated: list[CausalLink] = []
        for clause, link in zip(wanted, links, strict=True):
            if link is None:
                entries = [self.state.read(condition.fact) for condition in clause]
                violated.extend(CausalLink(c, e.time, e.value) for c, e in zip(clause, entries, strict=True))
                # The last alternative is the one that a step can bring about, so it is the one to report.
                failed.append((clause[-1], entries[-1]))
            elif link.value is None and len(clause) > 1:
                self.chose = True
        found = [link for link in links if link is not None]
        for position, link in enumerate(found):
            if link.value is None:
                grade = Grade.POSSIBLE
                found[position] = self._assume(link, number)
        if failed:
            grade = Grade.FAILS
            self._fail(number, subtask, failed)
        return grade, (*found, *violated), None

    def _decide(self, clause: Clause) -> CausalLink | None:
        """Returns the link of the first alternative that holds, else of the first unknown one."""
        unknown: CausalLink | None = None
        for condition in clause:
            value, time = self.state.read(condition.fact)
            grade = condition.grade(value)
            if grade:
                return CausalLink(condition, time, value)
            if grade is None and unknown is None:
                unknown = CausalLink(condition, time, None)
        return unknown

    def _assume(self, link: CausalLink, obligation: int) -> CausalLink:
        """Records that an unknown condition is assumed, and returns the link to the assumption."""
        time = self.boundary_time
        condition = link.condition
        known = self.state.read(condition.fact)
        if known.value is not None:
            # Another clause of the same obligation says the same.
            return CausalLink(condition, known.time, known.value)
        value = made_true(condition)
        self.assumptions.append(Assumption(time, condition, None, obligation, link.producer < 0))
        self._write(with_consequences(condition.fact, value))
        return CausalLink(condition, time, value)

    def _fail(self, obligation: int, subtask: int, failed: list[tuple[Condition, Entry]]) -> None:
        """Records the root cause among the failed conditions and goes on as if they had held."""
        roots = [(c, e) for c, e in failed if not self._follows(c, e)]
        if roots:
            cause = RootCause(obligation, roots[0][0], None, roots[0][1], tuple(c for c, _ in roots))
            self._blame(cause, subtask, set().union(*(_speaks_of(c, e.value) for c, e in roots)))
        elif self.dependents:
            self.dependents[-1] += 1
        self._tainted.add(self.boundary_time)
        self._write(tuple((condition.fact, made_true(condition)) for condition, _ in failed))

    def _blame(self, cause: RootCause, subtask: int, names: set[str]) -> None:
        self.failures.append(cause)
        self.dependents.append(0)
        self._failed_subtask = subtask
        self._suspects.update(self._names, names)

    def _follows(self, condition: Condition, entry: Entry) -> bool:
        """Decides whether a failed condition only follows from an earlier root cause."""
        if entry.time in self._tainted or not self._suspects.isdisjoint(_speaks_of(condition, entry.value)):
            return True
        # A subtask that failed may owe its successor the state of the robot.
        return self._failed_subtask is not None and condition.fact in ROBOT_FACTS

    def _formula(self, number: int, subtask: int, formula: bddl.Formula) -> _Decided:
        """Decides a formula beyond literals by strong Kleene evaluation; every known atom read is its evidence."""
        links: dict[bddl.Atom, CausalLink] = {}

        def read(atom: bddl.Atom) -> bool | None:
            condition = condition_of(atom, True)
            entry = self.state.read(condition.fact)
            truth = condition.grade(entry.value)
            if truth is not None:
                links[atom] = CausalLink(condition._replace(positive=truth), entry.time, entry.value)
            return truth

        truth = bddl.evaluate(formula, read, objects=self._objects)
        if truth is None:
            shown = self._by_cases(number, subtask, formula)
            if shown is not None:
                return shown
            self.assumptions.append(Assumption(self.boundary_time, None, formula, number, False))
            return Grade.POSSIBLE, tuple(links.values()), None
        if truth:
            return self._decision.grades.get(number, Grade.HOLDS), tuple(links.values()), None
        self._fail_formula(number, subtask, formula, links.values())
        return Grade.FAILS, tuple(links.values()), None

    def _fail_formula(
        self, obligation: int, subtask: int, formula: bddl.Formula | None, links: Iterable[CausalLink]
    ) -> None:
        """Records a formula that fails: as a root cause, unless it rests on what was written after one."""
        read = tuple(links)
        named = {name for link in read for name in _speaks_of(link.condition, link.value)}
        if self._suspects.isdisjoint(named) and not any(link.producer in self._tainted for link in read):
            self._blame(RootCause(obligation, None, formula, UNWRITTEN, ()), subtask, named)
        elif self.dependents:
            self.dependents[-1] += 1

    def _by_cases(self, number: int, subtask: int, wanted: Needed) -> _Decided | None:
        """Returns how an obligation was decided that holds or fails whatever is unknown; None for any other."""
        fails = number == self._decision.fails
        if number not in self._decision.grades and not fails:
            return None
        read: dict[Fact, Entry] = {}

        def look(fact: Fact) -> Value:
            entry = read[fact] = self.state.read(fact)
            return entry.value

        found = case_tree(wanted, look, self._objects)
        if found is not None and len(found[1]) == 1:
            return None
        links = tuple(CausalLink(known_as(f, e.value), e.time, e.value) for f, e in read.items() if e.value is not None)
        if fails:
            self._fail_formula(number, subtask, None if isinstance(wanted, tuple) else wanted, links)
        self.checkable = self.checkable and found is not None
        grade = Grade.FAILS if fails else self._decision.grades[number]
        return grade, links, TOO_MANY_CASES if found is None else found[1]


def _speaks_of(condition: Condition, value: Value) -> set[str]:
    """Returns the objects that a condition, and the value that its fact has, have to do with."""
    said = [text.rpartition(" ")[2] for text in (condition.value, value) if isinstance(text, str)]
    return {*condition.fact[1:], *said} - {EMPTY, HOME, FREE}


def producer_place(trace: Trace, time: int) -> str:
    """Returns who wrote at a time: `the start`, or `T2 step 4 GRASP`."""
    if time == START or time % 2:
        return "the start"
    step = trace.steps[time // 2 - 1]
    return f"T{step.subtask + 1} step {step.position + 1} {step.primitive.name}"
