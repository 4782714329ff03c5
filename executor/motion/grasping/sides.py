"""From which sides the arm has room over a place: those from which it never had any are looked at last."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator

import numpy as np

from executor.motion.planning.contacts import GRIPPER, HELD
from executor.motion.planning.oracle import Hit
from executor.motion.stances.candidates import HandGoal, Placement

ENOUGH_MET = 12
"""After so many postures that met something with the arm, and none that did not, a side counts as taken."""


class Sides:
    """What was seen of each heading: a bowl near one edge of a table is reached over that edge alone."""

    def __init__(self) -> None:
        self._met: Counter[tuple[str, float]] = Counter()
        self._free: set[tuple[str, float]] = set()

    def learn(self, goal: HandGoal, hits: list[Hit]) -> None:
        """Takes note of what a posture at a hand pose met; what the hand alone meets says nothing about its side."""
        if not hits:
            self._free.add(_side(goal))
        elif any(hit.mover not in GRIPPER and hit.mover != HELD for hit in hits):
            self._met[_side(goal)] += 1

    def is_taken(self, goal: HandGoal) -> bool:
        """Decides whether the arm has met something in all of many postures from this side."""
        side = _side(goal)
        return side not in self._free and self._met[side] >= ENOUGH_MET

    def roomy_first(self, candidates: Iterable[Placement]) -> Iterator[Placement]:
        """Yields candidates in their order, those from sides that count as taken when their turn comes last."""
        waiting: list[Placement] = []
        for candidate in candidates:
            if self.is_taken(candidate.goal):
                waiting.append(candidate)
            else:
                yield candidate
        yield from waiting


def _side(goal: HandGoal) -> tuple[str, float]:
    return goal.region, float(np.round(np.mod(goal.heading_rad, 2 * np.pi), 2))
