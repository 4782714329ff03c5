"""Which notes speak of something similar: points for what they share with a failure, each of them told.

No embedding, no index: a memory has hundreds of notes, and a person can reckon every score.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass

import bddl
from llm.evolution.cause import CauseKind, diagnose
from llm.memory.note import Kind, Note
from oag import Attempt, Primitive, Scene, Task
from oag.model.categories import kind_of

ENOUGH = 5.0
"""The least score with which a note is recalled, such as that of the same cause at the same primitive."""

HOPELESS = 0.34
"""A note whose rate has sunk below this, since it failed when it was tried, is not recalled."""

# The cause counts most: what helped against another one would waste an attempt.
_CAUSE, _PRIMITIVE, _KIND, _TARGET, _TYPE, _SUPPORT = 3.0, 2.0, 2.0, 2.0, 0.5, 1.0


@dataclass(frozen=True, slots=True)
class Circumstances:
    """What a failure is compared by.

    Attributes:
        cause: Root cause in a few words; empty where it is not known.
        primitive: What was done where it lies; None where that is not known.
        kind: What the subtask is about.
        target: Category of its target.
        support: Category of where the target is taken from or put; empty for none.
    """

    cause: str
    primitive: Primitive | None
    kind: Kind
    target: str
    support: str = ""


@dataclass(frozen=True, slots=True)
class Recalled:
    """A note that was found.

    Attributes:
        note: The note.
        score: Its points.
        why: What it shares with the failure, with the points.
    """

    note: Note
    score: float
    why: tuple[str, ...]

    def __str__(self) -> str:
        return f"{self.note.name}: {self.score:g} points ({', '.join(self.why)}), helped {self.note.rate:.0%}"


def circumstances(task: Task, subtask: int, scene: Scene, attempt: Attempt) -> Circumstances:
    """Returns what a failed attempt is compared by, from its critiques and its subtask."""
    cause = diagnose(attempt)
    kind, target, support = about(task, subtask, scene)
    return Circumstances(
        cause="" if cause is None else cause.kind.value,
        primitive=None if cause is None else attempt.flow[cause.step].primitive,
        kind=kind,
        target=target,
        support=support,
    )


def about(task: Task, subtask: int, scene: Scene) -> tuple[Kind, str, str]:
    """Returns what a subtask is about: its kind, and the categories of its target and of its support."""
    roles = task.subtasks[subtask]
    place = roles.support_goal or roles.support_init
    known = scene.objects
    return (
        _kind(roles.goal),
        known[roles.target].category if roles.target in known else roles.target,
        known[place].category if place is not None and place in known else "",
    )


def recall(notes: Iterable[Note], of: Circumstances, most: int = 5) -> tuple[Recalled, ...]:
    """Returns the notes that are similar enough, the most similar first; among equals what helped more often.

    Args:
        notes: All there are.
        of: What failed.
        most: How many at most.
    """
    # What helped against another cause would waste an attempt, however alike the rest is.
    related = [note for note in notes if note.rate >= HOPELESS and (not of.cause or _alike(note.cause, of.cause) > 0)]
    enough = [one for one in (_compared(note, of) for note in related) if one.score >= ENOUGH]
    enough.sort(key=lambda one: (-one.score, -one.note.rate, -one.note.successes, one.note.name))
    return tuple(enough[:most])


def _compared(note: Note, of: Circumstances) -> Recalled:
    points: list[tuple[float, str]] = []
    alike = _alike(note.cause, of.cause)
    if alike > 0:
        points.append((round(_CAUSE * alike, 2), "cause" if alike == 1 else "words of the cause"))
    if note.primitive is of.primitive:
        points.append((_PRIMITIVE, note.primitive.name))
    if note.kind == of.kind:
        points.append((_KIND, f"to {note.kind}"))
    if note.target == of.target:
        points.append((_TARGET, note.target))
    elif kind_of(note.target, 0.0) is kind_of(of.target, 0.0):
        points.append((_TYPE, "targets of one type"))
    if note.support and note.support == of.support:
        points.append((_SUPPORT, note.support))
    return Recalled(note, sum(value for value, _ in points), tuple(f"{words} {value:g}" for value, words in points))


def _alike(one: str, other: str) -> float:
    """Returns how much two causes are alike, from 0 to 1: measured ones are the same or not, others share words."""
    if one in _MEASURED and other in _MEASURED:
        return float(one == other)
    first, second = (set(re.findall(r"[a-z]+", text.lower())) - _SMALL for text in (one, other))
    return len(first & second) / len(first | second) if first | second else 0.0


_MEASURED = frozenset(kind.value for kind in CauseKind)
_SMALL = frozenset({"the", "a", "an", "is", "was", "in", "of", "to", "it", "its", "not", "no"})


def _kind(goal: bddl.Formula) -> Kind:
    for literal in bddl.literals(goal) or ():
        if literal.atom.predicate == "open":
            return "open" if literal.value else "close"
        if literal.atom.predicate in ("inside", "ontop"):
            return "place" if literal.value else "pick"
    return "other"
