"""Three-valued progression of what is known along a plan, with a causal link for everything that is needed.

After a failure the progression goes on as if the failed condition had held, so that a second, independent mistake is
found in the same run; what only follows from the first is counted with it and not reported.

Source: docs/semantics.md, Knowledge and Verdicts.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import bddl
from oag.compiled import CompiledSubtask
from oag.facts import EMPTY, HAND, ROBOT_FACTS, Condition, Fact, Value, condition_of
from oag.knowledge import UNWRITTEN, Entry, Knowledge
from oag.library import Clause, Effect, Needed, effect, requirements
from oag.obligations import Assumption, Failure, Grade, Link, Obligation, ObligationKind
from oag.primitives import Primitive


class Step(NamedTuple):
    """One executed step of the flattened plan; it writes at time 2 * number."""

    subtask: int
    position: int
    primitive: Primitive
    hand: Value
    effect: Effect


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
        forced: What had to be assumed of the start because there was no alternative.
        chose: True when an unknown alternative was assumed that might not have been needed.
    """

    def __init__(
        self, knowledge: Knowledge, objects: dict[str, str], preferred: frozenset[Condition] = frozenset()
    ) -> None:
        """Starts a progression.

        Args:
            knowledge: What is known of the start.
            objects: Categories of the scene's objects.
            preferred: Conditions to assume first where several alternatives are unknown.
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
        self.forced: set[Condition] = set()
        self.chose = False
        self._preferred = preferred
        self._objects = objects
        self._tainted: set[int] = set()
        self._failed_subtask: int | None = None

    @property
    def boundary_time(self) -> int:
        """The time between the last step so far and the next one."""
        return 2 * len(self.steps) + 1

    def run(self, subtasks: Iterable[CompiledSubtask], goal: Needed) -> None:
        """Follows all subtasks and decides every obligation up to the task goal."""
        count = 0
        for index, subtask in enumerate(subtasks):
            count += 1
            self._need("init", index, -1, subtask.init)
            if subtask.flow is None:
                self.undecided_from = index
                return
            if self._failed_subtask not in (None, index):
                self._failed_subtask = None
            self._run_flow(index, subtask)
        self._need("task-goal", count, -1, goal)

    def _run_flow(self, index: int, subtask: CompiledSubtask) -> None:
        """Follows one flow and decides its goal."""
        if self._holds(subtask.goal):
            self.vacuous.append(index)
        knowledge, context = self.knowledge, subtask.context
        for position, action in enumerate(subtask.flow or ()):
            primitive = action.primitive
            hand = knowledge.read(HAND).value
            clauses = requirements(primitive, context, hand)
            self._need("precondition", index, position, clauses)
            written = effect(primitive, context, knowledge.read(HAND).value if clauses else hand)
            self.steps.append(Step(index, position, primitive, hand, written))
            if primitive is Primitive.GRASP and context.target_is_item:
                along = knowledge.cargo(context.target)
                if along:
                    self.cargo.append(Cargo(len(self.steps) - 1, along))
            time = 2 * len(self.steps)
            knowledge.apply(written, time)
            if self._failed_subtask == index:
                self._tainted.add(time)
        self._need("goal", index, -1, subtask.goal)

    def _holds(self, wanted: Needed) -> bool:
        """True when a goal is known to hold already."""
        if not isinstance(wanted, tuple):
            return bddl.evaluate(wanted, self.knowledge.value, objects=self._objects) is True
        return bool(wanted) and all(c.grade(self.knowledge.read(c.fact).value) for (c,) in wanted)

    def _need(self, kind: ObligationKind, subtask: int, step: int, wanted: Needed) -> None:
        """Decides one obligation and records its links, assumptions and failures."""
        time = self.boundary_time
        if not isinstance(wanted, tuple):
            self._need_formula(kind, subtask, time, wanted)
            return
        grade = Grade.HOLDS
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
                self._note_choice(clause, link)
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
        """Returns the link of the first alternative that holds, else of a preferred or the first unknown one."""
        unknown: Link | None = None
        for condition in clause:
            entry = self.knowledge.read(condition.fact)
            grade = condition.grade(entry.value)
            if grade:
                return Link(condition, entry.time, entry.value)
            if grade is None and (unknown is None or condition in self._preferred):
                unknown = Link(condition, entry.time, None)
        return unknown

    def _note_choice(self, clause: Clause, link: Link) -> None:
        """Notes whether an assumption about the start is forced, or one of several alternatives."""
        if link.value is None and link.producer < 0:
            if len(clause) == 1:
                self.forced.add(link.condition)
            else:
                self.chose = True

    def _assume(self, link: Link, obligation: int) -> Link:
        """Records that an unknown condition is assumed, and returns the link to the assumption."""
        time = self.boundary_time
        condition = link.condition
        value = condition.value if condition.positive else False
        self.assumptions.append(Assumption(time, condition, None, obligation, link.producer < 0))
        self.knowledge.write(condition.fact, value, time)
        return Link(condition, time, value)

    def _fail(self, obligation: int, subtask: int, failed: list[tuple[Condition, Entry]]) -> None:
        """Records the root cause among the failed conditions and goes on as if they had held."""
        roots = [(c, e) for c, e in failed if not self._follows(c, e)]
        if roots:
            condition, entry = roots[0]
            self.failures.append(Failure(obligation, condition, None, entry, tuple(c for c, _ in roots)))
            self.dependents.append(0)
            self._failed_subtask = subtask
        elif self.dependents:
            self.dependents[-1] += 1
        time = self.boundary_time
        self._tainted.add(time)
        for condition, _ in failed:
            self.knowledge.write(condition.fact, _repaired(condition), time)

    def _follows(self, condition: Condition, entry: Entry) -> bool:
        """Decides whether a failed condition only follows from an earlier root cause."""
        if entry.time in self._tainted:
            return True
        if self._failed_subtask is None:
            return False
        # A subtask that failed may owe its successor the state of the hand and of its own target.
        last = self.failures[-1]
        owed = last.condition is None or condition.fact in ROBOT_FACTS
        return owed or bool(self._owed & set(condition.fact[1:]))

    @property
    def _owed(self) -> set[str]:
        """The objects whose state the last root cause speaks of."""
        condition = self.failures[-1].condition
        return set() if condition is None else set(condition.fact[1:])

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
        if truth is None:
            self.assumptions.append(Assumption(self.boundary_time, None, formula, number, False))
        elif truth is False:
            if not any(link.producer in self._tainted for link in links.values()):
                self.failures.append(Failure(number, None, formula, UNWRITTEN, ()))
                self.dependents.append(0)
                self._failed_subtask = subtask
            elif self.dependents:
                self.dependents[-1] += 1
        grade = {True: Grade.HOLDS, None: Grade.POSSIBLE, False: Grade.FAILS}[truth]
        self.obligations.append(Obligation(kind, subtask, -1, time, grade, tuple(links.values())))


def _repaired(condition: Condition) -> Value:
    """Returns a value that makes a condition true."""
    if condition.positive:
        return condition.value
    return EMPTY if condition.fact == HAND else False
