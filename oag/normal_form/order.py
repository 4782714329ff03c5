"""The order of a plan's independent parts: the Foata normal form of the trace that the plan is a word of.

The letters are the parts between places where the hand is empty and the next step navigates: there the robot's pose
is of no account, so two parts that do not touch each other's facts can be exchanged.

Source: docs/canonical.md, Order; Cartier and Foata, Problemes combinatoires de commutation et rearrangements (1969).
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, field

from oag.model.facts import EMPTY, HAND, Fact
from oag.normal_form.movements import Movement
from oag.task.task import SimpleTask

# Where a thing is in the room; whoever touches it depends on who last moved it.
_WHERE = "where"


@dataclass
class _Part:
    """Movements that stay together, with what they read and write.

    Attributes:
        subtasks: The movements as subtasks, in order.
        fixed: True when nothing may be exchanged with it: something is in the hand before it.
        reads: Facts that they read.
        writes: Facts of which they change what is known.
        blurs: Facts that they leave unknown; to do so twice is no conflict.
    """

    fixed: bool
    subtasks: list[SimpleTask] = field(default_factory=list)
    reads: set[Fact] = field(default_factory=set)
    writes: set[Fact] = field(default_factory=set)
    blurs: set[Fact] = field(default_factory=set)

    def add(self, movement: Movement) -> None:
        """Adds a movement at the end."""
        subtask = movement.written()
        self.subtasks.append(subtask)
        self.reads |= movement.reads
        self.reads |= {(_WHERE, name) for name in (subtask.support_init, subtask.support_goal) if name is not None}
        (self.writes if movement.carries else self.reads).add((_WHERE, subtask.target))
        for fact, value in movement.after.items():
            if fact != HAND:
                (self.blurs if value is None else self.writes).add(fact)

    def depends_on(self, other: _Part) -> bool:
        """Decides whether the order of two parts matters: one writes what the other reads or writes."""
        return self.fixed or other.fixed or self._disturbs(other) or other._disturbs(self)

    def _disturbs(self, other: _Part) -> bool:
        read = not (self.writes.isdisjoint(other.reads) and self.blurs.isdisjoint(other.reads))
        return read or not (self.writes.isdisjoint(other.writes) and self.blurs.isdisjoint(other.writes))


def ordered(movements: Sequence[Movement]) -> tuple[SimpleTask, ...]:
    """Returns movements as subtasks, independent parts in their canonical order.

    A part stands on the level of the longest chain of dependent parts that ends with it; a level is sorted by its text.
    """
    parts: list[_Part] = []
    for movement in movements:
        if not parts or movement.begins_part:
            parts.append(_Part(fixed=movement.before[HAND] != EMPTY))
        parts[-1].add(movement)
    levels: list[int] = []
    for index, part in enumerate(parts):
        earlier = zip(parts[:index], levels, strict=True)
        levels.append(max((level + 1 for other, level in earlier if part.depends_on(other)), default=0))
    texts = (json.dumps(list(map(content, part.subtasks)), sort_keys=True) for part in parts)
    keyed = sorted(zip(levels, texts, range(len(parts)), strict=True))
    return tuple(subtask for _, _, index in keyed for subtask in parts[index].subtasks)


def content(subtask: SimpleTask) -> dict[str, object]:
    """Returns a subtask without its name and description, as JSON values."""
    unnamed = ("task_activity_name", "task_detail_message")
    return {key: value for key, value in subtask.to_json().items() if key not in unnamed}
