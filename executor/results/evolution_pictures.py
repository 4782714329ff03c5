"""The pictures that stand for an attempt: those of the step that failed, or of the last one where none did."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from bddl.files import write_atomically
from executor.evolution.record import Evolution
from llm.errors import PicturesMissing
from oag import Attempt

FOLDER = "frames"
Key = tuple[int, int]
"""A subtask's index and an attempt's, both from 0."""


@dataclass(frozen=True, slots=True)
class AttemptPictures:
    """What was drawn of an episode's attempts.

    Attributes:
        drawn: (Subtask, attempt) -> view -> JPEG pictures in the order of time.
        files: (Subtask, attempt) -> the files that they were written to, relative to the run's folder.
        problem: Why there are none; empty when there are.
    """

    drawn: Mapping[Key, Mapping[str, tuple[bytes, ...]]] = field(default_factory=dict)
    files: Mapping[Key, list[str]] = field(default_factory=dict)
    problem: str = ""


def shown_step(attempt: Attempt) -> int:
    """Returns the step of an attempt that a picture of it should show: the one at fault, or the last one."""
    if attempt.failed_step is not None:
        return attempt.failed_step
    at_fault = [critique.step for critique in attempt.critiques if critique.finds_fault]
    return at_fault[0] if at_fault else max((critique.step for critique in attempt.critiques), default=0)


def draw_attempts(evolution: Evolution, folder: Path | None = None) -> AttemptPictures:
    """Returns pictures of every attempt at the subtasks that needed more than one, and writes them where asked.

    Args:
        evolution: An episode whose loop was given something that draws.
        folder: The run's folder; None writes nothing.
    """
    drawn: dict[Key, Mapping[str, tuple[bytes, ...]]] = {}
    files: dict[Key, list[str]] = {}
    for story in evolution.stories:
        if len(story.records) == 1 and story.solved:
            continue
        for number, (attempt, seen) in enumerate(zip(_attempts(story.history.iterations), story.sights, strict=True)):
            step = shown_step(attempt)
            if step >= len(seen.steps) or not seen.steps[step].frames:
                continue
            key = (story.history.subtask, number)
            try:
                drawn[key] = {view: tuple(pictures) for view, pictures in seen.steps[step].frames.items()}
            except PicturesMissing as missing:
                return AttemptPictures(drawn, files, str(missing))
            if folder is not None:
                files[key] = _written(folder, key, step, drawn[key])
    return AttemptPictures(drawn, files, "" if drawn else "nothing was asked to draw them")


def _attempts(iterations: tuple[tuple[Attempt, object], ...]) -> list[Attempt]:
    return [attempt for attempt, _ in iterations]


def _written(folder: Path, key: Key, step: int, pictures: Mapping[str, tuple[bytes, ...]]) -> list[str]:
    """Writes an attempt's pictures and returns their names, relative to the run's folder."""
    names = []
    for view, images in pictures.items():
        for count, data in enumerate(images, start=1):
            name = f"{FOLDER}/T{key[0] + 1}_attempt{key[1] + 1}_step{step + 1}_{view}_{count}.jpg"
            write_atomically(folder / name, data)
            names.append(name)
    return names
