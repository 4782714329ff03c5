"""Recovery as data: what failed in a unit's self-evolution, why, what was done about it, and the motion that failed.

The correction's own motion is that of the next attempt from the same start: a failed one that is kept here too, or the
one that counts in the end and lies in the unit's samples. Nothing of it is a motion *out of* a failure: an evolution
goes back to where the subtask, or an earlier one, began.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from executor.datasets import samples
from executor.datasets.footage import Filmed
from executor.datasets.store import SAMPLES
from executor.datasets.work import step_told
from executor.evolution.record import Evolution
from executor.machine.files import plain
from executor.primitives.noise import CommandNoise
from executor.records.rollout import Trajectory
from executor.results.evolution_files import attempt_after, pairs
from executor.rollouts.repeat import repeat_subtask
from executor.world.physics import Physics

Film = Callable[[Trajectory, Path], Filmed]
"""Draws a motion into a folder."""


def write_corrections(
    folder: Path, story: Evolution, physics: Physics, noise: CommandNoise, draw: Film | None = None
) -> list[dict[str, Any]]:
    """Writes the motion of every attempt that was revised, and returns what failed in each and what was revised.

    Args:
        folder: The unit's folder; the motions become `attempt-<subtask>-<number>.xz`, both counted from 1, and their
            pictures lie in folders beside them, of the same name.
        story: The unit's evolution.
        physics, noise: What it was executed with.
        draw: Draws their pictures, where there are to be some.

    Returns:
        One mapping for each revision, of the form of `executor.results.evolution_files.pairs`, with the file's name as
        `samples`, the steps that ran as `steps`, what is said of pictures as `pictures`, and as `corrected_by` the file
        with the motion of the revised flow, null where it was not kept.

    Raises:
        OSError: The folder cannot be written.
    """
    records = {
        (told.history.subtask, number): record for told in story.stories for number, record in enumerate(told.records)
    }
    found = []
    for pair in pairs(story):
        context: Any = pair["context"]
        place = context["subtask"], context["attempt"] - 1
        record, name = records[place], _name(*place)
        motion = repeat_subtask(
            story.rollout.scene, record, story.rollout.record_hz, faults=story.faults, physics=physics, noise=noise
        )
        before: list[tuple[()]] = [()] * record.index
        arrays = samples.motion_columns(motion, [*before, record.commands])
        told: dict[str, Any] = {**pair, "samples": f"{name}.xz", "corrected_by": corrected_by(story, *place)}
        # A repetition does not tell steps apart; each took its samples after it began, up to its end.
        times_s = motion.time_s
        told["steps"] = [step_told(step, (step.start_s < times_s) & (times_s <= step.end_s)) for step in record.steps]
        if draw is not None:
            (folder / name).mkdir()
            filmed = draw(motion, folder / name)
            told["pictures"] = filmed.described
            arrays |= filmed.poses
        (folder / f"{name}.xz").write_bytes(samples.packed(arrays))
        found.append(plain(told))
    return found


def _name(subtask: int, number: int) -> str:
    return f"attempt-{subtask + 1}-{number + 1}"


def corrected_by(story: Evolution, subtask: int, number: int) -> str | None:
    """Returns the file with the motion of the flow that an attempt was revised to; None where it was not kept.

    The last attempt at a subtask is part of the episode; of those before it, the ones that were revised are kept.

    Args:
        story: The unit's evolution.
        subtask, number: The attempt, both from 0.
    """
    after = attempt_after(story, subtask, number)
    if after is None:
        return None
    told = next(told for told in story.stories if told.history.subtask == after[0])
    if after[1] + 1 == len(told.records):
        return SAMPLES
    attempt, revision = told.history.iterations[after[1]]
    return None if attempt.succeeded or revision is None else f"{_name(*after)}.xz"
