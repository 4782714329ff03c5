"""Recovery as data: what failed in a unit's self-evolution, why, what was done about it, and the motion that failed.

The correction's own motion is that of the next attempt from the same start: a failed one that is kept here too, or the
one that counts in the end and lies in the unit's samples. Nothing of it is a motion *out of* a failure: an evolution
goes back to where the subtask, or an earlier one, began.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from executor.datasets import samples
from executor.evolution.record import Evolution
from executor.machine.files import plain
from executor.primitives.noise import CommandNoise
from executor.results.evolution_files import pairs
from executor.rollouts.repeat import repeat_subtask
from executor.world.physics import Physics


def write_corrections(folder: Path, story: Evolution, physics: Physics, noise: CommandNoise) -> list[dict[str, Any]]:
    """Writes the motion of every attempt that was revised, and returns what failed in each and what was revised.

    Args:
        folder: The unit's folder; the motions become `attempt-<subtask>-<number>.xz`, both counted from 1.
        story: The unit's evolution.
        physics, noise: What it was executed with.

    Returns:
        One mapping for each revision, of the form of `executor.results.evolution_files.pairs`, with the file's name as
        `samples`.

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
        record, name = records[place], f"attempt-{place[0] + 1}-{place[1] + 1}.xz"
        motion = repeat_subtask(
            story.rollout.scene, record, story.rollout.record_hz, faults=story.faults, physics=physics, noise=noise
        )
        before: list[tuple[()]] = [()] * record.index
        (folder / name).write_bytes(samples.packed(samples.motion_columns(motion, [*before, record.commands])))
        found.append(plain({**pair, "samples": name}))
    return found
