"""One episode on a page: why it failed, videos, steps over time with measurements and proof, and curves.

Reports of runs and the viewer show the same section; its template is `episode.html`.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import bddl
from executor.records import action_text, readable
from executor.reports.html import render, script_json, value_text
from executor.reports.series import MotionPlots
from oag import Report, Scene
from oag.progression import producer_place

Facts = Sequence[tuple[str, str]]
"""Names with their values, as text."""

Strip = tuple[str, Sequence[tuple[bytes, str]]]
"""A row of pictures: its label, and JPEG files with their alternative texts."""

FAILURE_MEANINGS = {
    "unreachable": "No posture of the robot brings the hand where the step needs it.",
    "timeout": "The step took longer than a primitive may.",
    "no-answer-in-time": "The search took all its time and found nothing: whether there is a way is not known.",
    "no-collision-free-path": "The goal of the motion can be reached, but every path found touches something.",
    "grasp-missed": "The fingers closed without holding the target.",
    "too-wide-for-gripper": "The target does not fit between the fingers.",
    "no-such-part": "The thing has no such door, drawer or shelf.",
    "slipped": "What was gripped slid out of the fingers while the robot moved.",
    "stalled": "The robot did not arrive where it was sent: something held it back.",
    "dropped": "The object left the hand before it was to be let go.",
    "unexpected-contact": "Something touched that was not to touch.",
    "side-effect": "The step changed something that was not its to change.",
    "precondition": "The step began in a state in which it cannot work.",
    "goal-not-reached": "All steps ran, but the state afterwards is not the goal.",
    # Of policies (`executor.learn.evaluation.FAILURES`).
    "not-reached": "The hand never came near what it was to take hold of.",
    "not-grasped": "The hand came near, and never held it.",
    "not-far-enough": "It was held, and moved too little.",
    "lost": "It was held, and then lost.",
    "displaced": "The thing was pushed away.",
    "tipped": "The thing fell over.",
    "incomplete": "The task was not finished in time.",
}


@dataclass(frozen=True, slots=True)
class EpisodeRow:
    """One line of a table of episodes.

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
class ReadingView:
    """A literal of a goal, as the detectors read it at rest."""

    text: str
    satisfied: bool
    measurements: Facts = ()


@dataclass(frozen=True, slots=True)
class StepView:
    """One step.

    Attributes:
        text: The primitive with its number.
        start_s, end_s: When it ran [s]; None where it did not, or where that was not kept.
        failure: Kind and message; None where it succeeded.
        measurements: What was measured.
        needs: Condition of the proof -> what establishes it.
        number: Its number in the flow, from 1; None where all steps before it are kept as well.
    """

    text: str
    start_s: float | None
    end_s: float | None
    failure: tuple[str, str] | None = None
    measurements: Facts = ()
    needs: Facts = ()
    number: int | None = None


@dataclass(frozen=True, slots=True)
class SubtaskView:
    """One subtask.

    Attributes:
        name, goal: Its name, and its goal as BDDL.
        succeeded: Whether the goal was reached; None where it did not run.
        steps: Its steps.
        readings: What the detectors read of its goal.
        inserted: Whether the rollout inserted it into the plan.
    """

    name: str
    goal: str
    succeeded: bool | None
    steps: Sequence[StepView] = ()
    readings: Sequence[ReadingView] = ()
    inserted: bool = False


@dataclass(frozen=True, slots=True)
class EpisodeDetail:
    """Everything that a page shows of one episode.

    Attributes:
        row: Its line of the table.
        message: Why it failed, in words.
        verdict: What `verify` decides of the plan; empty where there is none.
        clips: Its videos.
        subtasks: What was done.
        goal: What the detectors read of the task's goal at the end.
        plots: Curves of its motion; None where no motion was kept.
        files: Its files for download.
        commands: What can be done with it -> the command.
        scene: Its scene; None where none was kept.
        pictures: Pictures of the step that failed.
    """

    row: EpisodeRow
    message: str = ""
    verdict: str = ""
    clips: Sequence[Clip] = ()
    subtasks: Sequence[SubtaskView] = ()
    goal: Sequence[ReadingView] = ()
    plots: MotionPlots | None = None
    files: Sequence[Path] = ()
    commands: Facts = ()
    scene: Scene | None = None
    pictures: Sequence[Strip] = ()

    @property
    def duration_s(self) -> float:
        """The time [s] that its page runs through."""
        times = (self.plots.time_s[-1:] if self.plots else ()) or ()
        ends = (step.end_s for part in self.subtasks for step in part.steps)
        return max(time for time in (*times, *ends, self.row.simulated_s, 1e-3) if time is not None)

    @property
    def timed(self) -> bool:
        """Whether it is known when its steps ran."""
        return any(step.start_s is not None for part in self.subtasks for step in part.steps)

    @property
    def failed_step(self) -> tuple[int, int] | None:
        """Subtask and number, both from 0, of the first step that failed; None without one."""
        return next(
            (
                (index, number)
                for index, part in enumerate(self.subtasks)
                for number, step in enumerate(part.steps)
                if step.failure
            ),
            None,
        )

    @property
    def unmet(self) -> list[ReadingView]:
        """What the goals asked for and the detectors did not read."""
        found = [*(reading for part in self.subtasks for reading in part.readings), *self.goal]
        return [reading for reading in found if not reading.satisfied]


