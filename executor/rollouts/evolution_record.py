"""Record of a self-evolution: attempts at every subtask, their outcome, and pictures of failed attempts.

Pictures are for judges that look at them and for the report. They are drawn on demand from recorded states, at most
six a step and view. A folder keeps them under the hash of these states, so that a recorded evolution replays on a
machine that cannot draw, with the very pictures that the model got.
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
from bddl.terminal import pluralize
from executor.records import Rollout, SubtaskRecord, Trajectory
from executor.sim.faults import Fault
from executor.sim.render.cameras import VIEWS
from executor.sim.render.frames import DEFAULT_SIZE, Picture, RenderFailed, RenderPool, key_samples
from executor.system import vulkan
from llm.errors import PicturesMissing
from llm.evolve import AttemptObservation, GiveUp
from oag import Scene, Task
from oag.revision import Attempt, History


@dataclass(frozen=True, slots=True)
class SubtaskStory:
    """One subtask's evolution.

    Attributes:
        history: Attempts with their critiques, and the revisions between them.
        records: The record of each attempt, in the same order.
        gave_up: Why there was no further revision; None when the last attempt succeeded.
        observations: Observation of each attempt, in the same order, with pictures where they can be drawn.
    """

    history: History
    records: tuple[SubtaskRecord, ...]
    gave_up: GiveUp | None = None
    observations: tuple[AttemptObservation, ...] = ()

    @property
    def solved(self) -> bool:
        """True when the last attempt reached the subtask's goal, and nothing before it was changed since then."""
        return self.history.solved and self.history.iterations[-1].revision is None

    @property
    def revisions(self) -> int:
        """How often the subtask's flow was revised."""
        return len(self.history.revisions)


@dataclass(frozen=True, slots=True)
class Evolution:
    """One episode with self-evolution.

    Attributes:
        original: The task before anything was revised.
        rollout: The episode as it counts in the end: the last attempt of every subtask, its task with the revised
            flows. A plain rollout of that task with the same scene and seed gives the same states.
        stories: One for each subtask that was begun.
        faults: Deliberate faults.
    """

    original: Task
    rollout: Rollout
    stories: tuple[SubtaskStory, ...]
    faults: tuple[Fault, ...] = ()

    def __repr__(self) -> str:
        return f"<Evolution of {self.rollout!r}: {pluralize(self.revisions, 'revision')}>"

    @property
    def succeeded(self) -> bool:
        """True when every subtask and the task goal were reached in the end."""
        return self.rollout.succeeded

    @property
    def succeeded_at_once(self) -> bool:
        """True when they were reached without any revision."""
        return self.succeeded and self.revisions == 0

    @property
    def revisions(self) -> int:
        """How many revisions were made, over all subtasks."""
        return sum(story.revisions for story in self.stories)

    @property
    def evolved(self) -> Task:
        """The task with the flows that were run last, open numbers left open."""
        flows = {story.history.subtask: story.history.iterations[-1].attempt.flow for story in self.stories}
        subtasks = tuple(
            replace(subtask, flow=flows.get(index, subtask.flow))
            for index, subtask in enumerate(self.original.subtasks)
        )
        return replace(self.original, subtasks=subtasks)


class EvolutionInterrupted(KeyboardInterrupt):
    """Ctrl-C during an evolution; `partial` is what had been done."""

    def __init__(self, partial: Evolution) -> None:
        super().__init__("the evolution was interrupted")
        self.partial = partial


MOST_BYTES = 150_000
"""Size of an encoded picture; models accept more, at a cost in time and tokens."""

_QUALITIES = (88, 75, 60, 40)
"""Of JPEG, tried in turn: from what shows no blocks to what still shows the hand."""

FOLDER = "frames"
"""Where a run's folder has the pictures of its attempts."""

Key = tuple[int, int]
"""A subtask's index and an attempt's, both from 0."""


