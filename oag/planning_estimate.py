"""The estimate that guides the search for plans: how many subtasks a goal takes at least, from a state.

It adds up what single literals need: a door that is to move, a thing that is to be picked up and put, the door in front
of it, and a hand that has to be free for it. What one primitive of an own domain may do at once is not added.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Sequence
from math import ceil

import bddl
from oag.model.domain import ROBOT_WORDS, Domain, Row
from oag.model.symbols import GRIPPER, HAND, Condition, Fact, held_by
from oag.primitives.cargo import RESTING
from oag.primitives.state import View
from oag.primitives.table import Context


class Estimate:
    """The estimate for several ways to meet one goal: the least of them counts.

    Args:
        goals: Literals of each way.
        context: What can be open, and who may carry whom; None where nothing can be done.
        domain: Its own primitives may write what the 21 write as well.
    """

    def __init__(self, goals: Sequence[tuple[Condition, ...]], context: Context | None, domain: Domain) -> None:
        self._goals, self._written = goals, domain.written
        handling = [row for row in domain.rows.values() if any(map(_is_handled, row.writes))]
        self._rows_handle, self._rows_only_put = bool(handling), all(map(_only_puts, handling))
        self._articulated = () if context is None else context.articulated
        self._carriers: dict[str, list[Fact]] = {}
        if context is not None:
            names = {name for name, _ in context.carriage.riders}
            for thing, places in context.carriage.places:
                self._carriers[thing] = [(relation, thing, place) for relation, place in places if place in names]

    def of(self, state: View) -> int:
        """Return the number of subtasks that the goal takes from a state; 0 where a way is met."""
        return min(self._subtasks(state, goal) for goal in self._goals)

    def _subtasks(self, state: View, goal: tuple[Condition, ...]) -> int:
        held = held_by(state.hand)
        unmet = [each for each in goal if each.grade(state.value(each.fact)) is not True]
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
        others = self._others(unmet)
        if not self._rows_only_put:
            return max(min(total, 1), others)
        if held is not None and held not in put and total:
            total += 1
        return max(total, others) if self._rows_handle else total + others

    def _others(self, unmet: Sequence[Condition]) -> int:
        """Return how many primitives of an own domain are needed at least for what the 21 do not change."""
        counts = Counter(fact[0] for fact, _, _ in unmet if fact != HAND and fact[0] not in ("open", *RESTING))
        return max((max(1, ceil(n / self._written.get(key, 1))) for key, n in counts.items()), default=0)

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
