"""What the viewer shows of an episode: a row of its table, and everything about one of them."""

from __future__ import annotations

import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol

from bddl.errors import Scene2DemoError
from executor.reports.series import MotionPlots
from oag import Scene


class NothingToView(Scene2DemoError, ValueError):
    """A path holds nothing that the viewer reads, or an episode is not there."""


@dataclass(frozen=True, slots=True)
class EpisodeRow:
    """One line of the table.

    Attributes:
        name: Unique in its listing.
        task: The sentence, or the name of the task.
        series: What it belongs to: a family, a setting of a benchmark, a policy.
        seed: Its seed.
        ended: "succeeded", "failed", or how its process ended.
        failure: Kind of its failure; empty for a success.
        simulated_s: Simulated time [s].
        subtasks, steps: How many were executed.
        drawn: Varied value -> what was drawn, a number or a word.
        videos: Number of its videos.
        bytes: Size of its files.
        audited: Verdict of its audit; empty where it has none.
    """

    name: str
    task: str
    series: str
    seed: int | None
    ended: str
    failure: str = ""
    simulated_s: float | None = None
    subtasks: int | None = None
    steps: int | None = None
    drawn: Mapping[str, float | str] = field(default_factory=dict)
    videos: int = 0
    bytes: int | None = None
    audited: str = ""


@dataclass(frozen=True, slots=True)
class Clip:
    """One video of an episode.

    Attributes:
        name: The view.
        file: Its file.
        speed: Seconds of the episode in a second of the video.
        begin_s: Where the episode begins in the file [s].
    """

    name: str
    file: Path
    speed: float = 1.0
    begin_s: float = 0.0


@dataclass(frozen=True, slots=True)
class StepView:
    """One executed step.

    Attributes:
        text: The primitive with its number.
        start_s, end_s: When it ran [s]; None where it did not.
        failure: Kind and message; None where it succeeded.
        measurements: Name -> value, as text.
        needs: Condition of the proof -> what establishes it.
    """

    text: str
    start_s: float | None
    end_s: float | None
    failure: tuple[str, str] | None = None
    measurements: Sequence[tuple[str, str]] = ()
    needs: Sequence[tuple[str, str]] = ()


@dataclass(frozen=True, slots=True)
class SubtaskView:
    """One subtask.

    Attributes:
        name, goal: Its name, and its goal as BDDL.
        succeeded: Whether the goal was reached; None where it did not run.
        steps: Its steps.
    """

    name: str
    goal: str
    succeeded: bool | None
    steps: Sequence[StepView] = ()


@dataclass(frozen=True, slots=True)
class EpisodeDetail:
    """Everything that the page shows of one episode.

    Attributes:
        row: Its line of the table.
        message: Why it failed, in words.
        verdict: What `verify` decides of the plan; empty where there is none.
        clips: Its videos.
        subtasks: What was done.
        plots: Curves of its motion; None where no motion was kept.
        files: Its files for download.
        commands: What can be done with it -> the command.
        scene: Its scene; None where none was kept.
    """

    row: EpisodeRow
    message: str = ""
    verdict: str = ""
    clips: Sequence[Clip] = ()
    subtasks: Sequence[SubtaskView] = ()
    plots: MotionPlots | None = None
    files: Sequence[Path] = ()
    commands: Sequence[tuple[str, str]] = ()
    scene: Scene | None = None


class Listing(Protocol):
    """What a path holds: its episodes, and the details of each."""

    @property
    def path(self) -> Path:
        """The path."""
        ...

    @property
    def kind(self) -> str:
        """What it is: "run", "store", "benchmark", "evaluation" or "data set"."""
        ...

    @property
    def selection_command(self) -> str:
        """A command for selected episodes, with `{names}` for their names; empty where there is none."""
        ...

    def rows(self) -> Sequence[EpisodeRow]:
        """Return the table, in order."""
        ...

    def detail(self, name: str) -> EpisodeDetail:
        """Return everything about an episode.

        Raises:
            NothingToView: There is no such episode, or it is unreadable.
        """
        ...


def command(name: str, *words: object) -> str:
    """Return a command line of this program, quoted for a shell."""
    return shlex.join(["scene2demo", *name.split(), *map(str, words)])
