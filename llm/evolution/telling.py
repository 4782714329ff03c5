"""How an attempt is told to a model: its flow, its steps, what was measured, and what was said of them."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import replace

from llm.answers.describe import subtask_table
from llm.evolution.observation import AttemptSeen, StartSeen, StepSeen
from oag import Action, ActionFlow, Attempt, Critique, History, Task, flow_to_json
from oag.revision.grounds import Grounds

LONGEST_SAID = 600
_LONGEST_NUMBERS = 1_500
# Closer than this a thing is where it should be, for readers.
_THERE_M = 1e-3
_MEASURED = ("measurements", "failure", "failure_measurements", "unmet", "misses")
_WORDS = {True: "yes", False: "no", None: "not judged"}


def one_line(text: str, longest: int = LONGEST_SAID) -> str:
    """Returns a text on one line, cut where it is long, without signs that steer a terminal."""
    plain = " ".join("".join(sign if sign.isprintable() else " " for sign in text).split())
    return plain if len(plain) <= longest else f"{plain[: longest - 3]}..."


def task_text(task: Task) -> str:
    """Returns a task's goal and its simple tasks."""
    return f"goal of the whole task: {one_line(str(task.goal), 2_000)}\n{subtask_table(task.subtasks)}"


def subtask_text(seen: AttemptSeen) -> str:
    """Returns the simple task that was attempted."""
    return subtask_table(seen.task.subtasks[seen.subtask : seen.subtask + 1]).partition(" | ")[2]


def start_text(start: StartSeen) -> str:
    """Returns how it was when an attempt began: the robot's pose and the facts."""
    x_m, y_m, yaw_rad = start.base
    lines = [f"robot at ({x_m:.2f}, {y_m:.2f}), heading {math.remainder(yaw_rad, math.tau):.2f} rad"]
    lines.append(f"facts: {' '.join(start.facts) or 'none'}")
    lines.append("of open, ontop and inside everything true is listed; what is not listed is false")
    return "\n".join(lines)


def flow_text(flow: ActionFlow) -> str:
    """Returns a flow as a model writes it, and its steps a line each."""
    return "\n".join((json.dumps(flow_to_json(flow)), *(_step_line(step, action) for step, action in enumerate(flow))))


def steps_text(steps: Sequence[StepSeen], shown: range, *, numbers_run: bool) -> str:
    """Returns some of the steps that ran, a line each.

    Args:
        steps: All of them.
        shown: Indices of those to tell.
        numbers_run: Whether the numbers that were run stand there, or those that were asked for.
    """
    return "\n".join(_step_line(step, steps[step].done if numbers_run else steps[step].asked) for step in shown)


def _step_line(step: int, action: Action) -> str:
    left_open = " (its number was left to the planner)" if action.unfilled else ""
    return f"step {step + 1}: {int(action.primitive)} {action}{left_open}"


def critique_text(critique: Critique) -> str:
    """Returns what was said of a step, on one line."""
    parts = [
        f"step {critique.step + 1} {critique.primitive.name}",
        f"motion as meant: {_WORDS[critique.motion_verified]}",
        f"state reached: {_WORDS[critique.state_reached]}",
    ]
    if critique.anomaly is not None:
        parts.append(f"anomaly: {one_line(critique.anomaly)}")
    if critique.state_contrast:
        parts.append(f"contrast: {one_line(critique.state_contrast)}")
    return " | ".join((*parts, one_line(critique.text)))


def numbers_text(evidence: Grounds) -> str:
    """Returns what was measured as one line of JSON, cut where it is long, empty for nothing.

    Pictures and earlier words are left out, and so is how far things are from a place that they are at.
    """
    ways = ((miss, (miss.forward_m, miss.left_m, miss.up_m)) for miss in evidence.misses)
    missed = tuple(miss for miss, way in ways if any(abs(part_m) >= _THERE_M for part_m in way))
    kept = {
        key: value for key, value in replace(evidence, misses=missed).to_json().items() if key in _MEASURED and value
    }
    if not kept:
        return ""
    rounded = json.loads(json.dumps(kept, default=str), parse_float=lambda number: float(f"{float(number):.4g}"))
    return one_line(json.dumps(rounded), _LONGEST_NUMBERS)


def history_text(history: History, *, told_failures: bool) -> str:
    """Returns what was tried before: each flow, how it failed, and the reason of the revision that came of it.

    Args:
        history: Attempts before the one that is asked about.
        told_failures: Whether the measured failures stand there, or the critiques alone.
    """
    lines = []
    for number, (attempt, revision) in enumerate(history.iterations, start=1):
        lines.append(f"attempt {number}: {json.dumps(flow_to_json(attempt.flow))}")
        lines.append(f"  it failed: {_failure(attempt, told_failures)}")
        if revision is not None:
            lines.append(f"  so it was revised: {one_line(revision.explanation)}")
    return "\n".join(lines) or "nothing: this was the first attempt"


def _failure(attempt: Attempt, told: bool) -> str:
    if told:
        where = "" if attempt.failed_step is None else f"at step {attempt.failed_step + 1}, "
        return f"{where}{one_line(attempt.message or attempt.failure)}"
    faults = [critique for critique in attempt.critiques if critique.finds_fault]
    said = (f"step {fault.step + 1} {fault.primitive.name}: {one_line(fault.text, 240)}" for fault in faults[:3])
    return "; ".join(said) or "the goal was not reached, and no step was found at fault"
