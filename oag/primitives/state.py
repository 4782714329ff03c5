"""Knowledge at one moment of a plan: the start, and the one step from a state to the next.

The start is stated by the scene's facts, its closed predicates, and the robot's reset.

A state gives facts, and patterns of facts (`*`), a value with the time at which it was written. What was never written
is unknown (open world). Time counts in half steps: 0 is the start S_0, and step n of the flattened plan (from 1) writes
at 2n. What step n needs and is unknown is assumed at 2n - 1. A search does not need the writers. It sees a state
through a `Window` of the relevant facts, so that equal states can be recognised.

Source: docs/semantics.md, Knowledge; the progression is the 0-approximation of Son and Baral (Artificial
Intelligence, 2001).
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from typing import NamedTuple, TypeVar

import bddl
from oag.model.scene import Scene
from oag.model.symbols import (
    ANY,
    EEF,
    EMPTY,
    GRIPPER,
    HAND,
    HOME,
    NEAR,
    ROBOT_FACTS,
    Fact,
    Kind,
    Parameter,
    Primitive,
    Value,
    condition_of,
    generalisations,
    satisfying_value,
)
from oag.primitives.cargo import Carriage, carriage_of, circle, closed, denied, is_place
from oag.primitives.table import Clause, Effect, Needed, Rows, converse, impossible

RESET_REASONS = {
    NEAR: "the reset e_0 puts the robot at a fixed offset from the first target",
    EEF: "the reset e_0 brings the arm home",
    HAND: "the reset e_0 leaves the hand empty",
}


def reset_reason(fact: object) -> str:
    """Return why the reset supplies one of the robot's variables, as certificates state it."""
    return next(reason for known, reason in RESET_REASONS.items() if list(known) == fact)


Start = tuple[tuple[Fact, Value], ...]


def reset_facts(first_target: str | None, scene_hand: Value) -> dict[Fact, str]:
    """Return what the robot's reset supplies before the first subtask; a hand that the scene states is kept.

    Source: the paper starts the first flows without NAVIGATE_TO_TARGET ("we initialize the robot at a fixed offset
    distance"): the reset plays the part of a transfer e_0.
    """
    facts: dict[Fact, str] = {EEF: HOME}
    if scene_hand is None:
        facts[HAND] = EMPTY
    if first_target is not None:
        facts[NEAR] = first_target
    return facts


def scene_facts(scene: Scene) -> Start:
    """Return the statements of a scene: an entry for each closed predicate, then each literal with what it excludes.

    What is carried is inside whatever its carrier is inside, whether or not the scene says so. A carrier is not inside
    what its cargo is known not to be inside.
    """
    values: dict[Fact, Value] = {}
    for predicate in sorted(scene.closed):
        arity = scene.domain.predicates[predicate].arity
        values[(predicate, *(ANY,) * arity)] = False
    for formula in scene.facts:
        for literal in bddl.literals(formula) or ():
            condition = condition_of(literal.atom, literal.value)
            if condition.positive:
                values[condition.fact] = condition.value
                other = converse(condition.fact)
                if other is not None and (other[0], ANY, ANY) not in values:
                    values.setdefault(other, False)
            elif condition.fact != HAND:
                values[condition.fact] = False
    resting = {fact for fact, value in values.items() if value is True and is_place(fact)}
    for fact in sorted(closed(resting) - resting):
        values.setdefault(fact, True)
    values |= dict.fromkeys(sorted(denied(resting, values)), False)
    return tuple(values.items())


def carriage_in(scene: Scene, items: Collection[str], stated: Start, placed: Iterable[Fact]) -> Carriage:
    """Return who may carry whom in a scene with these items and statements, when goals place things by these facts."""
    return carriage_of(scene.objects, items, _never(scene) | dict(stated), placed)


def contradictions(literals: tuple[bddl.Literal, ...]) -> str | None:
    """Decide whether a conjunction of literals breaks an invariant: None when it does not, else how.

    Source: docs/semantics.md, States: `inside` and `ontop` are irreflexive and antisymmetric, at most one thing is
    held. `inside` and `ontop` may hold at once (an apple in an open bowl), so that is no contradiction.
    """
    if len(literals) == 1 and len(set(literals[0].atom.args)) == len(literals[0].atom.args):
        return None
    values: dict[bddl.Atom, bool] = {}
    related: set[tuple[str, str, str]] = set()
    held: str | None = None
    for literal in literals:
        atom = literal.atom
        if values.setdefault(atom, literal.value) is not literal.value:
            return f"{bddl.format(atom)} is said to hold and not to hold"
        if not literal.value or atom.predicate not in ("ontop", "inside") or len(atom.args) != 2:
            continue
        first, second = atom.args
        if first == second:
            return f"nothing can be {atom.predicate} itself: {bddl.format(atom)}"
        if (atom.predicate, second, first) in related:
            return f"{bddl.format(atom)} excludes its converse"
        if atom.predicate == "inside" and second == GRIPPER:
            if held not in (None, first):
                return f"the gripper holds one thing at a time, not {held} and {first}"
            held = first
            continue
        related.add((atom.predicate, first, second))
    if len(related) < 2:
        return None
    ring = circle(sorted(related))
    if ring:
        return f"things carry each other in a circle: {', '.join(map(_text, ring))}"
    for fact in sorted(closed(related) - related):
        if values.get(bddl.Atom(fact[0], fact[1:])) is False:
            return f"{_text(fact)} is denied, and follows from what carries {fact[1]}"
    return None


