"""The estimate that guides the search for plans: how many subtasks a goal takes at least, from a state.

It adds up what single literals need: a door that is to move, a thing that is to be picked up and put, the door in front
of it, and a hand that has to be free for it. What all rows of an own domain need that bring a literal about has to hold
at some time, so it counts as well. What one row may do at once is not added.

Source: Hoffmann, Porteous and Sebastia, Ordered Landmarks in Planning (JAIR 2004), for such needs.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterable, Sequence, Set
from math import ceil

import bddl
from oag.model.domain import ROBOT_WORDS, Bound, Domain, Row, bound, own_of
from oag.model.symbols import (
    ARTICULATIONS,
    GRIPPER,
    HAND,
    ROBOT_FACTS,
    Condition,
    Fact,
    Primitive,
    held_by,
    overlap,
)
from oag.primitives.cargo import RESTING
from oag.primitives.state import View
from oag.primitives.table import Context
from oag.task_definition import SimpleTask

_WORKING = frozenset((*ARTICULATIONS, Primitive.GRASP, Primitive.UNGRASP))


class Estimate:
    """The estimate for several ways to meet one goal: the least of them counts.

    Args:
        goals: Literals of each way.
        context: What can be open, and who may carry whom; None where nothing can be done.
        domain: Its own primitives may write what the 21 write as well.
        subtasks: All subtasks that there are; () where others may be used, so that nothing follows from their rows.
    """

    def __init__(
        self,
        goals: Sequence[tuple[Condition, ...]],
        context: Context | None,
        domain: Domain,
        subtasks: Iterable[SimpleTask] = (),
    ) -> None:
        self._goals, self._written, self._rows = goals, domain.written, _rows_of(subtasks)
        handling = [row for row in domain.rows.values() if any(map(_is_handled, row.writes))]
        self._rows_handle, self._rows_only_put = bool(handling), all(map(_only_puts, handling))
        self._reached: dict[Condition, tuple[Set[int], list[Condition]]] = {}
        # Where rows move doors or the hand, no other subtask may be needed for it.
        self._writes = {fact for row in self._rows for fact, _ in row.writes}
        self._rows_move = any(fact == HAND or fact[0] == "open" for fact in self._writes)
        self._articulated = () if context is None else context.articulated
        self._carriers: dict[str, list[Fact]] = {}
        self._cargo: set[str] = set()
        if context is not None:
            self._cargo.update(*((name, *things) for name, things in context.carriage.riders))
            names = {name for name, _ in context.carriage.riders}
            for thing, places in context.carriage.places:
                self._carriers[thing] = [(relation, thing, place) for relation, place in places if place in names]

    def of(self, state: View) -> int:
        """Return the number of subtasks that the goal takes from a state; 0 where a way is met."""
        return min(self._subtasks(state, goal) for goal in self._goals)

    def _subtasks(self, state: View, goal: tuple[Condition, ...]) -> int:
        held = held_by(state.hand)
        unmet, others = self._ahead(state, _unmet(state, goal))
        put, shut, redo = self._put(state, unmet)
        moved = {fact[1] for fact, _, _ in unmet if fact[0] == "open"}
        closed = {fact[1] for fact, value, positive in goal if fact[0] == "open" and positive is not value}
        left_in_hand = put_down = 0
        for item, is_placed in put.items():
            if item == held:
                continue
            sources = [f for f in self._articulated if state.value(("inside", item, f)) is True]
            shut |= self._shut(state, sources)
            if not is_placed:
                # A door is to be closed with a free hand.
                to_close = not closed.isdisjoint(sources)
                put_down += to_close
                left_in_hand += not to_close
        doors = len(moved) + sum(1 + (door in closed) for door in shut - moved)
        picks = sum(item != held for item in put)
        total = doors + picks + sum(put.values()) + redo + put_down + max(0, left_in_hand - 1)
        if not self._rows_only_put:
            return max(min(total, 1), others)
        if held is not None and held not in put and total and (self._rows_handle or not others):
            total += 1
        return max(total, others) if self._rows_handle else total + others

    def _ahead(self, state: View, unmet: list[Condition]) -> tuple[list[Condition], int]:
        """Return what has to hold at some time, and how many primitives of an own domain it takes at least."""
        counts, used, apart = Counter[str](), set[int](), 0
        # What is needed needs something as well.
        for condition in unmet:
            if _is_own(condition.fact):
                counts[condition.fact[0]] += 1
                rows, needs = self._reach(condition)
                if rows and used.isdisjoint(rows):
                    used, apart = used | rows, apart + 1
                unmet += [each for each in _unmet(state, needs) if each not in unmet]
        return unmet, max([apart, *(max(1, ceil(n / self._written.get(key, 1))) for key, n in counts.items())])

    def _reach(self, condition: Condition) -> tuple[Set[int], list[Condition]]:
        """Return which rows bring a condition about, and what all of them need that counts."""
        if condition not in self._reached:
            found = {
                number: row.needs
                for number, row in enumerate(self._rows)
                if any(condition.grade(value) and overlap(fact, condition.fact) for fact, value in row.writes)
            }
            needs = [n for n in next(iter(found.values()), ()) if len(n) == 1 and all(n in c for c in found.values())]
            self._reached[condition] = found.keys(), [need for (need,) in needs if self._is_counted(need)]
        return self._reached[condition]

    def _is_counted(self, need: Condition) -> bool:
        fact, value, positive = need
        if _is_own(fact) or self._rows_move:
            return _is_own(fact)
        item = held_by(value) if fact == HAND else fact[1] if fact[0] in RESTING else None
        # What carries something, or is carried, may be taken and put together with that; a row may put things as well.
        alone = item not in (None, *self._cargo) and not any(overlap(fact, each) for each in self._writes)
        return fact[0] == "open" or (alone and positive is (value is not False))

    def _put(self, state: View, unmet: Sequence[Condition]) -> tuple[dict[str, bool], set[str], int]:
        """Return what has to be taken, and whether to be put; the shut doors of its places; what a full hand adds."""
        # What leaves a place, or gets into one, by its carrier need not be taken itself.
        own = {held_by(value) if fact == HAND else fact[1] for fact, value, _ in unmet if fact[0] in ("hand", "ontop")}
        put: dict[str, bool] = {}
        behind: set[str] = set()
        redo = 0
        for fact, value, positive in unmet:
            item = held_by(value) if fact == HAND else fact[1] if fact[0] in RESTING else None
            if item is None:
                continue
            if fact == HAND:
                # Not to hold it is to put it.
                put[item] = put.get(item, False) or not positive
                continue
            if fact[0] == "inside" and item not in own:
                item = self._carrier(state, item)
            # One release brings a thing into all that its place is in.
            put[item] = put.get(item, False) or positive
            if positive and fact[0] == "inside" and fact[2] in self._articulated:
                shut = self._shut(state, (fact[2],))
                behind |= shut
                # The hand has to put down what it holds, open the door, and pick it up again.
                redo = 2 if shut and item == held_by(state.hand) else redo
        return put, behind, redo

    def _carrier(self, state: View, name: str) -> str:
        """Return the lowest thing that carries one, or the thing itself."""
        for fact in self._carriers.get(name, ()):
            if state.value(fact) is True:
                return self._carrier(state, fact[2])
        return name

    @staticmethod
    def _shut(state: View, doors: Collection[str]) -> set[str]:
        return {door for door in doors if state.value(("open", door)) is not True}


def _unmet(state: View, conditions: Iterable[Condition]) -> list[Condition]:
    return [each for each in conditions if each.grade(state.value(each.fact)) is not True]


def _is_own(fact: Fact) -> bool:
    return fact not in ROBOT_FACTS and fact[0] not in ("open", *RESTING)


def _rows_of(subtasks: Iterable[SimpleTask]) -> list[Bound]:
    """Return the rows of an own domain in subtasks; none where a subtask does more than one row."""
    rows: list[Bound] = []
    for subtask in subtasks:
        flow = [action.primitive for action in subtask.flow or ()]
        owns = [own for own in map(own_of, flow) if own is not None]
        if owns and (len(owns) > 1 or not _WORKING.isdisjoint(flow)):
            return []
        rows += [bound(own, subtask.target, subtask.support_goal) for own in owns]
    return rows


def _is_handled(literal: bddl.Literal) -> bool:
    """Decide whether the 21 change an atom as well: a door, where a thing is, or the hand."""
    predicate = literal.atom.predicate
    return predicate in ("open", *RESTING) or (predicate in ROBOT_WORDS and ROBOT_WORDS[predicate][1] == HAND)


def _only_puts(row: Row) -> bool:
    """Decide whether a row does no more than to put what is held onto something, one subtask of the 21 as well."""
    needed = (literal for need in row.needs for literal in bddl.literals(need) or () if literal.value)
    held = {each.atom.args[0] for each in needed if each.atom.predicate == "inside" and each.atom.args[1] == GRIPPER}
    return all(
        predicate in ROBOT_WORDS or (atom.args[0] in held and not (value and predicate == "inside"))
        for atom, value in filter(_is_handled, row.writes)
        for predicate in (atom.predicate,)
    )
