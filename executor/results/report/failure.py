"""The story of a failure: where, what was measured, what it means for the plan, and how to look closer."""

from __future__ import annotations

from bddl.visible import counted
from executor.pictures.frames import Frames
from executor.records.captions import action_text, readable
from executor.records.rollout import Failure, Rollout, StepRecord
from executor.results.report.html import badge, measurements, text
from executor.results.report.steps import frame_strips, readings_list
from oag.revision.measurements import measurements_json

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
