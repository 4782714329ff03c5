"""The report of a run as one HTML file that needs no network: styles, pictures, graph and video are inside.

Sections: the plan (verdict, certificate in words, findings); subtasks and steps with evidence and pictures; the
failure; the evolution (attempts side by side, failed step, revision, outcome); peak loads, model usage, how to
repeat the run.
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

from executor.records import Rollout, StepRecord, action_text, describe_peaks, readable
from executor.reports.graph_picture import drawing
from executor.reports.html import jpeg, render
from executor.rollouts.evolution_record import AttemptPictures, Evolution, shown_step
from executor.rollouts.run_record import RunRecord
from executor.sim.render.frames import SPEED, Frames, key_samples
from oag import Action, ActionFlow, Attempt, Grade, Obligation, Report, recheck
from oag.progression import producer_place
from oag.task import step_place, subtask_place

Strip = tuple[str, Sequence[tuple[bytes, str]]]
"""A row of pictures: its label, and JPEG files with their alternative texts."""

_FAILURE_MEANINGS = {
    "unreachable": "No posture of the robot brings the hand where the step needs it.",
    "timeout": "The step took longer than a primitive may.",
    "no-collision-free-path": "The goal of the motion can be reached, but every path found touches something.",
    "grasp-missed": "The fingers closed without holding the target.",
    "too-wide-for-gripper": "The target does not fit between the fingers.",
    "slipped": "What was gripped slid out of the fingers while the robot moved.",
    "stalled": "The robot did not arrive where it was sent: something held it back.",
    "dropped": "The object left the hand before it was to be let go.",
    "unexpected-contact": "Something touched that was not to touch.",
    "side-effect": "The step changed something that was not its to change.",
    "precondition": "The step began in a state in which it cannot work.",
    "goal-not-reached": "All steps ran, but the state afterwards is not the goal.",
}

_OUTCOMES = {
    "succeeded": ("succeeded in simulation", "good"),
    "failed": ("failed in simulation", "bad"),
    "interrupted": ("interrupted", "warn"),
    "not-run": ("not executed", "quiet"),
}
_DISTRIBUTIONS = ("scene2demo", "sapien", "numpy", "scipy", "example-robot-data", "av")


def report_page(record: RunRecord, frames: Frames | None = None, mp4: Path | None = None) -> str:
    """Return the whole page as text.

    Args:
        record: The run's record.
        frames: Pictures of its samples, when there are any.
        mp4: The video to embed, when there is one.
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
        video=None if mp4 is None else mp4.read_bytes(),
        speed=SPEED,
        drawing=drawing(record.graph, rollout),
        sheet="",
        versions=versions(),
        **({"evolution": None} | evolution),
        **_plan(record.report),
        **({} if rollout is None else _happened(rollout, frames)),
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


def _happened(rollout: Rollout, frames: Frames | None) -> dict[str, object]:
    steps = [step for subtask in rollout.subtasks for step in subtask.steps]
    failed = next((step for step in steps if step.failure is not None), None)
    before = [] if failed is None else [s for s in rollout.subtasks[failed.subtask].steps if s.step < failed.step]
    return {
        "with_frames": frames is not None,
        "pictures": {(step.subtask, step.step): frame_strips(rollout, step, frames) for step in steps},
        "records": {record.index: record for record in rollout.subtasks},
        "steps": len(steps),
        "failed": failed,
        "before": before[-1] if before else None,
        "short": next((r for r in rollout.subtasks if not all(reading.satisfied for reading in r.readings)), None),
        "failure_meanings": _FAILURE_MEANINGS,
        "reached": sum(subtask.succeeded for subtask in rollout.subtasks),
        "peaks": list(describe_peaks(asdict(rollout.peaks))),
    }


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
