"""Three-valued progression of knowledge along a plan, with a causal link for everything that is needed.

Obligations of subtask k, in order: its initial condition where it starts (B_0 for the first, C(k-1) after that), the
precondition of every step P(k,i), and its goal at the flow's end G(k). The task goal F comes last. Well-formedness (W)
comes before all of them and is decided by `oag.wellformed`. Locality (L) is reported in addition.

After a failure the progression continues as if the failed condition had held. So a second, independent mistake is
found in the same run; consequences of the first are counted with it and not reported.

A case distinction is a list in preorder: an unknown fact stands before the case in which it is true and the case in
which it is false, and None ends a case. Three-valued evaluation decides each case, so that a checker can repeat it.

Source: docs/semantics.md, Knowledge, Verdicts and Certificates.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum
from typing import Literal, NamedTuple, TypeAlias

import bddl
from oag.compilation import CompiledSubtask
from oag.model.codec import brief
from oag.model.symbols import (
    EMPTY,
    FREE,
    HOME,
    ROBOT_FACTS,
    Condition,
    Fact,
    Primitive,
    Value,
    condition_of,
    generalisations,
    known_as,
    satisfying_value,
)
from oag.primitives.cargo import NOTHING_CARRIED, Starts
from oag.primitives.state import (
    NEVER,
    START,
    UNWRITTEN,
    Entry,
    Reader,
    State,
    truth_of,
)
from oag.primitives.table import (
    Clause,
    Effect,
    Needed,
    excluded,
    with_consequences,
)
from oag.task_definition import label

ObligationKind = Literal["init", "precondition", "goal", "task-goal"]


class Grade(Enum):
    """Truth of an obligation over the states that are consistent with what is known."""

    HOLDS = "HOLDS"
    POSSIBLE = "POSSIBLE"
    FAILS = "FAILS"


class CausalLink(NamedTuple):
    """One causal link: a condition, and the write that decides it.

    Attributes:
        producer: Time of the write that gave the fact its value; 0 for the start state.
    """

    condition: Condition
    producer: int
    value: Value


class Obligation(NamedTuple):
    """One need at one place.

    Attributes:
        subtask: Index of the subtask; for the task goal, the number of subtasks.
        step: Index of the step for a precondition, else -1.
        time: When it must hold: writes before this time count.
        cases: The distinction of cases that decided it, in preorder, where links alone do not. An unknown fact stands
            before its case true and its case false; None ends a case. None when there is no such distinction.
    """

    kind: ObligationKind
    subtask: int
    step: int
    time: int
    grade: Grade
    links: tuple[CausalLink, ...]
    cases: tuple[Fact | None, ...] | None = None

    def __repr__(self) -> str:
        return brief(f"<Obligation {self.grade.value} at {self.place}: {', '.join(c.text() for c, *_ in self.links)}>")

    @property
    def place(self) -> str:
        """Where it must hold, in short: `T3.4`, `T3's goal`, or `the task goal`."""
        if self.kind == "task-goal":
            return "the task goal"
        return label(self.subtask, self.step) if self.kind == "precondition" else f"T{self.subtask + 1}'s {self.kind}"


class Assumption(NamedTuple):
    """Something unknown that a plan needs.

    Attributes:
        condition: The literal; None when a formula beyond literals is unknown as a whole.
        formula: That formula, or None.
        obligation: Index of the obligation that needs it.
        about_start: True when nothing before wrote the fact, so that the assumption is about S_0.
    """

    time: int
    condition: Condition | None
    formula: bddl.Formula | None
    obligation: int
    about_start: bool


class RootFailure(NamedTuple):
    """A root failure: an obligation that fails, not as a consequence of an earlier failure.

    Attributes:
        condition: The literal that is false; None when a formula beyond literals is.
        formula: That formula, or None.
        entry: The write that made the literal false.
        missing: Every literal of the obligation that fails independently, this one included.
    """

    obligation: int
    condition: Condition | None
    formula: bddl.Formula | None
    entry: Entry
    missing: tuple[Condition, ...]


@dataclass(frozen=True, slots=True)
class Decision:
    """Decision of the obligations that progression left open.

    Attributes:
        fails: Index of the first obligation that no run meets; None when some run meets all.
        grades: Grades of the open obligations before that one, each over the runs that meet all earlier ones.
        given: What to assume, by the index of the obligation that first mentions it. With it every obligation up to
            `fails` holds, or all; none of it can be omitted.
        run: A run that reaches the failing obligation, as (time, fact, value) for every unknown fact that the plan
            mentions; time 0 is the start. None when nothing fails.
        miss: When an assumption is needed, a run that misses an obligation, in the same form; else None.
    """

    fails: int | None = None
    grades: Mapping[int, Grade] = field(default_factory=dict)
    given: Mapping[int, tuple[Condition, ...]] = field(default_factory=dict)
    run: tuple[tuple[int, Fact, Value], ...] | None = None
    miss: tuple[tuple[int, Fact, Value], ...] | None = None


NOTHING_DECIDED = Decision()

CaseTree: TypeAlias = tuple[Fact | None, ...]
# A distinction with more entries than this is not listed; the solver's answer is then the only evidence.
LARGEST_TREE = 10_000
# Most reads of facts for one distinction, some seconds: each case evaluates the whole formula.
MOST_READS = 300_000
TOO_MANY_CASES: CaseTree = ()


# Whether no start gives a fact a value in a case.
Exclusion = Callable[[Fact, bool, Mapping[Fact, bool]], bool]


def case_tree(
    wanted: Needed,
    read: Reader,
    objects: Mapping[str, str],
    largest: int = LARGEST_TREE,
    excludes: Exclusion = lambda *_: False,
) -> tuple[bool, CaseTree] | None:
    """Return the value that clauses or a formula have in every case, with the cases.

    None when the cases disagree, are too many, or take too long to evaluate. `excludes` says which cases cannot be.
    """
    reads = 0

    def counted(fact: Fact) -> Value:
        nonlocal reads
        reads += 1
        return known(fact)

    tree: list[Fact | None] = []
    result: bool | None = None
    pending: list[dict[Fact, bool] | None] = [{}]
    while pending:
        if len(tree) + len(pending) > largest or reads > MOST_READS:
            return None
        case = pending.pop()
        if case is None:
            tree.append(None)
            continue
        known = _with(read, case)
        truth, unknown = _truth(wanted, counted, objects)
        if truth is not None:
            if result not in (None, truth):
                return None
            result = truth
            tree.append(None)
        elif unknown is None:
            return None
        else:
            tree.append(unknown)
            # None stands for a case that the invariants exclude.
            never = excluded(unknown, known) or excludes(unknown, True, case)
            pending.append(None if excludes(unknown, False, case) else {**case, unknown: False})
            pending.append(None if never else {**case, unknown: True})
    return None if result is None else (result, tuple(tree))


def _truth(wanted: Needed, read: Reader, objects: Mapping[str, str]) -> tuple[bool | None, Fact | None]:
    """Return whether clauses or a formula hold by what is known, and the first unknown fact that decides it."""
    unknown: list[Fact] = []

    def noting(fact: Fact) -> Value:
        value = read(fact)
        if value is None:
            unknown.append(fact)
        return value

    if not isinstance(wanted, tuple):
        truth = truth_of(wanted, noting, objects)
    else:
        truth = truth_of(wanted, read, objects)
        undecided = next((clause for clause in wanted if truth_of((clause,), read, objects) is None), ())
        truth_of((undecided,), noting, objects)
    return truth, unknown[0] if unknown else None


def _with(read: Reader, case: dict[Fact, bool]) -> Reader:
    return lambda fact: case[fact] if fact in case else read(fact)


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
    """The progression of a plan, as far as it is decided.

    Attributes:
        state: What is known at the end of the plan, or where progression stopped.
        writes: Writes after the start with their times: by steps at even times, else by assumptions.
        steps: The flattened plan; step n (from 1) is `steps[n - 1]`.
        assumptions: What was unknown and needed, in order; each fact once.
        failures: Root failures, in order.
        dependents: For each root failure, how many later failures follow from it.
        vacuous: Indices of subtasks whose goal held already when they started.
        undecided_from: Index of the first subtask without a flow, where progression stops; None when there is none.
        chose: True when an unknown alternative was assumed that might not have been needed.
        counterexample: A complete start state from which the plan runs up to its first failure, as (time, fact, value).
            Values at later times belong to facts that a step leaves open. None when none was searched.
        miss: A run that misses an obligation, in the same form, where an exact decision needs an assumption; else None.
        boundary_time: The time between the last step so far and the next one.
        starts: What can be so where the plan starts.
        about_start: What is assumed of the start.
        checkable: False when links and cases do not show the verdict, so that no checker can confirm it.
        unsettled: Why a needed exact decision failed; None when none was needed, or it succeeded.
    """

    def __init__(
        self, start: State, objects: dict[str, str], decision: Decision = NOTHING_DECIDED, *, chose: bool = False
    ) -> None:
        """Start a progression; `chose` says that the decision rests on what might not have been needed."""
        # A plan is long: its state is written to, not copied at every step.
        self.start, self.state, self._sure = start, start.own(), start
        self.writes: list[tuple[int, Effect]] = []
        self.steps: list[Step] = []
        self.boundary_time = 1
        self.obligations: list[Obligation] = []
        self.assumptions: list[Assumption] = []
        self.failures: list[RootFailure] = []
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
        # Objects of root failures, and of the subtasks that failed.
        self._suspects: set[str] = set()
        self._names: tuple[str, ...] = ()
        self._failed_subtask: int | None = None
        self.starts = Starts(NOTHING_CARRIED, start.value)
        self.about_start: dict[Fact, Value] = {}

    def history(self, fact: Fact) -> Iterator[Entry]:
        """Yield the writes that covered a fact, in order; of those at one time only the most specific one."""
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
        """Return the first write, up to a time, of the unbroken run of one answer to "has the fact this value?".

        Runs of any other value count as one answer.
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
        """Drop failures that may rest on a wrong choice, when no exact decision was possible."""
        self.unsettled = reason
        self.checkable = False
        self.failures.clear()
        self.dependents.clear()

    def run(self, subtasks: Sequence[CompiledSubtask], goal: Needed) -> None:
        """Follow all subtasks and decides every obligation up to the task goal."""
        if subtasks:
            self.starts = Starts(subtasks[0].context.carriage, self.start.value)
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
        rows, state = subtask.rows, self.state
        if subtask.goal != () and truth_of(subtask.goal, state.value, self._objects):
            self.vacuous.append(index)
        for position, action in enumerate(subtask.flow or ()):
            primitive, parameter, hand = action.primitive, action.parameter, state.hand
            needs, written = rows.row(primitive, hand, parameter)
            self._need("precondition", index, position, needs)
            time = self.boundary_time + 1
            met = state.hand
            # A condition on the hand that failed, or was unknown, counts as met from here on.
            if rows.carries or met != hand:
                written = rows.written(primitive, met, parameter, self._sure.value)
                self._sure = self._sure.after(written, time) if rows.carries else self._sure
            state.write(written, time)
            self.boundary_time = time + 1
            self.writes.append((time, written))
            self.steps.append(Step(index, position, primitive, hand, written))
            if self._failed_subtask == index:
                self._tainted.add(time)
        self._need("goal", index, -1, subtask.goal)

    def _write(self, effect: Effect) -> None:
        self.state.write(effect, self.boundary_time)
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
        held = self._held(wanted)
        if held is not None:
            return grade, held, None
        links = [self._decide(clause) for clause in wanted]
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

    def _held(self, wanted: tuple[Clause, ...]) -> tuple[CausalLink, ...] | None:
        """Return the links of clauses that all hold by what is known, as in most plans; else None."""
        links, last = [], self.state.last
        for clause in wanted:
            for condition in clause:
                fact, meant, positive = condition
                value, time = last(fact)
                if value is not None and (value == meant) is positive:
                    links.append(CausalLink(condition, time, value))
                    break
            else:
                return None
        return tuple(links)

    def _decide(self, clause: Clause) -> CausalLink | None:
        """Return the link of the first alternative that holds, else of the first unknown one."""
        unknown: CausalLink | None = None
        for condition in clause:
            fact, wanted, positive = condition
            value, time = self.state.last(fact)
            if value is None:
                unknown = unknown or CausalLink(condition, time, None)
            elif (value == wanted) is positive:
                return CausalLink(condition, time, value)
        return unknown

    def _assume(self, link: CausalLink, obligation: int) -> CausalLink:
        """Record that an unknown condition is assumed, and returns the link to the assumption."""
        time = self.boundary_time
        condition = link.condition
        known = self.state.read(condition.fact)
        if known.value is not None:
            # Another clause of the same obligation has assumed it.
            return CausalLink(condition, known.time, known.value)
        value = satisfying_value(condition)
        of_start = link.producer < 0
        self.assumptions.append(Assumption(time, condition, None, obligation, of_start))
        if of_start:
            self.about_start[condition.fact] = value
        self._write(with_consequences(condition.fact, value))
        return CausalLink(condition, time, value)

    def _fail(self, obligation: int, subtask: int, failed: list[tuple[Condition, Entry]]) -> None:
        """Record the root failure among the failed conditions, and continue as if they had held."""
        roots = [(c, e) for c, e in failed if not self._follows(c, e)]
        if roots:
            cause = RootFailure(obligation, roots[0][0], None, roots[0][1], tuple(c for c, _ in roots))
            self._blame(cause, subtask, set().union(*(_objects_of(c, e.value) for c, e in roots)))
        elif self.dependents:
            self.dependents[-1] += 1
        self._tainted.add(self.boundary_time)
        self._write(tuple((condition.fact, satisfying_value(condition)) for condition, _ in failed))

    def _blame(self, cause: RootFailure, subtask: int, names: set[str]) -> None:
        self.failures.append(cause)
        self.dependents.append(0)
        self._failed_subtask = subtask
        self._suspects.update(self._names, names)

    def _follows(self, condition: Condition, entry: Entry) -> bool:
        """Decide whether a failed condition only follows from an earlier root failure."""
        if entry.time in self._tainted or not self._suspects.isdisjoint(_objects_of(condition, entry.value)):
            return True
        # A subtask that failed may owe its successor the state of the robot.
        return self._failed_subtask is not None and condition.fact in ROBOT_FACTS

    def _formula(self, number: int, subtask: int, formula: bddl.Formula) -> _Decided:
        """Decide a formula beyond literals by strong Kleene evaluation; every known atom read is its evidence."""
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
        """Record a formula that fails: as a root failure, unless it rests on what was written after one."""
        read = tuple(links)
        named = {name for link in read for name in _objects_of(link.condition, link.value)}
        if self._suspects.isdisjoint(named) and not any(link.producer in self._tainted for link in read):
            self._blame(RootFailure(obligation, None, formula, UNWRITTEN, ()), subtask, named)
        elif self.dependents:
            self.dependents[-1] += 1

    def _by_cases(self, number: int, subtask: int, wanted: Needed) -> _Decided | None:
        """Return the decision of an obligation that the exact decision graded, by cases; None for any other."""
        fails = number == self._decision.fails
        if number not in self._decision.grades and not fails:
            return None
        read: dict[Fact, Entry] = {}

        def look(fact: Fact) -> Value:
            entry = read[fact] = self.state.read(fact)
            return entry.value

        found = case_tree(wanted, look, self._objects, excludes=self._excludes)
        if found is not None and len(found[1]) == 1:
            return None
        links = tuple(CausalLink(known_as(f, e.value), e.time, e.value) for f, e in read.items() if e.value is not None)
        if fails:
            self._fail_formula(number, subtask, None if isinstance(wanted, tuple) else wanted, links)
        self.checkable = self.checkable and found is not None
        grade = Grade.FAILS if fails else self._decision.grades[number]
        return grade, links, TOO_MANY_CASES if found is None else found[1]

    def _excludes(self, fact: Fact, value: bool, case: Mapping[Fact, bool]) -> bool:
        """Decide whether no start gives a fact a value; what a step left open is no fact of the start."""
        if self.starts.carriage == NOTHING_CARRIED or self.state.read(fact).time != NEVER:
            return False
        given = {each: truth for each, truth in case.items() if self.state.read(each).time == NEVER}
        return self.starts.exclude(fact, value, {**self.about_start, **given})


