"""The report of a run as one HTML file that needs no network: styles, pictures, graph and video are inside.

It is a view of one episode (`executor.reports.episode`): the failure, the video with its steps and curves. Behind it
are the evolution, the proof (certificate in words, findings), the graph, peak loads, model usage, and how to repeat it.
"""

from __future__ import annotations

import platform
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from difflib import SequenceMatcher
from functools import partial
from importlib import metadata
from pathlib import Path
from textwrap import dedent
from urllib.parse import quote

from executor.records import Rollout, StepRecord, action_text, describe_peaks, readable
from executor.reports.episode import (
    Clip,
    EpisodeDetail,
    EpisodeRow,
    Strip,
    episode_values,
    reading_views,
    subtask_views,
)
from executor.reports.graph_picture import graph_picture
from executor.reports.html import data_uri, jpeg, render
from executor.reports.series import MOTION_COLUMNS, MotionPlots, recorded_plots
from executor.rollouts.evolution_record import AttemptPictures, Evolution, shown_step
from executor.rollouts.rollout import failure_of
from executor.rollouts.run_record import RunRecord, reading_json, subtask_json
from executor.sim.render.frames import SPEED, Frames, key_samples
from oag import Action, Report, recheck
from oag.model.actions import ActionFlow
from oag.progression import Grade, Obligation, producer_place
from oag.revision import Attempt
from oag.task_definition import step_place, subtask_place

_OUTCOMES = {
    "succeeded": ("succeeded in simulation", "good"),
    "failed": ("failed in simulation", "bad"),
    "interrupted": ("interrupted", "warn"),
    "not-run": ("not executed", "quiet"),
}
_DISTRIBUTIONS = ("scene2demo", "sapien", "numpy", "scipy", "example-robot-data", "av")


def report_page(
    record: RunRecord, frames: Frames | None = None, mp4: Path | None = None, files: Sequence[Path] = ()
) -> str:
    """Return the whole page as text.

    Args:
        record: The run's record.
        frames: Pictures of its samples, when there are any.
        mp4: The video to embed, when there is one.
        files: Files beside the page, to link.
    """
    rollout = record.rollout
    detours = () if rollout is None else rollout.detour_notes
    evolution = {} if record.evolution is None else evolution_values(record.evolution, record.attempts)
    return render(
        "run.html",
        record=record,
        rollout=rollout,
        heading=record.query or readable(record.graph.task.name),
        outcome=_OUTCOMES[record.outcome],
        notes=list(dict.fromkeys((*record.notes, *map(str, record.sizes), *detours))),
        graph=graph_picture(record.graph, rollout),
        versions=versions(),
        **({"evolution": None} | evolution),
        **_plan(record.report),
        **({"episode": None} if rollout is None else _happened(record, rollout, frames, mp4, files)),
    )


def _plan(report: Report) -> dict[str, object]:
    return {
        "report": report,
        "goal": report.to_json()["goal"],
        "held": sum(obligation.grade is Grade.HOLDS for obligation in report.obligations),
        "checked": None if report.certificate is None else recheck(report.certificate),
        "findings": [(one, dedent("\n".join(str(one).splitlines()[1:]))) for one in report.diagnostics],
        "place_of": partial(_place, report),
        "producer_place": partial(producer_place, report.trace) if report.trace is not None else None,
    }


def _place(report: Report, obligation: Obligation) -> str:
    if obligation.kind == "task-goal":
        return "the task goal"
    if obligation.kind == "precondition":
        return step_place(report.task, obligation.subtask, obligation.step)
    return f"{subtask_place(report.task, obligation.subtask)}, {'start' if obligation.kind == 'init' else 'goal'}"


