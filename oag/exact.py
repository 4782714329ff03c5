"""Exact decisions over all runs of a plan, and the counterexample: one run on which a refuted plan fails.

A run is a start state that agrees with what is known, with a value for everything that becomes unknown on the way.
Three-valued progression answers "unknown" where several unknown facts depend on each other, through a formula or the
invariants. A solver decides such a plan. The first question is whether some run misses an obligation. Only then it is
asked which obligation no run meets, or which assumptions are needed, as few literals as possible.

A counterexample is a complete start state, and the states after it up to the failure.

Source: docs/semantics.md, Exact decision.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import count as numbers
from typing import NamedTuple

import bddl
from bddl.smt import FALSE, TRUE, Assumed, Script, Solver, SolverAnswer, conjunction, disjunction, negation, solve
from oag.compilation import CompiledSubtask
from oag.model.codec import short_repr
from oag.model.scene import Scene
from oag.model.symbols import ANY, EEF, HAND, NEAR, Condition, Fact, Value, condition_of, fact_text, satisfying_value
from oag.primitives.cargo import NOTHING_CARRIED, RESTING, Carriage, closed, is_place, reached
from oag.primitives.state import NEVER, START, Reader, State, scene_facts
from oag.primitives.table import Clause, Needed, converse, with_consequences
from oag.progression import Assumption, Decision, Grade, Obligation, Step, Trace
from oag.task_definition import Task, label

# Most assumed values in all questions about one plan: some seconds. Deciding for each unknown fact whether it is
# needed takes as many questions as there are such facts, each about all of them.
MOST_ASSUMED = 100_000


class Undecided(Exception):
    """The solver ran out of time, or the question was too large; the result of progression stands."""


def decide(unrolled: Unrolled) -> Decision:
    """Return the decision of a plan's open obligations.

    Raises Undecided when the solver ran out of time, or the question was too large.
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


def needs_exact_decision(trace: Trace) -> bool:
    """Decide whether progression alone may differ from what holds of all runs.

    It may where a formula stayed unknown, where one of several unknown alternatives was assumed, and where one of two
    assumptions entails the other, or what carries what ties them. Anything after a failure does not matter.
    """
    failed = trace.failures[0].obligation if trace.failures else len(trace.obligations)
    before = [assumption for assumption in trace.assumptions if assumption.obligation <= failed]
    conditions = {assumption.condition for assumption in before}
    chosen = None in conditions or (trace.chose and bool(before))
    return chosen or any(_entailed(c, conditions) for c in conditions) or _tied_by_cargo(trace, before)


def _entailed(condition: Condition | None, others: Collection[Condition | None]) -> bool:
    """Decide whether a negative assumption follows from an invariant, or from another assumption."""
    if condition is None or condition.positive:
        return False
    other = converse(condition.fact)
    return other is not None and (other == condition.fact or Condition(other, True) in others)


def _tied_by_cargo(trace: Trace, assumptions: Collection[Assumption]) -> bool:
    """Decide whether what carries what excludes an assumption about the start, or its opposite, given the others."""
    made = {a.condition.fact: satisfying_value(a.condition) for a in assumptions if a.about_start and a.condition}
    for fact in made if trace.starts.carriage != NOTHING_CARRIED else ():
        others = {other: value for other, value in made.items() if other != fact}
        if any(trace.starts.exclude(fact, value, others) for value in (True, False)):
            return True
    return False


