"""What happened: every subtask with its judgement, every step with its evidence and pictures."""

from __future__ import annotations

from collections.abc import Sequence

from bddl.visible import counted
from executor.pictures.frames import Frames, key_samples
from executor.pictures.video import SPEED
from executor.records.captions import action_text, readable
from executor.records.rollout import Failure, Rollout, StepRecord
from executor.results.report.html import badge, jpeg_uri, measurements, picture_tag, text
from oag import SimpleTask
from oag.revision.grounds import GoalReading
from oag.revision.measurements import measurements_json


def steps_section(rollout: Rollout, frames: Frames | None) -> str:
    """Returns one card a subtask, those that never ran included."""
    records = {record.index: record for record in rollout.subtasks}
    parts = []
    for index, subtask in enumerate(rollout.task.subtasks):
        record = records.get(index)
        if record is None:
            state, steps, readings = badge("not run", "quiet"), "", ""
        else:
            state = badge("reached", "good") if record.succeeded else badge("failed", "bad")
            steps = "".join(_step(rollout, step, len(record.flow), frames) for step in record.steps)
            readings = readings_list(record.readings)
        parts.append(
            f'<div class="card"><div class="row"><h3>{index + 1}. {text(readable(subtask.name))}</h3>{state}</div>'
            f"{_texts(subtask)}{readings}{steps}</div>"
        )
    if rollout.goal_readings:
        parts.append(f'<div class="card"><h3>Task goal</h3>{readings_list(rollout.goal_readings)}</div>')
    return "".join(parts)


def readings_list(readings: Sequence[GoalReading]) -> str:
    """Returns what the detectors read of each literal of a goal, with the numbers behind it."""
    if not readings:
        return ""
    rows = []
    for reading in readings:
        mark = '<span class="tick">&#10003;</span>' if reading.satisfied else '<span class="cross">&#10007;</span>'
        literal = reading.literal if reading.wanted else f"(not {reading.literal})"
        rows.append(f"<li>{mark} <code>{text(literal)}</code>{measurements(reading.measurements.to_json())}</li>")
    return f'<ul class="plain">{"".join(rows)}</ul>'


def _texts(subtask: SimpleTask) -> str:
    values = subtask.to_json()
    return (
        f"<p class='soft'>{text(subtask.detail)}</p>"
        f"<p><span class='soft'>from</span> <code>{text(values['init'])}</code> "
        f"<span class='soft'>to</span> <code>{text(values['goal'])}</code></p>"
    )


def _step(rollout: Rollout, step: StepRecord, length: int, frames: Frames | None) -> str:
    failure = step.failure
    label = badge(failure.kind.value, "bad") if failure else ""
    seek = f'<button class="seek" data-at="{step.start_s / SPEED:.2f}">play</button>' if frames else ""
    times = f"{step.start_s:.1f} to {step.end_s:.1f} s, planned in {step.planning_wall_s:.2f} s"
    blamed = f"<p>{text(failure.message)}</p>{measurements(measurements_json(failure.measurements))}" if failure else ""
    name = f"{step.step + 1}/{length} {action_text(step.primitive, step.action)}"
    return (
        f'<details class="step"{" open" if failure or frames else ""}><summary>'
        f'<span class="name">{text(name)}</span>{label}{seek}'
        f'<span class="time">{times}</span></summary>{blamed}{measurements(measurements_json(step.measurements))}'
        f"{frame_strips(rollout, step, frames)}</details>"
    )


def frame_strips(rollout: Rollout, step: StepRecord, frames: Frames | None) -> str:
    """Returns one row of pictures a view, at most six each, in the order of time; empty without pictures."""
    if frames is None:
        return ""
    samples = [index for index in key_samples(rollout.trajectory, step) if index < frames.count]
    rows = []
    for view in frames.views:
        pictures = "".join(
            picture_tag(
                jpeg_uri(frames.at_size(view, slice(index, index + 1))[0]),
                f"{view} view at {rollout.trajectory.time_s[index]:.1f} s",
                frames.size,
            )
            for index in samples
        )
        rows.append(f'<div class="strip"><span>{text(view)}</span>{pictures}</div>')
    return f'<div class="strips">{"".join(rows)}</div>' if samples else ""


_MEANING = {
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


def failure_section(rollout: Rollout, frames: Frames | None) -> str:
    """Returns the card about what ended a rollout; empty for one that succeeded."""
    if rollout.succeeded:
        return ""
    step = failed_step(rollout)
    if step is not None and step.failure is not None:
        return _card(_step_story(rollout, step, step.failure, frames))
    unmet = [(r.index, r.readings) for r in rollout.subtasks if not all(x.satisfied for x in r.readings)]
    if unmet:
        index, readings = unmet[0]
        name = readable(rollout.task.subtasks[index].name)
        return _card(f"<h3>Subtask {index + 1}, {text(name)}, did not reach its goal</h3>{readings_list(readings)}")
    if any(not reading.satisfied for reading in rollout.goal_readings):
        return _card(f"<h3>The task goal does not hold at the end</h3>{readings_list(rollout.goal_readings)}")
    done, total = len(rollout.subtasks), len(rollout.task.subtasks)
    head = f"The rollout ended after {done} of {counted(total, 'subtask')}"
    return _card(f"<h3>{head}</h3><p>What was done until then is below.</p>")


def failed_step(rollout: Rollout) -> StepRecord | None:
    """Returns the first step that failed, or None."""
    return next((s for subtask in rollout.subtasks for s in subtask.steps if s.failure is not None), None)


def _step_story(rollout: Rollout, step: StepRecord, failure: Failure, frames: Frames | None) -> str:
    subtask = rollout.task.subtasks[step.subtask]
    before = [s for s in rollout.subtasks[step.subtask].steps if s.step < step.step]
    context = f"It came after {text(action_text(before[-1].primitive, before[-1].action))}. " if before else ""
    reached = f"{sum(r.succeeded for r in rollout.subtasks)} of {counted(len(rollout.task.subtasks), 'subtask')}"
    return (
        f"<h3>{text(action_text(step.primitive, step.action))} failed at {step.end_s:.1f} s</h3>"
        f"<p>{badge(failure.kind.value, 'bad')} {text(failure.message)}</p>"
        f"<p class='soft'>{_MEANING.get(failure.kind.value, '')} {context}It is step {step.step + 1} of subtask "
        f"{step.subtask + 1}, {text(readable(subtask.name))}; {reached} "
        "had reached the goal.</p>"
        f"{measurements(measurements_json(failure.measurements))}{frame_strips(rollout, step, frames)}"
    )


def _card(content: str) -> str:
    return f'<h2 id="failure">Why it failed</h2><div class="card bad">{content}</div>'
