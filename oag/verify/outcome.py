"""What a report has of a plan besides: the state at a boundary between subtasks, and what is missing."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import bddl
from bddl.terminal import pluralize
from oag.model.codec import brief
from oag.model.reading import formula_of
from oag.model.symbols import ANY, GRIPPER, held_by
from oag.primitives.state import State, truth_of
from oag.primitives.table import needed


class Missing(NamedTuple):
    """Something that a plan needs where it does not hold.

    Attributes:
        place: Where, such as `T3.4` or `the task goal`.
        literal: What is needed, in words, such as `open(refrigerator_0)`.
        known_false: True when it is false there, False when it is unknown.
    """

    place: str
    literal: str
    known_false: bool

    def __repr__(self) -> str:
        return brief(f"<Missing at {self.place}: {self.literal} is {'false' if self.known_false else 'unknown'}>")


class PlanState:
    """What is known at one moment of a plan: facts, and an answer for every formula."""

    def __init__(self, state: State, objects: Mapping[str, str], subtasks: int) -> None:
        self._state, self._objects, self._subtasks = state, objects, subtasks

    def __repr__(self) -> str:
        return brief(f"<PlanState after {pluralize(self._subtasks, 'subtask')}: {' '.join(self.facts) or 'nothing'}>")

    @property
    def facts(self) -> tuple[str, ...]:
        """The atoms that are known to be true, what the hand holds included, sorted."""
        true = [fact for fact, _ in self._state.entries() if ANY not in fact and self._state.value(fact) is True]
        item = held_by(self._state.hand)
        held = [] if item is None else [("inside", item, GRIPPER)]
        return tuple(sorted(bddl.format(bddl.Atom(fact[0], fact[1:])) for fact in (*true, *held)))

    def holds(self, condition: bddl.Formula | str) -> bool | None:
        """Decide a formula, quantifiers included; None when what is known does not.

        Raises:
            TaskError: The text is no formula.
        """
        return truth_of(needed(formula_of(condition, "condition")), self._state.value, self._objects)
