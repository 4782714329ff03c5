"""The order of a plan's independent parts: the Foata normal form of the trace that the plan is a word of.

The letters are the parts between places where the hand is empty and the next step navigates: there the robot's pose
is of no account, so two parts that do not touch each other's facts can be exchanged.

Source: docs/canonical.md, Order; Cartier and Foata, Problemes combinatoires de commutation et rearrangements (1969).
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

from oag.model.facts import ANY, HAND, Fact, Value, overlap
from oag.model.primitives import Primitive
from oag.normal_form.survey import Place
from oag.normal_form.work import covers
from oag.task.task import SimpleTask

# Where a thing is in the room; whoever touches it depends on who last moved it.
_WHERE = "where"


@dataclass(frozen=True, slots=True)
class Part:
    """Subtasks that stay together, with what they read and write.

    Attributes:
        subtasks: In order.
        reads: Facts and patterns that they read before writing them.
        writes: Fact or pattern -> value.
        fixed: True when nothing may be exchanged with it.
    """

    subtasks: tuple[SimpleTask, ...]
    reads: frozenset[Fact]
    writes: dict[Fact, Value]
    fixed: bool


def ordered(places: Sequence[Place]) -> tuple[SimpleTask, ...]:
    """Returns the subtasks with independent parts in their canonical order."""
    parts = parts_of(places)
    levels = foata_levels(parts)
    keyed = sorted(zip(levels, map(_text, parts), range(len(parts)), strict=True))
    return tuple(subtask for _, _, index in keyed for subtask in parts[index].subtasks)


def parts_of(places: Sequence[Place]) -> tuple[Part, ...]:
    """Returns the letters of a plan."""
    starts = [i for i, place in enumerate(places) if i == 0 or place.begins_part]
    ends = [*starts[1:], len(places)] if starts else []
    return tuple(_part(places[start:end]) for start, end in zip(starts, ends, strict=True))


def dependent(first: Part, second: Part) -> bool:
    """Decides whether the order of two parts matters: one writes what the other reads or writes."""
    if first.fixed or second.fixed:
        return True
    return any(
        overlap(fact, other)
        for one, another in ((first, second), (second, first))
        for fact, value in one.writes.items()
        for other in (*another.reads, *(w for w, v in another.writes.items() if v is not None or value is not None))
    )


def foata_levels(parts: Sequence[Part]) -> list[int]:
    """Returns for each part the length of the longest chain of dependent parts that ends with it."""
    known = _Levels()
    levels = []
    everything = lowest = 0
    for part in parts:
        level = everything if part.fixed else max(lowest, known.above(part))
        if part.fixed:
            lowest = level + 1
        everything = max(everything, level + 1)
        known.note(part, level)
        levels.append(level)
    return levels


class _Levels:
    """The highest levels at which facts were read and written so far."""

    def __init__(self) -> None:
        # (predicate, first argument) -> fact -> [level of a read, of a write of "unknown", of any other write].
        self._known: dict[tuple[str, str], dict[Fact, list[int]]] = {}

    def above(self, part: Part) -> int:
        """Returns the lowest level that is above everything that the part depends on."""
        level = -1
        for fact in part.reads:
            for found in self._overlapping(fact):
                level = max(level, found[1], found[2])
        for fact, value in part.writes.items():
            for found in self._overlapping(fact):
                level = max(level, found[0], found[2], -1 if value is None else found[1])
        return level + 1

    def note(self, part: Part, level: int) -> None:
        """Remembers what a part at a level reads and writes."""
        for fact in part.reads:
            self._raise(fact, 0, level)
        for fact, value in part.writes.items():
            self._raise(fact, 1 if value is None else 2, level)

    def _raise(self, fact: Fact, column: int, level: int) -> None:
        row = self._known.setdefault((fact[0], fact[1] if len(fact) > 1 else ""), {}).setdefault(fact, [-1, -1, -1])
        row[column] = max(row[column], level)

    def _overlapping(self, fact: Fact) -> Iterator[list[int]]:
        first = fact[1] if len(fact) > 1 else ""
        buckets: Iterable[tuple[str, str]] = ((fact[0], first), (fact[0], ANY))
        if first == ANY:
            buckets = [key for key in self._known if key[0] == fact[0]]
        for key in buckets:
            for known, row in self._known.get(key, {}).items():
                if overlap(known, fact):
                    yield row


def _part(places: Sequence[Place]) -> Part:
    """Returns the part that some subtasks form."""
    reads: set[Fact] = {HAND}
    writes: dict[Fact, Value] = {}
    for place in places:
        reads.update(fact for fact in place.reads if not any(covers(written, fact) for written in writes))
        subtask = place.subtask
        names = (subtask.support_init, subtask.support_goal, None if place.context.target_is_item else subtask.target)
        reads.update((_WHERE, name) for name in names if name is not None)
        if place.work is not None:
            writes.update({fact: value for fact, value in place.work.writes.items() if fact != HAND})
        if any(action.primitive is Primitive.GRASP for action in place.flow or ()) and place.context.target_is_item:
            writes[(_WHERE, subtask.target)] = True
    last = places[-1]
    after = None if last.work is None else last.hand if last.work.hand == last.work.needs else last.work.hand
    if after != places[0].hand:
        writes[HAND] = after
    fixed = not places[0].afresh or any(place.flow is None for place in places)
    return Part(tuple(place.subtask for place in places), frozenset(reads), writes, fixed)


def _text(part: Part) -> str:
    """Returns a part as text, names and descriptions left out, to sort by."""
    return json.dumps([content(subtask) for subtask in part.subtasks], sort_keys=True)


def content(subtask: SimpleTask) -> dict[str, object]:
    """Returns a subtask without its name and description, as JSON values."""
    unnamed = ("task_activity_name", "task_detail_message")
    return {key: value for key, value in subtask.to_json().items() if key not in unnamed}
