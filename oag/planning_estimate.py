"""The estimate that guides the search for plans: how many subtasks a goal takes at least, from a state.

It adds up what single literals need: a door that is to move, a thing that is to be picked up and put, the door in front
of it, and a hand that has to be free for it.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence

from oag.model.symbols import HAND, Condition, Fact, held_by
from oag.primitives.cargo import RESTING
from oag.primitives.state import View
from oag.primitives.table import Context


class Estimate:
    """The estimate for several ways to meet one goal: the least of them counts.

    Args:
        goals: Literals of each way.
        context: What can be open, and who may carry whom.
    """

    def __init__(self, goals: Sequence[tuple[Condition, ...]], context: Context | None = None) -> None:
        self._goals = goals
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
        moved: dict[str, bool] = {}
        put: dict[str, int] = {}
        ends: dict[str, bool] = {}
        behind: set[str] = set()
        redo = others = 0
        for condition in goal:
            fact, value, positive = condition
            if fact[0] == "open":
                ends[fact[1]] = positive is value
            if condition.grade(state.value(fact)) is True:
                continue
            if fact[0] == "open":
                moved[fact[1]] = True
            elif fact == HAND:
                item = held_by(value)
                if item is not None:
                    put.setdefault(item, 0)
                    put[item] += not positive
            elif fact[0] in RESTING:
                # Being inside something may come from what carries a thing, and go with it.
                item = self._carrier(state, fact[1]) if fact[0] == "inside" else fact[1]
                put.setdefault(item, 0)
                if positive:
                    # One release brings a thing into all that its place is in.
                    put[item] = max(1, put[item])
                    if fact[0] == "inside" and fact[2] in self._articulated:
                        behind.add(fact[2])
                        # The hand has to put down what it holds, open the door, and pick it up again.
                        redo = 2 if item == held and self._shut(state, (fact[2],)) else redo
            else:
                # By a primitive of an own domain.
                others += 1
        shut = self._shut(state, behind)
        left_in_hand = 0
        taken_from: set[str] = set()
        for item, places in put.items():
            if item == held:
                continue
            sources = [f for f in self._articulated if state.value(("inside", item, f)) is True]
            taken_from.update(sources)
            if not places:
                left_in_hand += 1
                # The door is to be closed with a free hand.
                left_in_hand += any(ends.get(source) is False for source in sources)
        shut |= self._shut(state, taken_from)
        doors = sum(1 + (ends.get(door) is False) for door in shut if door not in moved) + len(moved)
        picks = sum(item != held for item in put)
        total = doors + picks + sum(put.values()) + redo + others + max(0, left_in_hand - 1)
        if held is not None and held not in put and total:
            total += 1
        return total

    def _carrier(self, state: View, name: str) -> str:
        """Return the lowest thing that carries one, or the thing itself."""
        for fact in self._carriers.get(name, ()):
            if state.value(fact) is True:
                return self._carrier(state, fact[2])
        return name

    @staticmethod
    def _shut(state: View, doors: Collection[str]) -> set[str]:
        return {door for door in doors if state.value(("open", door)) is not True}
