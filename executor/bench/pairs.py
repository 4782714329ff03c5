"""From a family and a seed to the scene and the task that they stand for, and what the kinematic rule says of them."""

from __future__ import annotations

from functools import cache
from typing import Any

from executor.scenes import household, long_horizon
from executor.scenes.pair import ScenePair
from executor.scenes.reachability import reach


def pair_of(family: str, seed: int, index: int | None) -> ScenePair:
    """Returns a scene-task pair; equal arguments give equal pairs.

    Args:
        family: "T1" to "T6".
        seed: Of T1 to T4 the episode's seed; of T5 and T6 that of the set of pairs.
        index: Position in the set; None for T1 to T4.

    Raises:
        NotDrawn: No room could be made of this seed.
    """
    return long_horizon.draw(family, seed) if index is None else household.pair(seed, index)


@cache
def indices_of(family: str) -> tuple[int, ...]:
    """Returns the positions of a household family's pairs in a set, in order."""
    wishes = [wish for layout in household.layouts() for wish in layout.wishes]
    return tuple(index for index, wish in enumerate(wishes) if wish.family == family)


def reachability_of(pair: ScenePair) -> dict[str, Any]:
    """Returns what the declared kinematic rule says of a pair, before anything moves, as plain data."""
    verdict = reach(pair)
    return {
        "reachable": verdict.reachable,
        "reason": verdict.reason,
        "margin_rad": verdict.margin_rad,
        "parts": [{"subtask": part.subtask, "what": part.what, "reason": part.reason} for part in verdict.parts],
    }
