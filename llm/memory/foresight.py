"""Corrections put in before anything fails: a flow that failed in earlier episodes begins as what helped there.

Only a correction that is proven is put in, of exactly the same flow for the same kind of subtask, target and support.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace

from llm.memory.learning import Lesson, named
from llm.memory.note import Evidence, Note
from llm.memory.recall import about
from oag import History, Scene, Task, admissible

RELIABLE = 0.7
"""The rate that a correction needs: two of two episodes are enough, two of three are not."""


@dataclass(frozen=True, slots=True)
class Foreseen:
    """A task whose flows were changed by what is remembered.

    Attributes:
        task: The task to run.
        notes: Index of a subtask -> name of the note that its flow was changed by.
    """

    task: Task
    notes: Mapping[int, str]

    def lessons(self, histories: Iterable[History]) -> Iterator[Lesson]:
        """Yields how the notes fared: whether the changed flow reached its subtask's goal when it ran first."""
        for history in histories:
            name = self.notes.get(history.subtask)
            if name is not None and history.iterations:
                first = history.iterations[0].attempt
                yield Lesson(name, None, Evidence(named(self.task), first.seed, first.outcome, 0))


def foresee(notes: Iterable[Note], task: Task, scene: Scene) -> Foreseen:
    """Returns a task with the corrections that notes hold for its flows; the same task where they hold none.

    Args:
        notes: What is remembered.
        task: The task, with its flows.
        scene: Where it is to be run.
    """
    reliable = sorted(
        (note for note in notes if note.proven and note.rate >= RELIABLE),
        key=lambda note: (-note.rate, -note.successes, note.name),
    )
    used: dict[int, str] = {}
    for index, subtask in enumerate(task.subtasks):
        kind, target, support = about(task, index, scene)
        for note in reliable:
            same = (note.kind, note.target, note.support) == (kind, target, support)
            if not same or note.before != subtask.flow:
                continue
            admission = admissible(task, index, note.after, scene=scene, history=History(index))
            if admission and admission.report:
                changed = replace(subtask, flow=note.after)
                task = replace(task, subtasks=(*task.subtasks[:index], changed, *task.subtasks[index + 1 :]))
                used[index] = note.name
                break
    return Foreseen(task, used)
