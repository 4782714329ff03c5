"""Which step of an episode's plan goes on: as the policy foretells it, and as what it sees allows it.

A plan says that GRASP begins with the hand at its place, and ends with something between the fingers; and that a door
is open when it was opened. So drives, GRASP, what goes before it, and what opens and shuts count as done only where
what shows of that (`features.shown_numbers`) is as it was wherever demonstrations had left them. Fingers that shut on
nothing begin anew at the APPROACH, and so does who may not go on at a grasp for a while, as with what is held crooked.
Drives that are held back for as long, doors that come no farther, and hands that open no wider are left; what takes far
longer than demonstrations took for it counts as held back; and where the whole plan has left a door less open than it
should be, it begins anew. Who has learned from corrections always begins anew as the planner does that made them: with
an empty hand, from wherever it is. No contact and no detector is asked: it is what the policy sees anyway.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from executor.policies.seen.features import Numbers
from executor.policies.steps import DRIVES, primitive_of, subtask_of
from executor.policies.trained import PolicyRecord
from oag.model.primitives import Primitive

OPENING_SLACK_M, NEAR_SLACK_M, OPEN_SLACK = 0.01, 0.02, 0.05
"""How far beyond what demonstrations showed is as good at least: by so much do fingers give, or stand farther apart
around what they hold askew; from so much farther away they still close around a handle of 2 cm; and so much of its
range less open is a door as open."""

PATIENCE_S = 2.0
"""For how long it is not let go on where it would: fingers close in half a second."""

OVERDUE = 2.0
"""So many times as long as nearly all demonstrations took for a step, at least `PATIENCE_S`, and the network has lost
its way in it: it stands beside where they drove to, or presses fingers apart that are jammed."""

BACK_S = 3.0
"""After so long in the last step the hand is back where plans begin."""

EMPTY_SHARE = 0.5
"""Of the least that fingers were apart behind a grasp: with less they have shut on nothing. What they hold is as thick,
and a door that swings presses them together by a fifth."""

_SLACK_SHARE = 0.25  # The same of what demonstrations differ by: where they differ much, it does not matter.

_MOVES_DOORS = (Primitive.ARTICULATE_OPEN, Primitive.ARTICULATE_CLOSE)
_LEFT_AS_IT_IS = (*_MOVES_DOORS, *DRIVES, Primitive.UNGRASP)  # What is held back here is not begun anew.


class PlanFollower:
    """Follows the plan of one episode after the other.

    Args:
        record: The policy that acts.
        execute: How many actions it does before it looks again.
    """

    def __init__(self, record: PolicyRecord, execute: int) -> None:
        self._known, self._takeovers = record.steps, record.takeovers
        self._kinds = [primitive_of(step) for step in record.steps]
        least, most = record.left
        self._empty_m = EMPTY_SHARE * least[:, 0]
        sees = record.settings.sees
        places = 3 * (sees.things + sees.handles) if sees.places else 0
        self._of_grasps, self._of_doors = slice(0, 1 + places), slice(1 + places, None)
        least_slack = np.full(least.shape[-1], NEAR_SLACK_M)
        least_slack[:1], least_slack[self._of_doors] = OPENING_SLACK_M, OPEN_SLACK
        slack = np.maximum(least_slack, _SLACK_SHARE * (most - least))
        self._least, self._most = least - slack, most + slack
        # A door that was opened farther than demonstrations open it, between two looks, is open.
        for phase, kind in enumerate(self._kinds if sees.phase else ()):
            if kind is Primitive.ARTICULATE_OPEN:
                self._most[phase, self._of_doors] = np.inf
            elif kind is Primitive.ARTICULATE_CLOSE:
                self._least[phase, self._of_doors] = -np.inf
        self._plan: list[int] = []
        self._foretold: NDArray | None = None
        self._looks_a_second = record.rate_hz / execute
        self._most_looks = np.maximum(OVERDUE * record.longest_s, PATIENCE_S) * self._looks_a_second
        self._stage = self._first = self._held_back = self._looks = self._anew = 0

    @property
    def phase(self) -> int:
        """Which of the steps that the policy knows goes on."""
        return self._plan[self._stage]

    @property
    def anew(self) -> int:
        """How often it has begun anew in this episode."""
        return self._anew

    def begin(self, plan: Sequence[int]) -> None:
        """Begins with the numbers of a plan's steps, in order."""
        known = self._known
        self._plan = [known.index(number) for number in plan if number in known] or [0]
        self._first = 0
        if self._takeovers:
            # What the planner begins with where it takes over from a robot that has closed its hand on something else,
            # or leans on something: no plan begins so.
            own = [
                (step, kind)
                for step, kind in zip(known, self._kinds, strict=True)
                if subtask_of(step) == subtask_of(known[self._plan[0]])
            ]
            before = [step for step, kind in own if kind is Primitive.UNGRASP or step not in plan]
            self._plan = [*map(known.index, before), *self._plan]
            self._first = len(before)
        self._stage, self._foretold, self._held_back, self._looks, self._anew = self._first, None, 0, 0, 0

    def foretell(self, logits: NDArray) -> None:
        """Takes note of what the policy foretells to go on when it looks again: (P,), the likeliest the largest."""
        self._foretold = logits

    def go_on(self, now: NDArray, shown: Numbers) -> None:
        """Takes the step of the plan that goes on now.

        It is the next one where that is likelier than the present one, and so on: as it was foretold, since how long
        fingers rest is not seen, or as it looks now, since a hand that has arrived would go on into what it came for.

        Args:
            now: (P,) how likely each is to go on with the next action, the likeliest the largest.
            shown: (G,) what now shows how far it has come.
        """
        began, self._looks = self._stage, self._looks + 1
        is_last = self._stage == len(self._plan) - 1
        if is_last and self._looks > BACK_S * self._looks_a_second and not self._doors_are_open(shown):
            self._begin_anew(self._first)
            return
        foreseen = max(self._ahead(logits) for logits in (now, self._foretold) if logits is not None)
        if (missed := self._missed(foreseen, shown)) is not None:
            self._begin_anew(missed)
            return
        is_overdue = not is_last and self._looks > self._most_looks[self.phase]
        if is_overdue:
            foreseen = max(foreseen, self._stage + 1)
        while self._stage < foreseen and self._may_leave(self._stage, shown):
            self._stage += 1
        self._held_back = self._held_back + 1 if self._stage < foreseen else 0
        if self._held_back and (is_overdue or self._held_back > PATIENCE_S * self._looks_a_second):
            if self._kinds[self.phase] in _LEFT_AS_IT_IS:
                self._stage, self._held_back = self._stage + 1, 0
            else:
                self._begin_anew(self._approach_before(self._stage))
        self._looks = self._looks if self._stage == began else 0

    def _begin_anew(self, stage: int) -> None:
        """Begins anew at a step of the plan; one that has learned from corrections, where its subtask begins."""
        if self._takeovers:
            subtasks = [subtask_of(self._known[phase]) for phase in self._plan]
            stage = 0 if subtasks[stage] == subtasks[self._first] else subtasks.index(subtasks[stage], self._first)
        self._stage, self._held_back, self._looks = stage, 0, 0
        self._anew += 1

    def _may_leave(self, stage: int, shown: Numbers) -> bool:
        """Decides whether a step of the plan, that another one follows, is done as far as it shows."""
        now, following = self._plan[stage], self._plan[stage + 1]
        if self._kinds[now] in DRIVES or Primitive.GRASP in (self._kinds[now], self._kinds[following]):
            part = self._of_grasps
        elif self._kinds[now] in _MOVES_DOORS:
            part = self._of_doors
        else:
            return True
        return self._as_left(now, shown, part)

    def _doors_are_open(self, shown: Numbers) -> bool:
        """Decides whether doors are as open, or as shut, as the plan's last step at one had been seen to leave them."""
        moved = [phase for phase in self._plan if self._kinds[phase] in _MOVES_DOORS]
        return not moved or self._as_left(moved[-1], shown, self._of_doors)

    def _as_left(self, phase: int, shown: Numbers, part: slice) -> bool:
        return bool(((self._least[phase, part] <= shown[part]) & (shown[part] <= self._most[phase, part])).all())

    def _missed(self, foreseen: int, shown: Numbers) -> int | None:
        """Returns the step of the APPROACH to a grasp that should hold by now, and shut on nothing."""
        kinds = [self._kinds[phase] for phase in self._plan[: max(foreseen, self._stage)]]
        holding = (Primitive.GRASP, Primitive.UNGRASP)
        grasped = next((at for at in reversed(range(len(kinds))) if kinds[at] in holding), None)
        if grasped is None or kinds[grasped] is Primitive.UNGRASP or shown[0] >= self._empty_m[self._plan[grasped]]:
            return None
        return self._approach_before(grasped)

    def _approach_before(self, stage: int) -> int:
        """Returns the step of the APPROACH that leads to another one; where there is none, that one itself."""
        kinds = [self._kinds[phase] for phase in self._plan[:stage]]
        return next((at for at in reversed(range(stage)) if kinds[at] is Primitive.APPROACH), stage)

    def _ahead(self, logits: NDArray) -> int:
        """Returns the step that one gets to where each next one is likelier than the one before it.

        Of what is before the plan one thing or another is done, or nothing: what is the likeliest of it all and of what
        the plan begins with.
        """
        if self._stage < self._first:
            beginnings = range(self._stage, self._first + 1)
            return max(beginnings, key=lambda stage: logits[self._plan[stage]])
        ahead = self._stage
        for now, following in pairwise(self._plan[ahead:]):
            if logits[following] <= logits[now]:
                break
            ahead += 1
        return ahead
