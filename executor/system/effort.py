"""Effort of planning: every query, posture and line counts, so that a search ends with an answer however it loops.

Effort is counted in seconds that the work takes on an idle machine, and not measured: equal searches end alike on every
machine.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from bddl.errors import Scene2DemoError

QUERY_S = 2e-4  # One configuration put to the engine.
CANDIDATE_S = 3e-5  # One candidate answered from what is known.
POSTURE_S = 2e-4  # One start of the inverse kinematics.
LINE_STEP_S = 1e-4  # One Newton step along a line of hand poses.
NAMED = 3
OBSTRUCTED = 0.1
"""Of the configurations. What stands close before a thing was met in 3 to 26 %, what stands beside it in 2 to 7 %.

Then another grasp is found in less than it takes to move anything.
"""


class SearchExhausted(Scene2DemoError):
    """A search was given up: it took as much effort as it may.

    Attributes:
        looked_at: How many configurations were looked at.
        met: The pairs that met in them most often, with counts.
    """

    def __init__(self, looked_at: int, met: dict[str, int]) -> None:
        super().__init__(f"the search was given up after {looked_at} configurations")
        self.looked_at, self.met = looked_at, met


class Obstructed(SearchExhausted):
    """A search was given up early: what could be moved aside was met in many configurations."""


class Effort:
    """A count of effort, with a limit where one is set.

    Attributes:
        spent_s: Effort so far.
        queries: How many configurations were looked at so far.
        met: While a limit is set: which pairs met in how many of them, the robot's own parts left out.
    """

    def __init__(self) -> None:
        self.spent_s = 0.0
        self.queries = 0
        self.met: Counter[str] = Counter()
        self._limit_s = math.inf
        self._since = 0
        self._patience_s = math.inf
        self._obstructing: Callable[[str], bool] = lambda _: False

    def add(self, seconds: float) -> None:
        """Count some effort.

        Raises:
            SearchExhausted: The limit is exceeded.
        """
        self.spent_s += seconds
        if self.spent_s > self._limit_s:
            raise SearchExhausted(self.queries - self._since, dict(self.met.most_common(NAMED)))
        if self.spent_s > self._patience_s:
            self._patience_s, looked_at = math.inf, self.queries - self._since
            met = {pair: count for pair, count in self.met.most_common() if self._obstructing(pair)}
            if met and max(met.values()) >= OBSTRUCTED * looked_at:
                raise Obstructed(looked_at, met)

    @contextmanager
    def impatient(self, patience_s: float, obstructing: Callable[[str], bool]) -> Iterator[None]:
        """Raise `Obstructed` within the block once some effort was in vain, if what obstructs was met often.

        Args:
            patience_s: The effort [s].
            obstructing: Whether one of a pair that met could be moved aside.
        """
        if math.isinf(patience_s):
            yield
            return
        before = self._since, self.met
        outer = self._patience_s, self._obstructing
        self._since, self.met = self.queries, Counter()
        self._patience_s, self._obstructing = self.spent_s + patience_s, obstructing
        try:
            yield
        finally:
            since, met = before
            self._since, self.met = since, met + self.met
            self._patience_s, self._obstructing = outer

    @contextmanager
    def limited(self, most_s: float) -> Iterator[None]:
        """Limit the effort within the block; an outer limit goes on counting.

        Args:
            most_s: The limit [s].
        """
        before = self._limit_s, self._since, self.met
        self._limit_s = min(self._limit_s, self.spent_s + most_s)
        self._since, self.met = self.queries, Counter()
        try:
            yield
        finally:
            self._limit_s, self._since, self.met = before
