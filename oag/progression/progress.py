"""Three-valued progression of what is known along a plan, with a causal link for everything that is needed.

After a failure the progression goes on as if the failed condition had held, so that a second, independent mistake is
found in the same run; what only follows from the first is counted with it and not reported.

Source: docs/semantics.md, Knowledge and Verdicts.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import bddl
from oag.model.facts import EMPTY, FREE, HOME, ROBOT_FACTS, Condition, Fact, Value, condition_of, known_as, made_true
from oag.model.primitives import Primitive
from oag.progression.cases import TOO_MANY_CASES, case_tree
from oag.progression.compiled import CompiledSubtask
from oag.progression.obligations import (
    NOTHING_DECIDED,
    Assumption,
    Decision,
    Failure,
    Grade,
    Link,
    Obligation,
    ObligationKind,
)
from oag.table.invariants import with_consequences
from oag.table.knowledge import START, UNWRITTEN, Entry, Knowledge
from oag.table.library import Clause, Effect, Needed


class Step(NamedTuple):
    """One executed step of the flattened plan; it writes at time 2 * number."""

    subtask: int
    position: int
    primitive: Primitive
    hand: Value
    effect: Effect


# Named tuples made this way take half the time, and there are several for every step.
_made = tuple.__new__


class Cargo(NamedTuple):
    """What was known to rest on or in an item when it was grasped; `step` indexes `Trace.steps`."""

    step: int
    facts: tuple[Fact, ...]


class Trace:
    """A plan followed as far as it is decided.

    Attributes:
        knowledge: Everything written, with times.
        steps: The flattened plan; step n (from 1) is `steps[n - 1]`.
        obligations: In order.
        assumptions: What was unknown and needed, in order; each fact once.
        failures: Root causes, in order.
        dependents: For each root cause, how many later failures follow from it.
        cargo: What was grasped along with its support.
        vacuous: Indices of subtasks whose goal held already when they started.
        undecided_from: Index of the first subtask without a flow, where progression stops; None when there is none.
        goals: What the goals of the subtasks need, as far as the plan was followed.
        crossing: Indices of the obligations that rest on a step of an earlier subtask.
        chose: True when an unknown alternative was assumed that might not have been needed.
        counterexample: A complete start state from which the plan runs up to its first failure, as (time, fact, value);
            values at later times are of facts that a step leaves open. None when none was searched.
        miss: A run that misses an obligation, in the same form, where an exact decision found that something has to be
            assumed; else None.
        checkable: False when links and cases do not show the verdict, so that nobody else can check it.
        unsettled: Why an exact decision that was needed could not be had; None when none was needed, or it was had.
    """

    def __init__(
        self,
        knowledge: Knowledge,
        objects: dict[str, str],
        decision: Decision = NOTHING_DECIDED,
        *,
        chose: bool = False,
    ) -> None:
        """Starts a progression.

        Args:
            knowledge: What is known of the start.
            objects: Categories of the scene's objects.
            decision: What was decided exactly of what progression alone leaves open.
            chose: Whether that decision rests on an assumption that might not have been needed.
        """
        self.knowledge = knowledge
        self.steps: list[Step] = []
        self.obligations: list[Obligation] = []
        self.assumptions: list[Assumption] = []
        self.failures: list[Failure] = []
        self.dependents: list[int] = []
        self.cargo: list[Cargo] = []
        self.vacuous: list[int] = []
        self.undecided_from: int | None = None
        self.crossing: list[int] = []
        self.goals: list[Needed] = []
        self.chose = chose
        self.counterexample = decision.run
        self.miss = decision.miss
        self.unsettled: str | None = None
        self.checkable = True
        self._decision = decision
        self._grades = decision.grades
        self._objects = objects
        self._tainted: set[int] = set()
        # What root causes have to do with: their objects, and those of the subtasks that failed.
        self._suspects: set[str] = set()
        self._names: tuple[str, ...] = ()
        self._failed_subtask: int | None = None
        # When the subtask under way began: what was written before that crosses a boundary.
        self._began = 1

    @property
    def boundary_time(self) -> int:
        """The time between the last step so far and the next one."""
        return 2 * len(self.steps) + 1

    def leave_open(self, reason: str) -> None:
        """Takes failures back that may rest on a wrong choice, when no exact decision could be had."""
        self.unsettled = reason
        self.checkable = False
        self.failures.clear()
        self.dependents.clear()

    def run(self, subtasks: Iterable[CompiledSubtask], goal: Needed) -> None:
        """Follows all subtasks and decides every obligation up to the task goal."""
        count = 0
        for index, subtask in enumerate(subtasks):
            count += 1
            self._began = self.boundary_time
            self.goals.append(subtask.goal)
            self._names = subtask.context.names
            self._need("init", index, -1, subtask.init)
            if subtask.flow is None:
                self.undecided_from = index
                return
            if self._failed_subtask not in (None, index):
                self._failed_subtask = None
            self._run_flow(index, subtask)
        self._began = self.boundary_time
        self._names = ()
        self._need("task-goal", count, -1, goal)

    def _run_flow(self, index: int, subtask: CompiledSubtask) -> None:
        """Follows one flow and decides its goal."""
        if self._holds(subtask.goal):
            self.vacuous.append(index)
        knowledge, context, row, steps = self.knowledge, subtask.context, subtask.rows.row, self.steps
        for position, action in enumerate(subtask.flow or ()):
            primitive, parameter = action.primitive, action.parameter
            hand = knowledge.hand
            clauses, written = row(primitive, hand, parameter)
            self._need("precondition", index, position, clauses)
            if clauses and knowledge.hand != hand:
                # The condition that failed was about the hand, and is taken to have held.
                written = row(primitive, knowledge.hand, parameter)[1]
            steps.append(_made(Step, (index, position, primitive, hand, written)))
            if primitive is Primitive.GRASP and context.target_is_item:
                along = knowledge.cargo(context.target)
                if along:
                    self.cargo.append(Cargo(len(steps) - 1, along))
            time = 2 * len(steps)
            knowledge.apply(written, time)
            if self._failed_subtask == index:
                self._tainted.add(time)
        self._need("goal", index, -1, subtask.goal)

    def _holds(self, wanted: Needed) -> bool:
        """True when a goal is known to hold already."""
        if not isinstance(wanted, tuple):
            return bddl.evaluate(wanted, self.knowledge.value, objects=self._objects) is True
        return bool(wanted) and self._links(wanted) is not None

    def _need(self, kind: ObligationKind, subtask: int, step: int, wanted: Needed) -> None:
        """Decides one obligation and records its links, assumptions and failures."""
        time, number = 2 * len(self.steps) + 1, len(self.obligations)
        for condition in self._decision.given.get(number, ()):
            self._assume(Link(condition, self.knowledge.read(condition.fact).time, None), number)
        if not isinstance(wanted, tuple):
            self._need_formula(kind, subtask, time, wanted)
            links = self.obligations[-1].links
        else:
            found = self._links(wanted)
            if found is None:
                self._need_more(kind, subtask, step, wanted)
                links = self.obligations[-1].links
            else:
                links = found
                grade = self._grades.get(number, Grade.HOLDS)
                self.obligations.append(_made(Obligation, (kind, subtask, step, time, grade, links, None)))
        for _, producer, _ in links:
            if 0 < producer < self._began:
                self.crossing.append(number)
                break

    def _links(self, wanted: tuple[Clause, ...]) -> tuple[Link, ...] | None:
        """Returns a link for each clause when all are known to hold, else None."""
        last = self.knowledge.last
        links: list[Link] = []
        for clause in wanted:
            for condition in clause:
                value, time = last(condition.fact)
                if value is not None and (value == condition.value) is condition.positive:
                    links.append(_made(Link, (condition, time, value)))
                    break
            else:
                return None
        return tuple(links)

    def _need_more(self, kind: ObligationKind, subtask: int, step: int, wanted: tuple[Clause, ...]) -> None:
        """Decides an obligation of which something is unknown or false."""
        if self._need_cases(kind, subtask, step, wanted):
            return
        time = self.boundary_time
        grade = self._grades.get(len(self.obligations), Grade.HOLDS)
        links: list[Link] = []
        failed: list[tuple[Condition, Entry]] = []
        violated: list[Link] = []
        for clause in wanted:
            link = self._decide(clause)
            if link is None:
                entries = [self.knowledge.read(condition.fact) for condition in clause]
                violated.extend(Link(c, e.time, e.value) for c, e in zip(clause, entries, strict=True))
                # The last alternative is the one that a step can bring about, so it is the one to report.
                failed.append((clause[-1], entries[-1]))
            else:
                links.append(link)
                self.chose = self.chose or (link.value is None and len(clause) > 1)
        number = len(self.obligations)
        for position, link in enumerate(links):
            if link.value is None:
                grade = Grade.POSSIBLE
                links[position] = self._assume(link, number)
        if failed:
            grade = Grade.FAILS
            self._fail(number, subtask, failed)
            links.extend(violated)
        self.obligations.append(Obligation(kind, subtask, step, time, grade, tuple(links)))

    def _decide(self, clause: Clause) -> Link | None:
        """Returns the link of the first alternative that holds, else of the first unknown one."""
        unknown: Link | None = None
        for condition in clause:
            entry = self.knowledge.read(condition.fact)
            grade = condition.grade(entry.value)
            if grade:
                return Link(condition, entry.time, entry.value)
            if grade is None and unknown is None:
                unknown = Link(condition, entry.time, None)
        return unknown

    def _assume(self, link: Link, obligation: int) -> Link:
        """Records that an unknown condition is assumed, and returns the link to the assumption."""
        time = self.boundary_time
        condition = link.condition
        known = self.knowledge.read(condition.fact)
        if known.value is not None:
            # Another clause of the same obligation says the same.
            return Link(condition, known.time, known.value)
        value = made_true(condition)
        self.assumptions.append(Assumption(time, condition, None, obligation, link.producer < 0))
        self.knowledge.apply(with_consequences(condition.fact, value), time)
        return Link(condition, time, value)

    def _fail(self, obligation: int, subtask: int, failed: list[tuple[Condition, Entry]]) -> None:
        """Records the root cause among the failed conditions and goes on as if they had held."""
        roots = [(c, e) for c, e in failed if not self._follows(c, e)]
        if roots:
            condition, entry = roots[0]
            self.failures.append(Failure(obligation, condition, None, entry, tuple(c for c, _ in roots)))
            self.dependents.append(0)
            self._failed_subtask = subtask
            self._suspects.update(self._names, *(_speaks_of(c, e.value) for c, e in roots))
        elif self.dependents:
            self.dependents[-1] += 1
        time = self.boundary_time
        self._tainted.add(time)
        for condition, _ in failed:
            self.knowledge.write(condition.fact, made_true(condition), time)

    def _follows(self, condition: Condition, entry: Entry) -> bool:
        """Decides whether a failed condition only follows from an earlier root cause."""
        if entry.time in self._tainted or not self._suspects.isdisjoint(_speaks_of(condition, entry.value)):
            return True
        # A subtask that failed may owe its successor the state of the robot.
        return self._failed_subtask is not None and condition.fact in ROBOT_FACTS

    def _need_formula(self, kind: ObligationKind, subtask: int, time: int, formula: bddl.Formula) -> None:
        """Decides a formula beyond literals by strong Kleene evaluation; every known atom read is its evidence."""
        links: dict[bddl.Atom, Link] = {}

        def read(atom: bddl.Atom) -> bool | None:
            condition = condition_of(atom, True)
            entry = self.knowledge.read(condition.fact)
            truth = condition.grade(entry.value)
            if truth is not None:
                links[atom] = Link(condition._replace(positive=truth), entry.time, entry.value)
            return truth

        truth = bddl.evaluate(formula, read, objects=self._objects)
        number = len(self.obligations)
        if truth is None and self._need_cases(kind, subtask, -1, formula):
            return
        if truth is None:
            self.assumptions.append(Assumption(self.boundary_time, None, formula, number, False))
        elif truth is False:
            self._fail_formula(number, subtask, formula, links.values())
        grade = {True: self._grades.get(number, Grade.HOLDS), None: Grade.POSSIBLE, False: Grade.FAILS}[truth]
        self.obligations.append(Obligation(kind, subtask, -1, time, grade, tuple(links.values())))

    def _fail_formula(self, obligation: int, subtask: int, formula: bddl.Formula | None, links: Iterable[Link]) -> None:
        """Records a formula that fails: as a root cause, unless it rests on what was written after one."""
        read = tuple(links)
        named = {name for link in read for name in _speaks_of(link.condition, link.value)}
        if self._suspects.isdisjoint(named) and not any(link.producer in self._tainted for link in read):
            self.failures.append(Failure(obligation, None, formula, UNWRITTEN, ()))
            self.dependents.append(0)
            self._failed_subtask = subtask
            self._suspects.update(self._names, named)
        elif self.dependents:
            self.dependents[-1] += 1

    def _need_cases(self, kind: ObligationKind, subtask: int, step: int, wanted: Needed) -> bool:
        """Records an obligation that holds or fails whatever is unknown, as was decided; else returns False."""
        number, fails = len(self.obligations), self._decision.fails
        if number not in self._grades and number != fails:
            return False
        read: dict[Fact, Entry] = {}

        def look(fact: Fact) -> Value:
            entry = read[fact] = self.knowledge.read(fact)
            return entry.value

        found = case_tree(wanted, look, self._objects)
        if found is not None and len(found[1]) == 1:
            return False
        links = tuple(Link(known_as(f, e.value), e.time, e.value) for f, e in read.items() if e.value is not None)
        if number == fails:
            grade = Grade.FAILS
            self._fail_formula(number, subtask, None if isinstance(wanted, tuple) else wanted, links)
        else:
            grade = self._grades[number]
        cases = TOO_MANY_CASES if found is None else found[1]
        self.checkable = self.checkable and found is not None
        self.obligations.append(Obligation(kind, subtask, step, self.boundary_time, grade, links, cases))
        return True


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
