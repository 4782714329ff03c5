"""A folder of notes: read once, added to, never left; a file that is no sound note is left out, and said."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from bddl.files import write_atomically
from llm.errors import LlmError
from llm.memory.learning import Foreseen, Lesson, foresee, lessons
from llm.memory.note import LONGEST_FILE, MOST_EVIDENCE, Note, NoteError, note_text, read_note
from llm.memory.recall import Recalled, circumstances, recall
from oag import Attempt, History, Scene, Task

MOST_NOTES = 2_000


class MemoryFolderError(LlmError, OSError):
    """A folder of notes cannot be read or written."""

    def __init__(self, folder: Path, reason: str) -> None:
        super().__init__(f"the memory {folder} cannot be used: {reason}")


class SkillMemory:
    """The notes of a folder.

    Attributes:
        folder: Where they are.
        problems: What was left out, and why, a line each.
    """

    def __init__(self, folder: Path) -> None:
        """Reads the notes; the folder is made when absent.

        Only plain files of the folder itself that end in `.md` are looked at: no link, no folder inside.

        Raises:
            MemoryFolderError: The folder cannot be made or read.
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
        """Returns the notes that speak of something like a failed attempt, the most similar first."""
        return recall(self.notes, circumstances(task, subtask, scene, attempt))

    def foresee(self, task: Task, scene: Scene) -> Foreseen:
        """Returns a task with the proven corrections that the notes hold for its flows."""
        return foresee(self.notes, task, scene)

    def learn(
        self, task: Task, scene: Scene, histories: Iterable[History], foreseen: Foreseen | None = None
    ) -> tuple[str, ...]:
        """Writes down what evolutions of a task's subtasks have taught, and returns the names of the notes touched.

        A correction that is known gets the new evidence; so does one that was put in or tried from memory and failed.

        Args:
            task: The task as it was run at first.
            scene: Where it was run.
            histories: What was tried for its subtasks.
            foreseen: What was put in before it ran, if anything was.

        Raises:
            MemoryFolderError: A note cannot be written.
        """
        told = list(histories)
        found = [lesson for history in told for lesson in lessons(task, scene, history)]
        if foreseen is not None:
            found += foreseen.lessons(told)
        return tuple(dict.fromkeys(name for lesson in found for name in self._take(lesson)))

    def _take(self, lesson: Lesson) -> list[str]:
        name = lesson.about if lesson.note is None else lesson.note.name
        known = self._notes.get(name) or lesson.note
        if known is None:
            return []
        # The same episode counts once, and the latest entries are kept.
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
        # Else the same correction could stand in two files, and its evidence be counted twice.
        raise NoteError(f"its content belongs into {note.name}.md")
    return note
