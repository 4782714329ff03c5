"""Knowledge restricted to a fixed set of facts, as one hashable value, so that searches can remember where they were.

Source: docs/semantics.md, Flows that are searched.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping

import bddl
from oag.model.facts import HAND, ROBOT_FACTS, Fact, Value, condition_of, generalisations, made_true
from oag.model.primitives import Parameter, Primitive
from oag.progression.compiled import CompiledSubtask
from oag.table.library import Clause, Effect, Needed

# What each fact of a window is known to be, in the window's order.
State = tuple[Value, ...]


class Window:
    """The facts that matter to a search, and how primitives change what is known of them.

    Attributes:
        facts: What a state tells of, in order; the robot's three variables come first.
        objects: Category of each object of the scene.
    """

    def __init__(self, facts: Iterable[Fact], objects: Mapping[str, str]) -> None:
        """Opens a window.

        Args:
            facts: The facts beside the robot's.
            objects: Category of each object of the scene, for quantifiers.
        """
        self.facts = tuple(dict.fromkeys((*ROBOT_FACTS, *facts)))
        self.objects = objects
        self._position = {fact: index for index, fact in enumerate(self.facts)}
        self._writes: dict[Effect, tuple[tuple[int, Value], ...]] = {}
        self._hand = self._position[HAND]

    def state(self, read: Callable[[Fact], Value]) -> State:
        """Returns what a reader of facts knows of this window."""
        return tuple(read(fact) for fact in self.facts)

    def value(self, state: State, fact: Fact) -> Value:
        """Returns what a state tells of a fact; None for one outside of the window."""
        position = self._position.get(fact)
        return None if position is None else state[position]

    def truth(self, state: State, wanted: Needed) -> bool | None:
        """Decides clauses or a formula in a state: None when what is known does not."""
        if not isinstance(wanted, tuple):
            return bddl.evaluate(wanted, lambda atom: self._atom(state, atom), objects=self.objects)
        result: bool | None = True
        for clause in wanted:
            truth = self._clause(state, clause)
            if truth is False:
                return False
            if truth is None:
                result = None
        return result

    def open_parts(self, state: State, wanted: Needed) -> int:
        """Returns how many clauses, or conjuncts of a formula, a state leaves open."""
        if isinstance(wanted, tuple):
            return sum(self._clause(state, clause) is None for clause in wanted)
        return sum(self.truth(state, part) is None for part in bddl.conjuncts(wanted))

    def after(self, state: State, written: Effect) -> State:
        """Returns the state after an effect; of a fact and the patterns that cover it the most specific counts."""
        writes = self._writes.get(written)
        if writes is None:
            writes = self._writes[written] = self._resolve(dict(written))
        changed = list(state)
        for position, value in writes:
            changed[position] = value
        return tuple(changed)

    def step(
        self, state: State, primitive: Primitive, subtask: CompiledSubtask, parameter: Parameter = None
    ) -> tuple[bool | None, State]:
        """Returns whether a primitive may run, and what is known after it if it does.

        Nothing is assumed: of an unknown precondition the state afterwards still knows nothing, so that it describes
        every state in which the primitive could run.
        """
        clauses, written = subtask.rows.row(primitive, state[self._hand], parameter)
        truth = self.truth(state, clauses) if clauses else True
        if truth is False:
            return False, state
        return truth, self.after(state, written)

    def forced(
        self, state: State, primitive: Primitive, subtask: CompiledSubtask, parameter: Parameter = None
    ) -> State:
        """Returns what is known after a primitive, as if everything that it needs had held."""
        granted = self.granted(state, subtask.rows.row(primitive, state[self._hand])[0])
        return self.after(granted, subtask.rows.row(primitive, granted[self._hand], parameter)[1])

    def granted(self, state: State, wanted: Needed) -> State:
        """Returns the state in which clauses that were unknown or false hold; formulas change nothing."""
        if not isinstance(wanted, tuple):
            return state
        changed = list(state)
        for clause in wanted:
            if self._clause(state, clause) is True:
                continue
            unknown = [c for c in clause if c.grade(self.value(state, c.fact)) is None]
            condition = unknown[0] if unknown else clause[-1]
            position = self._position.get(condition.fact)
            if position is not None:
                changed[position] = made_true(condition)
        return tuple(changed)

    def _clause(self, state: State, clause: Clause) -> bool | None:
        """Decides one clause."""
        unknown = False
        for condition in clause:
            grade = condition.grade(self.value(state, condition.fact))
            if grade:
                return True
            unknown = unknown or grade is None
        return None if unknown else False

    def _atom(self, state: State, atom: bddl.Atom) -> bool | None:
        """Decides an atom."""
        condition = condition_of(atom, True)
        return condition.grade(self.value(state, condition.fact))

    def _resolve(self, written: dict[Fact, Value]) -> tuple[tuple[int, Value], ...]:
        """Returns what an effect with patterns writes to each fact of the window."""
        writes: list[tuple[int, Value]] = []
        for position, fact in enumerate(self.facts):
            for pattern in generalisations(fact):
                if pattern in written:
                    writes.append((position, written[pattern]))
                    break
        return tuple(writes)


def facts_of(wanted: Needed, objects: Mapping[str, str]) -> tuple[Fact, ...]:
    """Returns the facts that clauses or a formula can read."""
    if isinstance(wanted, tuple):
        return tuple(condition.fact for clause in wanted for condition in clause)
    read: dict[Fact, None] = {}

    def note(atom: bddl.Atom) -> None:
        read[condition_of(atom, True).fact] = None

    # With nothing known, evaluation has to visit every atom.
    bddl.evaluate(wanted, note, objects=objects)
    return tuple(read)


def facts_read(subtasks: Iterable[CompiledSubtask], goal: Needed, objects: Mapping[str, str]) -> tuple[Fact, ...]:
    """Returns every world fact that the conditions and primitives of some subtasks, or a task goal, can read."""
    facts: dict[Fact, None] = {}
    for subtask in subtasks:
        context = subtask.context
        facts.update(dict.fromkeys((*facts_of(subtask.init, objects), *facts_of(subtask.goal, objects))))
        for fixture in context.articulated:
            facts.setdefault(("open", fixture))
            if context.target_is_item:
                facts.setdefault(("inside", context.target, fixture))
        if not context.target_is_item:
            facts.setdefault(("open", context.target))
    facts.update(dict.fromkeys(facts_of(goal, objects)))
    return tuple(facts)
