"""Repeat an episode's commands, and compare every state with the recorded one, bit by bit."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from executor.audit.checks import Finding
from executor.data import samples
from executor.data.store import StoredEpisode
from executor.data.units import DemoUnit
from executor.data.work import noise_of, physics_of
from executor.rollouts.recording import repeat


def replay(episode: StoredEpisode) -> Iterator[Finding]:
    """Check that the recorded commands give the recorded states."""
    unit, rate_hz = DemoUnit.from_json(episode.meta["unit"]), float(episode.meta["record_hz"])
    again = repeat(
        episode.task,
        episode.scene,
        samples.commands(episode.arrays),
        rate_hz,
        physics=physics_of(unit),
        noise=noise_of(unit),
        start=episode.start,
    )
    recorded = episode.arrays["packed_states"]
    found = np.frombuffer(b"".join(again.trajectory.packed_states), "<f4").reshape(-1, recorded.shape[1])
    if found.tobytes() == recorded.tobytes():
        if again.state_hash != episode.meta["state_hash"]:
            yield Finding("replay", "its states are those of its commands, and its hash of them is another")
        return
    rows = min(len(found), len(recorded))
    # As integers: of numbers that are none, no two are equal.
    differs = (found[:rows].view(np.uint32) != np.ascontiguousarray(recorded[:rows]).view(np.uint32)).any(axis=1)
    first = int(np.argmax(differs)) if differs.any() else rows
    yield Finding("replay", f"its commands give {len(found)} states of {len(recorded)}, others from sample {first} on")