class AttemptFrames(AbstractContextManager["AttemptFrames"]):
    """Renderer of attempts, whose worker processes start with the first one and are kept; a context manager.

    Args:
        folder: Where pictures are written and searched; None writes none.
        recorded: Where they are searched first, such as next to a recording; nothing is written there.

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

    def attach(
        self, observation: AttemptObservation, record: SubtaskRecord, trajectory: Trajectory, scene: Scene
    ) -> AttemptObservation:
        """Return an observation whose steps have pictures; they are drawn on first access."""
        samples = [key_samples(trajectory, step) for step in record.steps]
        states = [[trajectory.packed_states[index] for index in indices] for indices in samples]
        drawing = _Drawing(self, record.state_hash, scene, observation.task, states)
        steps = tuple(
            replace(
                step,
                frames=_StepFrames(drawing, number),
                moments_s=tuple(float(trajectory.time_s[index]) - ran.start_s for index in samples[number]),
            )
            for number, (step, ran) in enumerate(zip(observation.steps, record.steps, strict=True))
        )
        return replace(observation, steps=steps)

    def draw(self, scene: Scene, task: Task, states: Sequence[bytes]) -> dict[str, list[bytes]]:
        """Return view -> encoded pictures of some packed states; the overview shows what the task is about.

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
    """The pictures of one attempt, drawn all together on first access."""

    def __init__(
        self, source: AttemptFrames, state_hash: str, scene: Scene, task: Task, states: list[list[bytes]]
    ) -> None:
        self.views = source.views
        self._source, self._scene, self._task, self._states = source, scene, task, states
        self._name = state_hash[:16]  # Equal states look alike, so their hash names the pictures.

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
        """Return the pictures that a folder keeps, or None unless all of them are there."""
        paths = tuple(self._paths(folder))
        if not paths or not all(path.is_file() for path in paths):
            return None
        data = iter([path.read_bytes() for path in paths])
        return [{view: tuple(next(data) for _ in states) for view in self.views} for states in self._states]

    def _paths(self, folder: Path | None) -> Iterator[Path]:
        if folder is None:
            return
        for number, states in enumerate(self._states, start=1):
            for view in self.views:
                for count in range(1, len(states) + 1):
                    yield folder / self._name / f"step_{number:02}_{view}_{count}.jpg"


class _StepFrames(Mapping[str, tuple[bytes, ...]]):
    """View -> pictures of one step; access draws them."""

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
    """Return an (H, W, 3) uint8 picture as JPEG of at most so many bytes, if need be coarser or smaller."""
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
    """Return the step that a picture of an attempt should show: the one at fault, or the last one."""
    if attempt.failed_step is not None:
        return attempt.failed_step
    at_fault = [critique.step for critique in attempt.critiques if critique.finds_fault]
    return at_fault[0] if at_fault else max((critique.step for critique in attempt.critiques), default=0)


def draw_attempts(evolution: Evolution, folder: Path | None = None) -> AttemptPictures:
    """Draw every attempt at the subtasks that needed more than one, and write the pictures where asked.

    Args:
        evolution: An episode whose loop had a renderer.
        folder: The run's folder; None writes nothing.
    """
    drawn: dict[Key, Mapping[str, tuple[bytes, ...]]] = {}
    files: dict[Key, list[str]] = {}
    for story in evolution.stories:
        if len(story.records) == 1 and story.solved:
            continue
        for number, ((attempt, _), observation) in enumerate(
            zip(story.history.iterations, story.observations, strict=True)
        ):
            step = shown_step(attempt)
            if step >= len(observation.steps) or not observation.steps[step].frames:
                continue
            key = (story.history.subtask, number)
            try:
                drawn[key] = {view: tuple(pictures) for view, pictures in observation.steps[step].frames.items()}
            except PicturesMissing as missing:
                return AttemptPictures(drawn, files, str(missing))
            if folder is not None:
                files[key] = _written(folder, key, step, drawn[key])
    return AttemptPictures(drawn, files, "" if drawn else "nothing was asked to draw them")


def _written(folder: Path, key: Key, step: int, pictures: Mapping[str, tuple[bytes, ...]]) -> list[str]:
    """Write an attempt's pictures and return their names, relative to the run's folder."""
    names = []
    for view, images in pictures.items():
        for count, data in enumerate(images, start=1):
            name = f"{FOLDER}/T{key[0] + 1}_attempt{key[1] + 1}_step{step + 1}_{view}_{count}.jpg"
            write_atomically(folder / name, data)
            names.append(name)
    return names