class _Deciding:
    def __init__(self, unrolled: Unrolled) -> None:
        self._unrolled = unrolled
        self._session = Solver(unrolled.text())
        self._script = Script(prefix="o")
        # What is open before the first obligation that fails, each with the name under which it can be asked about.
        self._open = [(each, self._script.name(each.term)) for each in unrolled.open]
        self._met = self._name_for_all()
        self._left = MOST_ASSUMED

    def run(self) -> Decision:
        """Return the decision."""
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
        """Return how many open obligations some run meets in a row; no such run meets the next one."""
        possible, impossible = 0, len(self._open)
        while impossible - possible > 1:
            middle = (possible + impossible) // 2
            if self._satisfiable((name, True) for _, name in self._open[:middle]):
                possible = middle
            else:
                impossible = middle
        return possible

    def _one_run(self) -> dict[Unknown, bool]:
        """Return a run that meets all open obligations, with as much false as possible, the last mentioned first."""
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
        """Return a run that misses an open obligation; one exists when an assumption is needed."""
        true = self._ask([(self._met, False)]).true
        return _written({unknown: name in true for unknown, name in self._unrolled.names.items()})

    def _needed_of(self, run: Mapping[Unknown, bool]) -> dict[Unknown, bool]:
        """Return the values of a run that the open obligations need: without any one of them, some run misses one."""
        # What only later obligations mention is of no use to those that are open.
        names, spoken = self._unrolled.names, {unknown for each, _ in self._open for unknown in each.unknowns}
        assumed = [(names[unknown], value) for unknown, value in run.items() if unknown in spoken]
        clash = self._ask([*assumed, (self._met, False)]).core
        kept = {name: value for name, value in assumed if (name, value) in clash}
        for name in reversed(list(kept)):
            others = [(other, value) for other, value in kept.items() if other != name]
            if not self._satisfiable([*others, (self._met, False)]):
                del kept[name]
        return {unknown: value for unknown, value in run.items() if names[unknown] in kept}

    def _grades(self) -> dict[int, Grade]:
        """Return the grades in order, while each obligation is required for the ones after it."""
        grades: dict[int, Grade] = {}
        for each, name in self._open:
            grades[each.number] = Grade.POSSIBLE if self._satisfiable([(name, False)]) else Grade.HOLDS
            self._session.require(name)
        return grades

    def _placed(self, given: Mapping[Unknown, bool]) -> dict[int, tuple[Condition, ...]]:
        """Return the given values by the obligation that first mentions them, or what they exclude."""
        placed: dict[int, tuple[Condition, ...]] = {}
        left = dict(given)
        for each, _ in self._open:
            spoken = [u for unknown in each.unknowns for u in _tied(unknown) if u in left]
            conditions = tuple(Condition(u.fact, True, left.pop(u)) for u in dict.fromkeys(spoken))
            if conditions:
                placed[each.number] = conditions
        return placed

    def _name_for_all(self) -> str:
        """Return a constant that is true exactly when all open obligations are met, and reads what is new."""
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
    """Return a run as (time, fact, value); at time 0 the start."""
    return tuple((max(unknown.time, START), unknown.fact, value) for unknown, value in run.items())


def _tied(unknown: Unknown) -> tuple[Unknown, ...]:
    other = converse(unknown.fact)
    return (unknown,) if other is None else (unknown, unknown._replace(fact=other))


class Unknown(NamedTuple):
    """A fact from the time at which it is unknown; `time` is negative for the start, else when it was blurred."""

    fact: Fact
    time: int


class OpenObligation(NamedTuple):
    """An obligation that depends on what is unknown.

    Attributes:
        term: The term that is true exactly when it holds.
    """

    number: int
    term: str
    unknowns: tuple[Unknown, ...]


class Unrolled:
    """A plan's obligations as terms.

    Attributes:
        names: The constant that stands for each unknown, in order of first mention.
        open: The obligations that depend on what is unknown, in order.
        fails: Index of the first obligation that holds in no state, where the plan ends at the latest; None when there
            is none.
    """

    def __init__(
        self,
        objects: Mapping[str, str],
        start: State | None = None,
        carriage: Carriage = NOTHING_CARRIED,
        *,
        every: bool = False,
    ) -> None:
        """Begin without obligations, with what is known of the start, and who may carry whom.

        `every` writes what is known as constants with given values too, so that nothing is decided beforehand.
        """
        self.names: dict[Unknown, str] = {}
        self.open: list[OpenObligation] = []
        self.fails: int | None = None
        self._objects, self._start, self._carriage = objects, start or State(), carriage
        self._every = every
        self._script = Script()
        self._known: dict[tuple[Condition, int], str] = {}
        self._apart: dict[tuple[Unknown, Unknown], None] = {}

    def text(self) -> str:
        """Return the SMT-LIB text that defines the terms and states the invariants of the start."""
        lines = [self._script.text()]
        for left, right in self.exclusions():
            apart = disjunction(negation(self.names[each]) for each in (left, right))
            lines.append(f"(assert {apart})")
        if self._carriage != NOTHING_CARRIED:
            of_start = {unknown.fact: name for unknown, name in self.names.items() if unknown.time == NEVER}
            resting = {fact: name for fact, name in of_start.items() if is_place(fact)}
            lines.append(_cargo_text(resting, self._carriage, self._start.value))
        return "\n".join(lines)

    def exclusions(self) -> Iterator[tuple[Unknown, Unknown]]:
        """Yield the pairs of unknowns of which at most one is true; a pair of twice the same is false.

        Both are so at one moment, though one may be open since a later step than the other.

        Source: docs/semantics.md, States: `inside` and `ontop` are irreflexive and antisymmetric.
        """
        yield from ((one, other) for one, other in self._apart if one in self.names and other in self.names)

    def add(self, number: int, wanted: Needed, state: State) -> None:
        """Add what is needed at one place, where `state` is what is known there."""
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
        """Return the term of a clause, and note its unknown facts unless they make no difference."""
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
        excluding = converse(fact)
        if excluding is not None:
            other = Unknown(excluding, state.read(excluding).time)
            self._apart[(unknown, other) if unknown <= other else (other, unknown)] = None
        return name if condition.positive else negation(name)

    def _constant(self, condition: Condition, time: int, truth: bool) -> str:
        term = TRUE if truth else FALSE
        if not self._every:
            return term
        name = self._known.get((condition, time))
        if name is None:
            name = self._known[condition, time] = self._script.define(term)
        return name


