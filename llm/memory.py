"""Skill memory: corrections that worked, stored as readable notes and tried again when a similar failure occurs.

`SkillMemory` reads and extends a folder of notes; a file that is no valid note is skipped and reported.
`RememberingSupervisor` tries what helped before, and asks another supervisor when no note yields an admissible
flow.

Source: the paper's future work. A note is data: it is validated when it is read, and a flow that it proposes has
to be admissible like any other.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from difflib import SequenceMatcher
from pathlib import Path

from bddl.files import write_atomically
from llm.errors import LlmError
from llm.evolve.observation import GiveUp, Situation, Supervisor, one_line
from llm.memory_notes import (
    LONGEST_FILE,
    LONGEST_LESSON,
    MOST_EVIDENCE,
    Note,
    NoteError,
    Recalled,
    Trial,
    about,
    circumstances,
    note_text,
    read_note,
    recall,
)
from oag import Action, Scene, Task
from oag.model.actions import ActionFlow
from oag.model.symbols import ARTICULATIONS, Parameter
from oag.revision import Attempt, History, Iteration, Revision, admissible, change_between


@dataclass(frozen=True, slots=True)
class Lesson:
    """One result to store: the note if it were new, or None if only the existing one of that name is meant."""

    about: str
    note: Note | None
    evidence: Trial


def lessons(task: Task, scene: Scene, history: History) -> Iterator[Lesson]:
    """Yield the lessons of one subtask's evolution.

    The noted correction is the change from the first flow to the last one, without the detours between them. If a
    note led there at once, its evidence grows and no new note is made.
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
    """Return the iterations with the same start as the last attempt.

    Attempts before the loop returned to an earlier subtask failed because of that subtask: their cause is unrelated
    to what was changed here.
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
"""Least rate of an applied correction: two of two episodes are enough, two of three are not."""


@dataclass(frozen=True, slots=True)
class Foreseen:
    """A task whose flows were changed by notes; of each changed subtask the name of its note."""

    task: Task
    notes: Mapping[int, str]

    def lessons(self, histories: Iterable[History]) -> Iterator[Lesson]:
        """Yield the results of the notes: whether the changed flow reached its subtask's goal at its first run."""
        for history in histories:
            name = self.notes.get(history.subtask)
            if name is not None and history.iterations:
                first = history.iterations[0].attempt
                yield Lesson(name, None, _trial(self.task, first, 0))