def holds_throughout(
    start: State, subtasks: Sequence[CompiledSubtask], goal: Needed, objects: Mapping[str, str]
) -> bool:
    """Decide whether what is known meets every obligation of a plan, as a `Trace` of it would, without its evidence."""
    state, time = start.own(), START

    def known(wanted: Needed) -> bool:
        return wanted == () or truth_of(wanted, state.value, objects) is True

    for subtask in subtasks:
        if subtask.flow is None or not known(subtask.init):
            return False
        rows = subtask.rows
        for action in subtask.flow:
            primitive, parameter, hand = action.primitive, action.parameter, state.hand
            needs, written = rows.row(primitive, hand, parameter)
            if not known(needs):
                return False
            if rows.carries:
                written = rows.written(primitive, hand, parameter, state.value)
            time += 2
            state.write(written, time)
        if not known(subtask.goal):
            return False
    return known(goal)


def _objects_of(condition: Condition, value: Value) -> set[str]:
    """Return the objects of a condition, and of the value that its fact has."""
    named = [text.rpartition(" ")[2] for text in (condition.value, value) if isinstance(text, str)]
    return {*condition.fact[1:], *named} - {EMPTY, HOME, FREE}


def producer_place(trace: Trace, time: int) -> str:
    """Return the writer at a time: `the start`, or `T2 step 4 GRASP`."""
    if time == START or time % 2:
        return "the start"
    step = trace.steps[time // 2 - 1]
    return f"T{step.subtask + 1} step {step.position + 1} {step.primitive.name}"