def _cargo_text(named: Mapping[Fact, str], carriage: Carriage, known: Reader) -> str:
    """Return what holds of places at the start: nothing carries itself, and cargo is inside what its carrier is inside.

    There is a constant for two things, of which one follows to be inside the other, or is carried by it in a circle.

    Args:
        named: The constant of each unknown fact about places.
        carriage: Who may carry whom.
        known: What is known of the start.
    """
    edges: dict[str, list[tuple[str, str, str]]] = {}
    for (relation, thing, place), name in named.items():
        edges.setdefault(thing, []).append((name, relation, place))
    for thing, places in carriage.places:
        sure = [(TRUE, relation, place) for relation, place in places if known((relation, thing, place)) is True]
        edges.setdefault(thing, []).extend(sure)
    steps = {thing: dict.fromkeys(place for *_, place in found) for thing, found in edges.items()}
    under = {thing: reached(thing, steps) for thing in steps}
    # What is known alone is consistent: only what rests on something open is written, and what is below that.
    touched = dict.fromkeys(thing for _, thing, _ in named)
    touched |= dict.fromkeys(thing for thing in edges if any(place in touched for place in under[thing]))
    touched |= dict.fromkeys(place for thing in tuple(touched) for place in under[thing])
    script, number = Script(), numbers()
    inside: dict[str, dict[str, str]] = {thing: {} for thing in touched}
    carried: dict[str, dict[str, str]] = {thing: {} for thing in touched}
    for thing in touched:
        below = under.get(thing, ())
        holders = [
            place for each in (thing, *below) for _, relation, place in edges.get(each, ()) if relation == "inside"
        ]
        inside[thing] = {place: f"r{next(number)}" for place in dict.fromkeys(holders) if place != thing}
        carried[thing] = {place: f"r{next(number)}" for place in below if thing in under.get(place, ())}
        script.declare(*inside[thing].values(), *carried[thing].values())
    for thing in touched:
        for term, relation, place in edges.get(thing, ()):
            for table, direct in ((inside, ("inside",)), (carried, RESTING)):
                if relation in direct and place in table[thing]:
                    script.require(disjunction((negation(term), table[thing][place])))
                for outer, name in table[place].items():
                    if outer in table[thing]:
                        script.require(disjunction((negation(term), negation(name), table[thing][outer])))
            if thing in carried[place]:
                script.require(disjunction((negation(term), negation(carried[place][thing]))))
        for place, name in inside[thing].items():
            fact = ("inside", thing, place)
            if fact in named or known(fact) is False:
                script.require(disjunction((negation(name), named.get(fact, FALSE))))
    return script.text()


def unroll(
    trace: Trace, subtasks: Sequence[CompiledSubtask], goal: Needed, objects: Mapping[str, str], *, every: bool = False
) -> Unrolled:
    """Return the terms of all obligations of a plan that was followed.

    Of the trace, only its start, its steps and the places of its obligations are read. For `every` see `Unrolled`.
    """
    unrolled = Unrolled(objects, trace.start, trace.starts.carriage, every=every)
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
    return obligation.grade is not Grade.HOLDS or any(link.producer % 2 for link in obligation.links)