def subtask_views(
    report: Report, records: Sequence[Mapping[str, Any]], inserted: Collection[int] = ()
) -> tuple[SubtaskView, ...]:
    """Return a plan's subtasks: executed steps with measurements, each beside its proof, and those that did not run.

    Args:
        report: The report of `verify` about the plan.
        records: The executed subtasks, as `executor.rollouts.run_record.subtask_json` writes them.
        inserted: Indices of the subtasks that the rollout inserted.
    """
    needs: dict[tuple[int, int], list[tuple[str, str]]] = {}
    for obligation in report.obligations:
        if obligation.kind == "precondition" and report.trace is not None and obligation.step is not None:
            links = [(link.condition.text(), producer_place(report.trace, link.producer)) for link in obligation.links]
            needs.setdefault((obligation.subtask, obligation.step), []).extend(links)
    views = []
    for number, subtask in enumerate(report.task.subtasks):
        record = records[number] if number < len(records) else None
        steps = [] if record is None else list(record["steps"])
        shown = [_step(step, needs.get((number, index), ())) for index, step in enumerate(steps)]
        for index, action in list(enumerate(subtask.flow or ()))[len(steps) :]:
            text = action_text(action.primitive.name, action.to_json())
            shown.append(StepView(text, None, None, needs=needs.get((number, index), ())))
        succeeded = None if record is None else bool(record["succeeded"])
        read = () if record is None else tuple(reading_views(record.get("readings") or ()))
        goal = bddl.format(subtask.goal)
        views.append(SubtaskView(readable(subtask.name), goal, succeeded, shown, read, number in inserted))
    return tuple(views)


def reading_views(readings: Iterable[Mapping[str, Any]]) -> Iterator[ReadingView]:
    """Yield readings of detectors, as a rollout's JSON has them."""
    for reading in readings:
        literal, wanted = str(reading["literal"]), bool(reading["wanted"])
        text = literal if wanted else f"(not {literal})"
        yield ReadingView(text, bool(reading["value"]) == wanted, measured_facts(reading.get("measurements") or {}))


_UNITS = {"m": "m", "mm": "mm", "s": "s", "n": "N", "deg": "\u00b0", "rad": "rad", "kg": "kg", "percent": "%"}


def measured_facts(measured: Mapping[str, object]) -> list[tuple[str, str]]:
    """Return measured values with readable names, units in brackets."""
    return [(_with_unit(name), _measured_text(value)) for name, value in measured.items()]


def _measured_text(value: object) -> str:
    if not isinstance(value, Mapping):
        return value_text(value)
    return ", ".join(f"{_with_unit(name)} {value_text(part)}" for name, part in value.items())


def _with_unit(name: str) -> str:
    if not name.isidentifier():
        return name  # A condition.
    stem, _, ending = name.rpartition("_")
    return f"{readable(stem)} [{_UNITS[ending]}]" if stem and ending in _UNITS else readable(name)


def _step(step: Mapping[str, Any], needs: Facts) -> StepView:
    failure = step["failure"] or {}
    measured = measured_facts({**(failure.get("measurements") or {}), **(step.get("measurements") or {})})
    if "planning_wall_s" in step:
        measured.append(("planned in", f"{step['planning_wall_s']:.2f} s"))
    return StepView(
        action_text(step["primitive"], step["action"]),
        step["start_s"],
        step["end_s"],
        (str(failure["kind"]), str(failure["message"])) if failure else None,
        measured,
        needs,
    )


def episode_section(detail: EpisodeDetail, link: Callable[[Path], str], scene_address: str = "") -> str:
    """Return an episode as a section of a page, with its own heading.

    Args:
        detail: The episode.
        link: Returns the address of one of its files.
        scene_address: Page of its scene in 3-D; empty where there is none.
    """
    scene_address = scene_address if detail.scene is not None else ""
    return render("episode.html", headed=True, scene_address=scene_address, **episode_values(detail, link))


def episode_values(
    detail: EpisodeDetail, link: Callable[[Path], str], source: Callable[[Path], str] | None = None
) -> dict[str, object]:
    """Return the values of the template `episode.html`.

    Args:
        detail: The episode.
        link: Returns the address of one of its files.
        source: Returns what a video is played from; by default its address.
    """
    place = detail.failed_step
    return {
        "episode": detail,
        "clips": [(clip, (source or link)(clip.file)) for clip in detail.clips],
        "files": [(file.name, link(file)) for file in detail.files],
        "failed": place,
        "failed_step": None if place is None else detail.subtasks[place[0]].steps[place[1]],
        "before": detail.subtasks[place[0]].steps[place[1] - 1] if place and place[1] else None,
        "reached": sum(part.succeeded is True for part in detail.subtasks),
        "meanings": FAILURE_MEANINGS,
        "motion": script_json(None if detail.plots is None else detail.plots.to_json()),
    }