def _happened(
    record: RunRecord, rollout: Rollout, frames: Frames | None, mp4: Path | None, files: Sequence[Path]
) -> dict[str, object]:
    steps = [step for subtask in rollout.subtasks for step in subtask.steps]
    failure = None if rollout.succeeded else failure_of(rollout)
    kind, message = ("", "") if failure is None else (failure.kind.value, failure.message)
    detail = EpisodeDetail(
        EpisodeRow(rollout.task.name, record.query or "", "", rollout.seed, record.outcome, kind),
        message,
        clips=[] if mp4 is None else [Clip("overview, head and wrist cameras", mp4, SPEED)],
        subtasks=subtask_views(record.report, list(map(subtask_json, rollout.subtasks)), rollout.inserted),
        goal=tuple(reading_views(map(reading_json, rollout.goal_readings))),
        plots=_curves(rollout),
        files=files,
        pictures=() if rollout.succeeded or not steps else frame_strips(rollout, _worth_seeing(steps), frames),
    )
    values = episode_values(
        detail, lambda file: quote(file.name), lambda file: data_uri(file.read_bytes(), "video/mp4")
    )
    peaks = list(describe_peaks(asdict(rollout.peaks)))
    return {**values, "headed": False, "scene_address": "", "steps": len(steps), "peaks": peaks}


def _worth_seeing(steps: Sequence[StepRecord]) -> StepRecord:
    """Return the step that failed, or the last one where none did."""
    return next((step for step in steps if step.failure is not None), steps[-1])


def _curves(rollout: Rollout) -> MotionPlots | None:
    motion = rollout.trajectory
    if not len(motion.time_s):
        return None
    columns = {name: getattr(motion, name) for name in MOTION_COLUMNS}
    return recorded_plots(columns, motion.object_poses, motion.joint_positions, rollout.task, rollout.scene)


def frame_strips(rollout: Rollout, step: StepRecord, frames: Frames | None) -> list[Strip]:
    """Return one row of pictures a view, at most six each, in the order of time; none without pictures."""
    samples = [index for index in key_samples(rollout.trajectory, step) if index < frames.count] if frames else []
    if frames is None or not samples:
        return []

    def shown(view: str, index: int) -> tuple[bytes, str]:
        picture = frames.at_size(view, slice(index, index + 1))[0]
        return jpeg(picture), f"{view} view at {rollout.trajectory.time_s[index]:.1f} s"

    return [(view, [shown(view, index) for index in samples]) for view in frames.views]


def evolution_values(evolution: Evolution, pictures: AttemptPictures) -> dict[str, object]:
    """Return the values of the template `evolution.html`, the section about an episode's revisions."""
    revised = [story for story in evolution.stories if len(story.records) > 1 or story.gave_up is not None]
    stories = []
    for story in revised:
        attempts, before = [], None
        for number, (attempt, revision) in enumerate(story.history.iterations):
            rows = _attempt_strips(pictures.drawn.get((story.history.subtask, number), {}))
            attempts.append((attempt, revision, list(_flow(attempt, before)), rows))
            before = attempt.flow
        stories.append((story, attempts))
    return {"evolution": evolution, "drawn": bool(pictures.drawn), "problem": pictures.problem, "stories": stories}


def _attempt_strips(drawn: Mapping[str, Sequence[bytes]]) -> list[Strip]:
    return [
        (view, [(data, f"{view} view, picture {count}") for count, data in enumerate(files, start=1)])
        for view, files in drawn.items()
    ]


def _flow(attempt: Attempt, before: ActionFlow | None) -> Iterator[tuple[str, str]]:
    """Yield kind and text of the flow's lines, with additions and removals against the flow before it."""
    flow, at_fault = list(attempt.flow), None if attempt.succeeded else shown_step(attempt)
    old = list(before) if before is not None else flow
    for tag, a0, a1, b0, b1 in SequenceMatcher(None, old, flow, autojunk=False).get_opcodes():
        if tag in ("delete", "replace"):
            yield from (("gone", _action_line(action)) for action in old[a0:a1])
        for step in range(b0, b1):
            kinds = [*(["new"] if tag != "equal" else []), *(["at-fault"] if step == at_fault else [])]
            yield " ".join(kinds), f"{step + 1}. {_action_line(flow[step])}"


def _action_line(action: Action) -> str:
    return action_text(action.primitive.name, action.to_json())


def versions() -> str:
    """Return names and installed versions of everything that a run's numbers depend on."""
    found = {"python": platform.python_version()}
    for name in _DISTRIBUTIONS:
        try:
            found[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            continue
    return ", ".join(f"{name} {version}" for name, version in found.items())
