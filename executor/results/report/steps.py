"""What happened: every subtask with its judgement, every step with its evidence and pictures."""

from __future__ import annotations

from collections.abc import Sequence

from bddl.visible import counted
from executor.pictures.frames import Frames, key_samples
from executor.pictures.video import SPEED
from executor.records.captions import action_text, readable
from executor.records.rollout import Failure, Rollout, StepRecord
from executor.results.report.html import badge, card, fold, jpeg, measurements, soft, strip, text
from oag.revision.grounds import GoalReading
from oag.revision.measurements import measurements_json


def steps_section(rollout: Rollout, frames: Frames | None) -> str:
    """Returns one card a subtask, those that never ran included."""
    records = {record.index: record for record in rollout.subtasks}
    parts = []
    for index, subtask in enumerate(rollout.task.subtasks):
        record, told = records.get(index), subtask.to_json()
        if record is None:
            state, happened = badge("not run", "quiet"), ""
        else:
            state = badge("reached", "good") if record.succeeded else badge("failed", "bad")
            steps = (_step(rollout, step, len(record.flow), frames) for step in record.steps)
            happened = f"{readings_list(record.readings)}{''.join(steps)}"
        added = badge("inserted on the way", "quiet") if index in rollout.inserted else ""
        parts.append(
            card(
                f'<div class="row"><h3>{index + 1}. {text(readable(subtask.name))}</h3>{state}{added}</div>',
                soft(text(subtask.detail)),
                f"<p><span class='soft'>from</span> <code>{text(told['init'])}</code> ",
                f"<span class='soft'>to</span> <code>{text(told['goal'])}</code></p>",
                happened,
            )
        )
    if rollout.goal_readings:
        parts.append(card("<h3>Task goal</h3>", readings_list(rollout.goal_readings)))
    return "".join(parts)


def readings_list(readings: Sequence[GoalReading]) -> str:
    """Returns what the detectors read of each literal of a goal, with the numbers behind it."""
    rows = []
    for reading in readings:
        mark = '<span class="tick">&#10003;</span>' if reading.satisfied else '<span class="cross">&#10007;</span>'
        rows.append(f"<li>{mark} <code>{text(reading)}</code>{measurements(reading.measurements.to_json())}</li>")
    return f'<ul class="plain">{"".join(rows)}</ul>' if rows else ""


def _step(rollout: Rollout, step: StepRecord, length: int, frames: Frames | None) -> str:
    failure = step.failure
    name = f"{step.step + 1}/{length} {action_text(step.primitive, step.action)}"
    label = badge(failure.kind.value, "bad") if failure else ""
    seek = f'<button class="seek" data-at="{step.start_s / SPEED:.2f}">play</button>' if frames else ""
    times = f"{step.start_s:.1f} to {step.end_s:.1f} s, planned in {step.planning_wall_s:.2f} s"
    return fold(
        f'<span class="name">{text(name)}</span>{label}{seek}<span class="time">{times}</span>',
        f"<p>{text(failure.message)}</p>{measurements(measurements_json(failure.measurements))}" if failure else "",
        measurements(measurements_json(step.measurements)),
        frame_strips(rollout, step, frames),
        kind="step",
        unfolded=bool(failure or frames),
    )


def frame_strips(rollout: Rollout, step: StepRecord, frames: Frames | None) -> str:
    """Returns one row of pictures a view, at most six each, in the order of time; empty without pictures."""
    samples = [index for index in key_samples(rollout.trajectory, step) if index < frames.count] if frames else []
    if frames is None or not samples:
        return ""
    times = rollout.trajectory.time_s
    rows = (
        strip(
            view,
            [
                (jpeg(frames.at_size(view, slice(index, index + 1))[0]), f"{view} view at {times[index]:.1f} s")
                for index in samples
            ],
        )
        for view in frames.views
    )
    return f'<div class="strips">{"".join(rows)}</div>'


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
    failed = next((s for subtask in rollout.subtasks for s in subtask.steps if s.failure is not None), None)
    short = next((r for r in rollout.subtasks if not all(reading.satisfied for reading in r.readings)), None)
    if failed is not None and failed.failure is not None:
        story = _step_story(rollout, failed, failed.failure, frames)
    elif short is not None:
        name = readable(rollout.task.subtasks[short.index].name)
        head = f"<h3>Subtask {short.index + 1}, {text(name)}, did not reach its goal</h3>"
        story = f"{head}{readings_list(short.readings)}"
    elif any(not reading.satisfied for reading in rollout.goal_readings):
        story = f"<h3>The task goal does not hold at the end</h3>{readings_list(rollout.goal_readings)}"
    else:
        done, total = len(rollout.subtasks), counted(len(rollout.task.subtasks), "subtask")
        story = f"<h3>The rollout ended after {done} of {total}</h3><p>What was done until then is below.</p>"
    return f'<h2 id="failure">Why it failed</h2>{card(story, kind="bad")}'


def _step_story(rollout: Rollout, step: StepRecord, failure: Failure, frames: Frames | None) -> str:
    before = [s for s in rollout.subtasks[step.subtask].steps if s.step < step.step]
    context = f"It came after {text(action_text(before[-1].primitive, before[-1].action))}. " if before else ""
    reached = f"{sum(r.succeeded for r in rollout.subtasks)} of {counted(len(rollout.task.subtasks), 'subtask')}"
    where = f"step {step.step + 1} of subtask {step.subtask + 1}, {readable(rollout.task.subtasks[step.subtask].name)}"
    told = f"{_MEANING[failure.kind.value]} {context}It is {text(where)}; {reached} had reached the goal."
    return (
        f"<h3>{text(action_text(step.primitive, step.action))} failed at {step.end_s:.1f} s</h3>"
        f"<p>{badge(failure.kind.value, 'bad')} {text(failure.message)}</p>{soft(told)}"
        f"{measurements(measurements_json(failure.measurements))}{frame_strips(rollout, step, frames)}"
    )
