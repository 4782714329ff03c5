"""What is going on at each recorded sample, and what was asked of the robot in all, in words."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from executor.records.rollout import Rollout
from oag.model.jsonfile import as_number


@dataclass(frozen=True, slots=True)
class Caption:
    """The two lines of a picture's caption and how far the whole is.

    Attributes:
        title: The subtask, with its number.
        detail: The step, with its number, or what is waited for between steps.
        time_s: Simulated time.
        progress: From 0 to 1.
    """

    title: str
    detail: str
    time_s: float
    progress: float


def captions_of(rollout: Rollout) -> tuple[Caption, ...]:
    """Returns one caption for each recorded sample."""
    trajectory = rollout.trajectory
    steps = {(s.subtask, s.step): s for subtask in rollout.subtasks for s in subtask.steps}
    total = len(rollout.task.subtasks)
    count = len(trajectory.time_s)
    made = []
    for index in range(count):
        subtask, number = int(trajectory.subtask[index]), int(trajectory.step[index])
        planned = rollout.task.subtasks[subtask]
        step = steps.get((subtask, number))
        length = len(planned.flow or ())
        if step is not None:
            detail = f"step {number + 1} of {length}: {action_text(step.primitive, step.action)}"
        else:
            detail = "settling" if number < 0 else f"step {number + 1} of {length}"
        title = f"{subtask + 1}/{total}  {readable(planned.name)}"
        made.append(Caption(title, detail, float(trajectory.time_s[index]), (index + 1) / count))
    return tuple(made)


def action_text(primitive: str, action: object) -> str:
    """Returns an action in words, such as `ARTICULATE_OPEN 0.85`."""
    if not isinstance(action, dict):
        return primitive
    values = [value for value in action.values() if value is not None]
    numbers = [part for value in values for part in (value if isinstance(value, list | tuple) else [value])]
    return " ".join([primitive, *(number_text(number) for number in numbers)])


def number_text(value: object) -> str:
    """Returns a number with at most four significant digits, anything else as text.

    What is nearer to zero than a thousandth of a thousandth counts as zero: no measured length or angle is finer.
    """
    if isinstance(value, bool) or not isinstance(value, int | float):
        return str(value)
    number = as_number(value) or 0.0
    return "0" if abs(number) < 1e-6 else f"{number:.4g}"


def readable(name: str) -> str:
    """Returns an activity's name for people: `open_refrigerator` becomes `open refrigerator`."""
    return name.replace("_", " ")


def peaks_words(peaks: Mapping[str, float]) -> Iterator[tuple[str, str]]:
    """Yields each part of the robot with the most that was asked of it.

    Args:
        peaks: The numbers of `executor.records.rollout.Peaks` by their names.
    """
    for part, name, force in (("base", "base_m_s", "base_n"), ("base's turning", "yaw_rad_s", "yaw_nm")):
        unit, speed = ("N", "m/s") if part == "base" else ("N m", "rad/s")
        yield part, f"{peaks[force]:.0f} {unit}, {peaks[name]:.2f} {speed}, {peaks[f'{name}2']:.1f} {speed}2"
    torques = f"{peaks['shoulder_nm']:.1f} and {peaks['wrist_nm']:.1f} N m"
    yield "arm", f"{torques}, {peaks['arm_rad_s']:.1f} rad/s, {peaks['arm_rad_s2']:.1f} rad/s2"
    yield "fingers", f"{peaks['finger_n']:.0f} N"