def _text(fact: Fact) -> str:
    return f"({' '.join(fact)})"


START = 0
# Producer of a fact that nothing ever wrote.
NEVER = -1
# Each step copies the recent writes: this many take less than a microsecond, and merging them is rare.
_MOST_RECENT = 60

Reader = Callable[[Fact], Value]
_Known = TypeVar("_Known", "State", "View")


class Entry(NamedTuple):
    """A value and the time at which it was written."""

    value: Value
    time: int


UNWRITTEN = Entry(None, NEVER)
# Facts and patterns with their values and times.
_Writes = dict[Fact, tuple[Value, int]]
_NOTHING: _Writes = {}


def _latest(writes: _Writes, fact: Fact) -> tuple[Value, int]:
    best: tuple[Value, int] = UNWRITTEN
    for pattern in generalisations(fact):
        written = writes.get(pattern)
        if written is not None and written[1] > best[1]:
            best = written
    return best


class State:
    """Knowledge at one moment; immutable, unless it is `own`ed and written to."""

    __slots__ = ("_older", "_recent")

    def __init__(self, older: _Writes = _NOTHING, recent: _Writes = _NOTHING) -> None:
        # What is written goes on top of what is older, so that a step does not copy what is known of a large scene.
        self._older = older
        self._recent = recent

    def read(self, fact: Fact) -> Entry:
        """Return the last write that covers a fact; of writes at one time the most specific one counts."""
        return Entry(*self.last(fact))

    def value(self, fact: Fact) -> Value:
        """Return what a fact is known to be; None when that is unknown."""
        return self.last(fact)[0]

    def last(self, fact: Fact) -> tuple[Value, int]:
        """Return what `read` does as a plain pair, for places that ask it of every step."""
        # The robot's variables, of which most is asked, have no patterns.
        if len(fact) == 1:
            return self._recent.get(fact) or self._older.get(fact, UNWRITTEN)
        # All that is recent was written after all that is older.
        best = _latest(self._recent, fact)
        return _latest(self._older, fact) if best is UNWRITTEN and self._older else best

    @property
    def hand(self) -> Value:
        """What the hand does."""
        return (self._recent.get(HAND) or self._older.get(HAND, UNWRITTEN))[0]

    def holds(self, atom: bddl.Atom) -> bool | None:
        """Return whether a BDDL atom holds, None when unknown."""
        condition = condition_of(atom, True)
        return condition.grade(self.value(condition.fact))

    def after(self, effect: Effect, time: int = START) -> State:
        """Return the state once facts, and patterns of facts, have got values at a time."""
        recent = self._recent.copy()
        for fact, value in effect:
            recent[fact] = (value, time)
        return State(self._older | recent) if len(recent) > _MOST_RECENT else State(self._older, recent)

    def own(self) -> State:
        """Return an equal state that nobody else has, to be written to."""
        return State(recent=self._older | self._recent)

    def write(self, effect: Effect, time: int) -> None:
        """Give facts, and patterns of facts, values at a time, in a state that nobody else has."""
        for fact, value in effect:
            self._recent[fact] = (value, time)

    def entries(self) -> Iterator[tuple[Fact, Entry]]:
        """Yield every fact or pattern with its last write, in the order in which they were first written."""
        yield from ((fact, Entry(*written)) for fact, written in (self._older | self._recent).items())


def start_state(scene: Scene, first_target: str | None, stated: Start | None = None) -> State:
    """Return what is known at S_0: by the reset, by kinds of objects, and by the scene, which contradicts neither.

    `stated` has the statements of the scene, where they are known already.
    """
    stated = scene_facts(scene) if stated is None else stated
    reset = reset_facts(first_target, dict(stated).get(HAND))
    return State().after((*reset.items(), *_never(scene).items(), *stated), START)


