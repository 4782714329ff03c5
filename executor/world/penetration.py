"""How deep bodies overlap while physics runs: a contact solver lets them, and too much of it would be cheating."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from executor.records.rollout import Penetration
from executor.world.world import World

LEAST_M = 1e-5
PERCENTILE = 99.0


@dataclass(frozen=True, slots=True)
class Overlap:
    """The deepest overlap in one state.

    Attributes:
        depth_m: How deep; 0 where nothing overlaps.
        pair: The two bodies as "owner/link", or nothing.
    """

    depth_m: float
    pair: tuple[str, ...] = ()


def deepest(world: World) -> Overlap:
    """Returns the deepest overlap of any two bodies after the last physics step."""
    owners = {"robot", *world.assets}
    found = Overlap(0.0)
    for a, b, gap_m in world.near(owners, -LEAST_M):
        if -gap_m > found.depth_m:
            found = Overlap(-gap_m, (f"{a.owner}/{a.link}", f"{b.owner}/{b.link}"))
    return found


def summary(overlaps: Sequence[Overlap]) -> Penetration:
    """Returns the figures of an episode."""
    if not overlaps:
        return Penetration()
    worst = max(overlaps, key=lambda overlap: overlap.depth_m)
    p99_m = float(np.percentile([overlap.depth_m for overlap in overlaps], PERCENTILE))
    return Penetration(round(p99_m, 6), round(worst.depth_m, 6), worst.pair, len(overlaps))
