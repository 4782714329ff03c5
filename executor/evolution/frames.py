"""Pictures of failed attempts, for judges that look and for the report: drawn on demand.

At most six a step and view, from the recorded states of the attempt. A folder keeps them under the hash of these
states, so that a recorded evolution replays on a machine that cannot draw, with the very pictures that the model saw.
"""

from __future__ import annotations

import io
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from types import TracebackType

import numpy as np
from PIL import Image

from bddl.files import write_atomically
from executor.evolution.record import Evolution
from executor.machine import vulkan
from executor.pictures.cameras import VIEWS
from executor.pictures.frames import Picture, key_samples
from executor.pictures.render import DEFAULT_SIZE, RenderFailed, RenderPool
from executor.records.rollout import SubtaskRecord, Trajectory
from llm.errors import PicturesMissing
from llm.evolution import AttemptSeen
from oag import Attempt, Scene, Task

MOST_BYTES = 150_000
"""What an encoded picture may have; models take more, but pay for it in time and tokens."""

_QUALITIES = (88, 75, 60, 40)
"""Of JPEG, tried in turn: from what shows no blocks to what still shows the hand."""

FOLDER = "frames"
"""Where a run's folder has the pictures of its attempts."""

Key = tuple[int, int]
"""A subtask's index and an attempt's, both from 0."""


class AttemptFrames(AbstractContextManager["AttemptFrames"]):
    """Draws attempts, with worker processes that are started by the first one and kept; a context manager.

    Args:
        views: Which cameras.
        folder: Where pictures are kept and looked for; None keeps none.
        recorded: Where they are looked for first, such as beside a recording; nothing is written there.

    Raises:
        ValueError: A view is unknown.
    """

    def __init__(
        self,
        views: Sequence[str] = VIEWS,
        *,
        folder: Path | None = None,
        recorded: Path | None = None,
    ) -> None:
        unknown = [view for view in views if view not in VIEWS]
        if unknown:
            raise ValueError(f"there is no view {unknown[0]!r}; the views are {', '.join(VIEWS)}")
        self.views = tuple(views)
        self.folder, self.recorded = folder, recorded
        self._pool: RenderPool | None = None

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._pool is not None:
            self._pool.close()

    def attach(self, seen: AttemptSeen, record: SubtaskRecord, trajectory: Trajectory, scene: Scene) -> AttemptSeen:
        """Returns an attempt whose steps have their pictures; they are drawn when somebody looks at one."""
        samples = [key_samples(trajectory, step) for step in record.steps]
        states = [[trajectory.packed_states[index] for index in indices] for indices in samples]
        drawing = _Drawing(self, record.state_hash, scene, seen.task, states)
        steps = tuple(replace(step, frames=_StepFrames(drawing, number)) for number, step in enumerate(seen.steps))
        return replace(seen, steps=steps)

    def draw(self, scene: Scene, task: Task, states: Sequence[bytes]) -> dict[str, list[bytes]]:
        """Returns view -> encoded pictures of some packed states; the overview shows what the task is about.

        Raises:
            PicturesMissing: Nothing on this machine can draw, or drawing failed.
        """
        try:
            self._pool = self._pool or RenderPool()
            with tempfile.TemporaryDirectory(prefix="scene2demo-") as scratch:
                drawn = self._pool.draw(Path(scratch), scene, task, states, views=self.views, size=DEFAULT_SIZE)
                return {view: [encoded(picture) for picture in pictures] for view, pictures in drawn.items()}
        except (vulkan.RendererNotFound, RenderFailed) as problem:
            raise PicturesMissing(str(problem)) from problem


class _Drawing:
    """The pictures of one attempt, drawn all together at the first look."""

    def __init__(
        self, source: AttemptFrames, state_hash: str, scene: Scene, task: Task, states: list[list[bytes]]
    ) -> None:
        self.views = source.views
        self._source, self._scene, self._task, self._states = source, scene, task, states
        self._name = state_hash[:16]  # Equal states look alike: their hash says which pictures are whose.

    @cached_property
    def steps(self) -> list[dict[str, tuple[bytes, ...]]]:
        """View -> pictures, of each step."""
        return self._read(self._source.recorded) or self._read(self._source.folder) or self._draw()

    def _draw(self) -> list[dict[str, tuple[bytes, ...]]]:
        flat = [state for states in self._states for state in states]
        drawn = self._source.draw(self._scene, self._task, flat) if flat else {view: [] for view in self.views}
        pictures, first = [], 0
        for states in self._states:
            last = first + len(states)
            pictures.append({view: tuple(drawn[view][first:last]) for view in self.views})
            first = last
        data = (picture for step in pictures for view in self.views for picture in step[view])
        for path, picture in zip(self._paths(self._source.folder), data, strict=False):
            write_atomically(path, picture)
        return pictures

    def _read(self, folder: Path | None) -> list[dict[str, tuple[bytes, ...]]] | None:
        """Returns the pictures that a folder keeps, or None unless all of them are there."""
        paths = tuple(self._paths(folder))
        if not paths or not all(path.is_file() for path in paths):
            return None
        data = iter([path.read_bytes() for path in paths])
        return [{view: tuple(next(data) for _ in states) for view in self.views} for states in self._states]

    def _paths(self, folder: Path | None) -> Iterator[Path]:
        """Yields where each picture is kept: step by step, view by view."""
        if folder is None:
            return
        for number, states in enumerate(self._states, start=1):
            for view in self.views:
                for count in range(1, len(states) + 1):
                    yield folder / self._name / f"step_{number:02}_{view}_{count}.jpg"


class _StepFrames(Mapping[str, tuple[bytes, ...]]):
    """View -> pictures of one step; looking at one draws them."""

    def __init__(self, drawing: _Drawing, number: int) -> None:
        self._drawing, self._number = drawing, number

    def __getitem__(self, view: str) -> tuple[bytes, ...]:
        if view not in self._drawing.views:
            raise KeyError(view)
        return self._drawing.steps[self._number][view]

    def __iter__(self) -> Iterator[str]:
        return iter(self._drawing.views)

    def __len__(self) -> int:
        return len(self._drawing.views)


def encoded(picture: Picture, most_bytes: int = MOST_BYTES) -> bytes:
    """Returns an (H, W, 3) uint8 picture as JPEG of at most so many bytes, if need be coarser or smaller."""
    image = Image.fromarray(np.asarray(picture))
    while True:
        for quality in _QUALITIES:
            buffer = io.BytesIO()
            image.save(buffer, "JPEG", quality=quality, subsampling=0)
            if buffer.tell() <= most_bytes or max(image.size) == 1:
                return buffer.getvalue()
        image = image.reduce(2)


@dataclass(frozen=True, slots=True)
class AttemptPictures:
    """The pictures of an episode's attempts.

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
        for number, ((attempt, _), seen) in enumerate(zip(story.history.iterations, story.sights, strict=True)):
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


def _written(folder: Path, key: Key, step: int, pictures: Mapping[str, tuple[bytes, ...]]) -> list[str]:
    """Writes an attempt's pictures and returns their names, relative to the run's folder."""
    names = []
    for view, images in pictures.items():
        for count, data in enumerate(images, start=1):
            name = f"{FOLDER}/T{key[0] + 1}_attempt{key[1] + 1}_step{step + 1}_{view}_{count}.jpg"
            write_atomically(folder / name, data)
            names.append(name)
    return names