def foresee(notes: Iterable[Note], task: Task, scene: Scene) -> Foreseen:
    """Apply the proven corrections of notes to a task's flows; return the same task if none applies.

    A correction is applied only if it is proven, and only to exactly the same flow for the same kind of subtask,
    target and support.
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


MOST_NOTES = 2_000


class MemoryFolderError(LlmError, OSError):
    """A folder of notes cannot be read or written."""

    def __init__(self, folder: Path, reason: str) -> None:
        super().__init__(f"the memory {folder} cannot be used: {reason}")


class SkillMemory:
    """The notes of a folder.

    Attributes:
        folder: The folder.
        problems: Skipped files with the reason, a line each.
    """

    def __init__(self, folder: Path) -> None:
        """Read the notes; the folder is created if absent.

        Only plain `.md` files of the folder itself are read: no links, no subfolders.

        Raises:
            MemoryFolderError: The folder cannot be created or read.
        """
        self.folder = folder
        self._notes: dict[str, Note] = {}
        problems: list[str] = []
        try:
            folder.mkdir(parents=True, exist_ok=True)
            paths = sorted(path for path in folder.iterdir() if path.suffix == ".md")
        except OSError as error:
            raise MemoryFolderError(folder, error.strerror or str(error)) from error
        for path in paths:
            try:
                note = _read(path)
            except NoteError as problem:
                problems.append(f"{path.name}: {problem}")
                continue
            if len(self._notes) == MOST_NOTES:
                problems.append(f"{path.name}: there are more than {MOST_NOTES} notes")
                break
            self._notes[note.name] = note
        self.problems = tuple(problems)

    @property
    def notes(self) -> tuple[Note, ...]:
        """All notes, by their names."""
        return tuple(self._notes[name] for name in sorted(self._notes))

    def similar(self, task: Task, subtask: int, scene: Scene, attempt: Attempt) -> tuple[Recalled, ...]:
        """Return the notes that resemble a failed attempt, the most similar first."""
        return recall(self.notes, circumstances(task, subtask, scene, attempt))

    def foresee(self, task: Task, scene: Scene) -> Foreseen:
        """Return a task with the proven corrections of the notes applied to its flows."""
        return foresee(self.notes, task, scene)

    def learn(
        self, task: Task, scene: Scene, histories: Iterable[History], foreseen: Foreseen | None = None
    ) -> tuple[str, ...]:
        """Store what evolutions of a task's subtasks have shown, and return the names of the changed notes.

        A known correction gets the new evidence; so does one that was applied or tried from memory and failed.
        """
        recorded = list(histories)
        found = [lesson for history in recorded for lesson in lessons(task, scene, history)]
        if foreseen is not None:
            found += foreseen.lessons(recorded)
        return tuple(dict.fromkeys(name for lesson in found for name in self._take(lesson)))

    def _take(self, lesson: Lesson) -> list[str]:
        name = lesson.about
        known = self._notes.get(name) or lesson.note
        if known is None:
            return []
        # An episode counts once, and the latest entries are kept.
        new = lesson.evidence
        others = (entry for entry in known.evidence if (entry.task, entry.seed) != (new.task, new.seed))
        evidence = (*others, new)[-MOST_EVIDENCE:]
        if name in self._notes and evidence == known.evidence:
            return []
        self._notes[name] = note = known.model_copy(update={"evidence": evidence})
        try:
            # The name has letters, digits and dashes only.
            write_atomically(self.folder / f"{name}.md", note_text(note).encode())
        except OSError as error:
            raise MemoryFolderError(self.folder, error.strerror or str(error)) from error
        return [name]


def _read(path: Path) -> Note:
    if path.is_symlink() or not path.is_file():
        raise NoteError("it is no plain file")
    try:
        if path.stat().st_size > 4 * LONGEST_FILE:
            raise NoteError(f"it has {path.stat().st_size} bytes; a note has at most {LONGEST_FILE} characters")
        note = read_note(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError) as problem:
        raise NoteError(f"it cannot be read: {problem}") from None
    if note.name != path.stem:
        # Otherwise one correction could be in two files, and its evidence counted twice.
        raise NoteError(f"its content belongs into {note.name}.md")
    return note


@dataclass(frozen=True, slots=True)
class RememberingSupervisor:
    """Try the most similar note, then ask another supervisor; a flow from memory has to be admissible as well.

    A correction that helped in a single episode may be specific to it: it is tried only after an answer of the other
    supervisor has failed. One note is tried for each cause, so that an unhelpful memory costs one attempt at most.

    Attributes:
        memory: The notes.
        other: Supervisor to ask if no note helps.
    """

    memory: SkillMemory
    other: Supervisor

    def revise(self, situation: Situation) -> Revision | GiveUp:
        """Return the revision of a note, or the other supervisor's answer."""
        iterations = situation.history.iterations
        here = [revision for attempt, revision in iterations if attempt.start == situation.attempt.start]
        failed = {revision.cause for revision in here if revision is not None and revision.note}
        for found in self.memory.similar(situation.task, situation.subtask, situation.scene, situation.attempt):
            if found.note.cause in failed or not (found.note.proven or here):
                continue
            flow = self._flow(situation, found)
            if flow is not None:
                return _revision(situation, found, flow)
        return self.other.revise(situation)

    def _flow(self, situation: Situation, found: Recalled) -> ActionFlow | None:
        flow = transfer(found.note.before, found.note.after, situation.attempt.flow)
        if flow is None or flow == situation.attempt.flow:
            return None
        history = situation.history.add(situation.attempt)
        admission = admissible(situation.task, situation.subtask, flow, scene=situation.scene, history=history)
        return flow if admission and admission.report else None


