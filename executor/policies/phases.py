"""Which step of an episode's plan goes on: as the policy foretells it, and as what its hand shows allows it.

A plan says that GRASP begins with the hand at its place, and ends with something between the fingers. So GRASP and what
goes before it count as left only where what shows of a grasp (`features.grasp_numbers`) is as it was wherever
demonstrations had left them; and fingers that shut on nothing begin anew at the APPROACH. No contact and no detector is
asked: it is what the policy sees anyway.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from executor.policies.features import Numbers
from executor.policies.trained import PolicyRecord
from oag.model.primitives import Primitive

OPENING_SLACK_M, NEAR_SLACK_M = 0.003, 0.01
"""How far beyond what demonstrations showed is as good at least: fingers give by less around what they hold; from so
much farther away they still close around a handle."""

_SLACK_SHARE = 0.25  # The same of what demonstrations differ by: where they differ much, it does not matter.

_APPROACH, _GRASP, _LETS_GO = (one.value for one in (Primitive.APPROACH, Primitive.GRASP, Primitive.UNGRASP))


class PlanFollower:
    """Follows the plan of one episode after the other.

    Args:
        record: The policy that acts.
    """

    def __init__(self, record: PolicyRecord) -> None:
        self._known, self._takeovers = record.primitives, record.takeovers
        least, most = record.left
        least_slack_m = np.full(least.shape[-1], NEAR_SLACK_M)
        least_slack_m[:1] = OPENING_SLACK_M
        slack_m = np.maximum(least_slack_m, _SLACK_SHARE * (most - least))
        self._least, self._most = least - slack_m, most + slack_m
        self._plan: list[int] = []
        self._stage = self._first = 0
        self._foretold: NDArray | None = None

    @property
    def phase(self) -> int:
        """Which of the primitives that the policy knows goes on."""
        return self._plan[self._stage]

    def begin(self, plan: Sequence[int]) -> None:
        """Begins an episode with the numbers of its plan's primitives, in order."""
        known = self._known
        self._plan = [known.index(number) for number in plan if number in known] or [0]
        self._first = 0
        if self._takeovers:
            # What the planner begins with where it takes over from a robot that has closed its hand on something else,
            # or leans on something: no plan begins so.
            before = [number for number in known if number == _LETS_GO or number not in plan]
            self._plan = [*map(known.index, before), *self._plan]
            self._first = len(before)
        self._stage, self._foretold = self._first, None

    def foretell(self, logits: NDArray) -> None:
        """Takes note of what the policy foretells to go on when it looks again: (P,), the likeliest the largest."""
        self._foretold = logits

    def go_on(self, shown: Numbers) -> None:
        """Takes the step of the plan that goes on now.

        It is the next one where that was foretold to be likelier than the present one, and so on. One that has seen
        what the planner does where a policy went astray also goes back: to the latest earlier step of the kind that was
        the likeliest of all.

        Args:
            shown: (G,) what now shows of a grasp.
        """
        if self._foretold is None:
            return
        foreseen = self._foreseen(self._foretold)
        if (missed := self._missed(foreseen, shown)) is not None:
            self._stage = missed
            return
        if foreseen < self._stage:
            self._stage = foreseen
        while self._stage < foreseen and self._may_leave(self._stage, shown):
            self._stage += 1

    def _may_leave(self, stage: int, shown: Numbers) -> bool:
        """Decides whether a step of the plan, that another one follows, is done as far as a grasp shows it."""
        now, following = self._plan[stage], self._plan[stage + 1]
        if _GRASP not in (self._known[now], self._known[following]):
            return True
        return bool(((self._least[now] <= shown) & (shown <= self._most[now])).all())

    def _missed(self, foreseen: int, shown: Numbers) -> int | None:
        """Returns the step of the APPROACH to a grasp that should hold by now, and shut on nothing."""
        numbers = [self._known[phase] for phase in self._plan[: max(foreseen, self._stage)]]
        grasped = next((at for at in reversed(range(len(numbers))) if numbers[at] in (_GRASP, _LETS_GO)), None)
        if grasped is None or numbers[grasped] == _LETS_GO or shown[0] >= self._least[self._plan[grasped], 0]:
            return None
        return next((at for at in reversed(range(grasped)) if numbers[at] == _APPROACH), None)

    def _foreseen(self, logits: NDArray) -> int:
        """Returns which step goes on, as it was foretold."""
        begun, foreseen, likeliest = self._stage, self._stage, int(np.argmax(logits))
        for now, following in pairwise(self._plan[begun:] if begun >= self._first else ()):
            if logits[following] <= logits[now]:
                break
            foreseen += 1
        if foreseen != begun or not self._takeovers or likeliest == self._plan[begun]:
            return foreseen
        places = [place for place, kind in enumerate(self._plan) if kind == likeliest]
        if begun < self._first:
            return places[0]
        earlier = [place for place in places if place < begun]
        return earlier[-1] if earlier else begun