def _wanted(obligation: Obligation, trace: Trace, subtasks: Sequence[CompiledSubtask], goal: Needed) -> Needed:
    if obligation.kind == "task-goal":
        return goal
    subtask = subtasks[obligation.subtask]
    if obligation.kind == "precondition":
        step = trace.steps[obligation.time // 2]
        return subtask.rows.row(step.primitive, step.hand)[0]
    return subtask.init if obligation.kind == "init" else subtask.goal


# Facts with their values.
Facts = tuple[tuple[Fact, Value], ...]


class Moment(NamedTuple):
    """One step and the facts of the plan that it gave another value."""

    step: Step
    changes: Facts

    def __str__(self) -> str:
        text = ", ".join(fact_text(fact, value) for fact, value in self.changes)
        return f"{label(self.step.subtask, self.step.position)} {self.step.primitive.name}: {text or 'no change'}"


@short_repr
@dataclass(frozen=True, slots=True)
class Counterexample:
    """A start state from which a plan fails, and the run up to the failure.

    Attributes:
        start: The values of all facts that the plan mentions up to there, and of all that the scene states.
        moments: The steps that still run, in order.
    """

    start: Facts
    moments: tuple[Moment, ...]
    stops_at: Obligation

    def to_json(self) -> dict[str, object]:
        """Return the run as JSON values."""
        return {
            "start": [[list(fact), value] for fact, value in self.start],
            "steps": [
                {
                    "step": label(step.subtask, step.position),
                    "primitive": step.primitive.name,
                    "changes": [[list(fact), value] for fact, value in changes],
                }
                for step, changes in self.moments
            ],
            "stops_at": [self.stops_at.kind, self.stops_at.subtask, self.stops_at.step],
        }

    def __str__(self) -> str:
        """Return the start and what every step changes, a line each."""
        start = ", ".join(fact_text(fact, value) for fact, value in self.start)
        return "\n".join((f"start: {start}", *map(str, self.moments), f"fails: {self.stops_at.place}"))


def counterexample(task: Task, scene: Scene, trace: Trace) -> Counterexample | None:
    """Return a run on which a plan fails at its first root cause; None when nothing fails.

    The plan's assumptions hold in this run; every other relevant unknown fact is false.
    """
    if not trace.failures:
        return None
    number = trace.failures[0].obligation
    stops_at = trace.obligations[number]
    given = given_run(trace, number)
    spoken = dict.fromkeys((NEAR, EEF, HAND))
    spoken |= dict.fromkeys(fact for fact, _ in scene_facts(scene) if ANY not in fact)
    spoken |= dict.fromkeys(fact for _, fact, _ in given)
    for obligation in trace.obligations[: number + 1]:
        spoken |= dict.fromkeys(link.condition.fact for link in obligation.links)

    known = trace.start
    for time, fact, value in given:
        if time == START:
            known = known.after(with_consequences(fact, value))
    resting = {f for f, entry in known.entries() if entry.value is True and is_place(f)}
    implied = {fact for fact in closed(resting) if known.value(fact) is None}
    known = known.after(tuple((fact, True) for fact in sorted(implied)))
    spoken |= dict.fromkeys(sorted(implied))
    state = {fact: _settled(known, fact, False) for fact in spoken if known.value(fact) or len(fact) > 1}
    start = tuple(state.items())
    moments = []
    for count, step in enumerate(trace.steps[: stops_at.time // 2], start=1):
        known = known.after(step.effect, 2 * count)
        for time, fact, value in given:
            if time in (2 * count, 2 * count + 1):
                known = known.after(((fact, value),), time)
        after = {fact: _settled(known, fact, value) for fact, value in state.items()}
        moments.append(Moment(step, tuple(item for item in after.items() if item[1] != state[item[0]])))
        state = after
    return Counterexample(start, tuple(moments), stops_at)


def given_run(trace: Trace, number: int) -> tuple[tuple[int, Fact, Value], ...]:
    """Return the run of an exact decision, else the assumptions up to an obligation, as (time, fact, value).

    The time is that from which the fact was unknown; 0 for the start.
    """
    if trace.counterexample is not None:
        return trace.counterexample
    return tuple(
        (unknown_since(trace, assumption), assumption.condition.fact, satisfying_value(assumption.condition))
        for assumption in trace.assumptions
        if assumption.obligation <= number and assumption.condition is not None
    )


def unknown_since(trace: Trace, assumption: Assumption) -> int:
    """Return the time of the step that left open an assumed fact; 0 when it was unknown from the start."""
    if assumption.about_start or assumption.condition is None:
        return START
    written = trace.history(assumption.condition.fact)
    return max((entry.time for entry in written if entry.time < assumption.time), default=START)


def _settled(known: State, fact: Fact, otherwise: Value) -> Value:
    value = known.value(fact)
    return otherwise if value is None else value
