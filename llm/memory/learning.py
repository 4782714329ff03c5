"""What an evolution teaches: the correction that solved it, and how corrections from memory fared."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace

from llm.evolution.telling import one_line
from llm.memory.note import LONGEST_LESSON, Note, Trial
from llm.memory.recall import about, circumstances
from oag import Attempt, History, Iteration, Scene, Task, admissible


@dataclass(frozen=True, slots=True)
class Lesson:
    """One thing to write down.

    Attributes:
        about: Name of the note that it is about.
        note: The note as it would be if it were new; None where only an old one is meant.
        evidence: What happened.
    """

    about: str
    note: Note | None
    evidence: Trial


def lessons(task: Task, scene: Scene, history: History) -> Iterator[Lesson]:
    """Yields what one subtask's evolution teaches.

    The correction that is noted is the change from the first flow to the last one, whatever detours lay between. Where
    a note led there at once, its evidence grows and nothing new is noted.

    Args:
        task: The task as it was at first.
        scene: Where it was run.
        history: What was tried for one of its subtasks.
    """
    iterations = _from_one_start(history)
    attempts = [attempt for attempt, _ in iterations]
    pairs = enumerate(zip(iterations, attempts[1:], strict=False), start=1)
    used = [
        (number, revision.note, following)
        for number, ((_, revision), following) in pairs
        if revision is not None and revision.note
    ]
    for number, name, following in used:
        yield Lesson(name, None, _trial(task, following, number))
    if not history.solved or len(attempts) < 2 or (len(attempts) == 2 and used):
        return
    first, last = attempts[0], attempts[-1]
    if first.flow == last.flow or not first.flow:
        return
    note = _note(task, scene, history.subtask, iterations)
    if note is not None:
        yield Lesson(note.name, note, _trial(task, last, len(iterations) - 1))


def _from_one_start(history: History) -> tuple[Iteration, ...]:
    """Returns what was tried from the start that the last attempt began from.

    Attempts before the loop went back to an earlier subtask failed for what was wrong there: their cause has nothing to
    do with what was changed here.
    """
    if not history.iterations:
        return ()
    start = history.iterations[-1].attempt.start
    return tuple(entry for entry in history.iterations if entry.attempt.start == start)


def _note(task: Task, scene: Scene, subtask: int, iterations: tuple[Iteration, ...]) -> Note | None:
    first, last = iterations[0].attempt, iterations[-1].attempt
    revision = iterations[0].revision
    known = circumstances(task, subtask, scene, first)
    step = revision.cause_step if revision is not None else None
    primitive = known.primitive
    if primitive is None and step is not None and step < len(first.flow):
        primitive = first.flow[step].primitive
    cause = known.cause or (revision.cause if revision is not None else "")
    target = one_line(known.target, 120)
    if primitive is None or not cause or not target:
        return None
    reasons = [made.explanation for _, made in iterations if made is not None]
    return Note(
        cause=one_line(cause, 120),
        primitive=primitive,
        kind=known.kind,
        target=target,
        support=one_line(known.support, 120),
        before=first.flow,
        after=last.flow,
        lesson=one_line(reasons[-1], LONGEST_LESSON) if reasons else "",
    )


def _trial(task: Task, attempt: Attempt, revisions: int) -> Trial:
    named = one_line(task.name, 120) or "task"
    return Trial(task=named, seed=attempt.seed, outcome=attempt.outcome, revisions=revisions)


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
                yield Lesson(name, None, _trial(self.task, first, 0))


def foresee(notes: Iterable[Note], task: Task, scene: Scene) -> Foreseen:
    """Returns a task with the corrections that notes hold for its flows; the same task where they hold none.

    Only a correction that is proven is put in, of exactly the same flow for the same kind of subtask, target and
    support.

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