def _never(scene: Scene) -> dict[Fact, Value]:
    """Return what the kinds of things exclude, unless closed predicates do."""
    if scene.closed.issuperset(("open", "inside")):
        return {}
    joints = {key for key, thing in scene.objects.items() if thing.kind is Kind.ARTICULATED}
    return dict.fromkeys(impossible(scene.categories, joints), False)


class Window:
    """The facts that matter to a search.

    Attributes:
        facts: In order; the robot's three variables come first.
        objects: Category of each object of the scene, which quantifiers range over.
    """

    def __init__(self, facts: Iterable[Fact], objects: Mapping[str, str]) -> None:
        self.facts = tuple(dict.fromkeys((*ROBOT_FACTS, *facts)))
        self.objects = objects
        self._writes: dict[Effect, dict[Fact, Value]] = {}

    def view(self, state: State) -> View:
        """Return the part of a state with these facts."""
        return View(self, {fact: state.value(fact) for fact in self.facts})

    def writes(self, effect: Effect) -> dict[Fact, Value]:
        """Return the writes of an effect with patterns to these facts; the most specific one counts."""
        found = self._writes.get(effect)
        if found is None:
            written = dict(effect)
            covering = ((fact, [p for p in generalisations(fact) if p in written]) for fact in self.facts)
            found = self._writes[effect] = {fact: written[patterns[0]] for fact, patterns in covering if patterns}
        return found


class View:
    """A state seen through a window, equal to any other with the same values; immutable.

    Attributes:
        window: Its facts.
        values: Known values of the window's facts, in order.
    """

    __slots__ = ("_known", "values", "window")

    def __init__(self, window: Window, known: dict[Fact, Value]) -> None:
        self.window, self._known = window, known
        self.values = tuple(known.values())

    def __eq__(self, other: object) -> bool:
        return isinstance(other, View) and self.values == other.values

    def __hash__(self) -> int:
        return hash(self.values)

    def value(self, fact: Fact) -> Value:
        """Return what a fact is known to be; None when that is unknown, or out of the window."""
        return self._known.get(fact)

    @property
    def hand(self) -> Value:
        """What the hand does."""
        return self._known[HAND]

    def after(self, effect: Effect, _time: int = START) -> View:
        """Return the view once facts, and patterns of facts, have got values, whichever step wrote them."""
        return View(self.window, {**self._known, **self.window.writes(effect)})

    def truth(self, wanted: Needed) -> bool | None:
        """Decide clauses or a formula; None when what is known does not."""
        return truth_of(wanted, self.value, self.window.objects)


def step(
    state: _Known,
    rows: Rows,
    primitive: Primitive,
    parameter: Parameter = None,
    time: int = START,
    sure: Reader | None = None,
) -> tuple[Effect, _Known]:
    """Return what a primitive writes in a state, and the state after it.

    Nothing is assumed: where its needs are unknown, the result describes every state in which it could run. Whether it
    can is for the caller to decide. `sure` reads what holds without any assumption, by which cargo is recognised; by
    default the state.
    """
    written = rows.written(primitive, state.hand, parameter, sure or state.value)
    return written, state.after(written, time)


def assume_true(state: _Known, wanted: Needed, time: int = START) -> _Known:
    """Return the state in which unknown or false clauses are made true at a time; formulas change nothing."""
    if not isinstance(wanted, tuple):
        return state
    made: dict[Fact, Value] = {}
    for clause in wanted:
        grades = [condition.grade(state.value(condition.fact)) for condition in clause]
        if True not in grades:
            # The last alternative is the one that a step can bring about.
            condition = clause[grades.index(None) if None in grades else -1]
            made[condition.fact] = satisfying_value(condition)
    return state.after(tuple(made.items()), time) if made else state


def truth_of(wanted: Needed, read: Reader, objects: Mapping[str, str]) -> bool | None:
    """Decide clauses or a formula for a reader of facts; None when what is known does not."""
    if not isinstance(wanted, tuple):

        def known(atom: bddl.Atom) -> bool | None:
            condition = condition_of(atom, True)
            return condition.grade(read(condition.fact))

        return bddl.evaluate(wanted, known, objects)
    result: bool | None = True
    for clause in wanted:
        truth = _truth_of_clause(clause, read)
        if truth is False:
            return False
        result = truth and result
    return result


def _truth_of_clause(clause: Clause, read: Reader) -> bool | None:
    unknown = False
    for condition in clause:
        grade = condition.grade(read(condition.fact))
        if grade:
            return True
        unknown = unknown or grade is None
    return None if unknown else False


def facts_of(wanted: Needed, objects: Mapping[str, str]) -> tuple[Fact, ...]:
    """Return the facts that clauses or a formula can read."""
    read: dict[Fact, None] = {}
    # With nothing known, every one of them is looked at.
    truth_of(wanted, lambda fact: read.setdefault(fact), objects)
    return tuple(read)