def _revision(situation: Situation, found: Recalled, flow: ActionFlow) -> Revision:
    note = found.note
    step = next((c.step for c in situation.attempt.critiques if c.finds_fault), None)
    helped = f"it helped in {note.successes} of {len(note.evidence)} runs"
    return Revision(
        flow=flow,
        change=change_between(situation.attempt.flow, flow),
        explanation=f'From memory, note "{note.name}": {helped}, and shares {", ".join(found.why)}. {note.lesson}',
        cause=note.cause,
        cause_step=step,
        note=note.name,
    )


def notes_for(memory: SkillMemory, situation: Situation, most: int = 3) -> tuple[str, ...]:
    """Return the notes that resemble a situation, a line each, for a model's prompt."""
    found = memory.similar(situation.task, situation.subtask, situation.scene, situation.attempt)
    return tuple(one.note.line() for one in found[:most])


def transfer(before: ActionFlow, after: ActionFlow, flow: ActionFlow) -> ActionFlow | None:
    """Apply the change from `before` to `after` to a flow; return None if that is impossible.

    Flows are aligned by their primitives. There is no transfer if the flow lacks the steps that the change refers
    to.
    """
    places = _places(before, flow)
    changed: list[list[Action]] = [[action] for action in flow]
    ahead: list[list[Action]] = [[] for _ in range(len(flow) + 1)]
    for tag, low, high, new_low, new_high in _matcher(before, after).get_opcodes():
        new = list(after[new_low:new_high])
        if tag == "equal":
            for old, now in zip(range(low, high), new, strict=True):
                if now.parameter != before[old].parameter:
                    if old not in places:
                        return None
                    changed[places[old]] = [_renumbered(before[old], now, flow[places[old]])]
            continue
        removed = [places.get(old) for old in range(low, high)]
        if any(place is None for place in removed):
            return None
        where = _anchor(places, low, high, len(before), len(flow))
        if where is None:
            return None
        for place in removed:
            changed[place if place is not None else 0] = []
        ahead[where] += new
    result = [action for index in range(len(flow)) for action in (*ahead[index], *changed[index])]
    return (*result, *ahead[len(flow)])


def _matcher(one: ActionFlow, other: ActionFlow) -> SequenceMatcher[int]:
    first, second = ([int(action.primitive) for action in flow] for flow in (one, other))
    return SequenceMatcher(None, first, second, autojunk=False)


def _places(before: ActionFlow, flow: ActionFlow) -> dict[int, int]:
    """Map indices of the earlier flow to indices of the current flow, for the steps that both have."""
    blocks = _matcher(before, flow).get_matching_blocks()
    return {block.a + k: block.b + k for block in blocks for k in range(block.size)}


def _anchor(places: dict[int, int], low: int, high: int, length: int, now: int) -> int | None:
    if low in places:
        return places[low]
    if low > 0 and low - 1 in places:
        return places[low - 1] + 1
    if high < length and high in places:
        return places[high]
    return now if low == length == 0 else None


def _renumbered(then: Action, became: Action, now: Action) -> Action:
    """Apply the earlier change of a number to an action.

    Limits of a joint and opened numbers are copied. A distance is changed by the same amount, so that a flow with
    another distance is not reset to the earlier one.
    """
    before, after, number = then.parameter, became.parameter, now.parameter
    shifted: Parameter = after
    if isinstance(before, float | int) and isinstance(after, float | int) and isinstance(number, float | int):
        moved = round(number + after - before, 3)
        shifted = moved if moved > 0 and now.primitive not in ARTICULATIONS else after
    return replace(now, parameter=shifted)
