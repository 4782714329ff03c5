"""Track the current phase of a plan from predicted logits, gated by observations.

GRASP begins with the hand at its place and ends with something between the fingers; after opening, a door is open. So
drives, GRASP, the step before it, and opening and shutting count as done only within bounds: the observed progress
numbers (`observations.shown_numbers`) have to be within those where demonstrations left the step.

Recovery: fingers that shut on nothing restart at APPROACH, and so does a grasp that is held back for a while, as with a
crooked object. Drives that are held back as long, doors that move no further, and hands that open no wider are skipped.
A step far longer than in demonstrations counts as held back. Where the whole plan has left a door less open than it
should be, the plan restarts. Policies trained on corrections restart like the planner that made these: with an empty
hand, from the current pose. Neither contacts nor detectors are used: only the policy's own observations.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from executor.learn.observations import DRIVES, Numbers, primitive_of, subtask_of
from executor.learn.policy_record import PolicyRecord
from oag.model.symbols import Primitive

OPENING_SLACK_M, NEAR_SLACK_M, OPEN_SLACK = 0.01, 0.02, 0.05
"""Minimum slack of exit bounds. Fingers give by the first, or are farther apart around a crooked item. From the second
farther away they still close around a handle of 2 cm. The third is a share of a door's range."""

PATIENCE_S = 2.0
"""Time for which a step may be held back before recovery: fingers close in half a second."""

OVERDUE = 2.0
"""Treat a phase as stuck after twice the longest demonstrated duration, at least `PATIENCE_S`. The robot then stands
next to the demonstrated place, or presses jammed fingers apart."""

BACK_S = 3.0
"""Time in the last step after which the hand is back at the start of plans."""

EMPTY_SHARE = 0.5
"""Share of the minimum finger opening after a grasp, below which the hand is empty. A held thing keeps the opening, and
a swinging door presses the fingers together by a fifth."""

_SLACK_SHARE = 0.25  # Slack as a share of the demonstrations' range: a quantity with a wide range matters little.

_MOVES_DOORS = (Primitive.ARTICULATE_OPEN, Primitive.ARTICULATE_CLOSE)
_SKIPPED_WHEN_STUCK = (
    *_MOVES_DOORS,
    *DRIVES,
    Primitive.UNGRASP,
)  # Held-back steps of these are skipped, not restarted.


class PlanFollower:
    """Tracks the phase of one episode's plan after the other.

    Args:
        execute: Number of executed actions between observations.
    """

    def __init__(self, record: PolicyRecord, execute: int) -> None:
        self._known, self._takeovers = record.steps, record.takeovers
        self._kinds = [primitive_of(step) for step in record.steps]
        least, most = record.exit_bounds
        self._empty_m = EMPTY_SHARE * least[:, 0]
        sees = record.settings.sees
        places = 3 * (sees.things + sees.handles) if sees.places else 0
        self._of_grasps, self._of_doors = slice(0, 1 + places), slice(1 + places, None)
        least_slack = np.full(least.shape[-1], NEAR_SLACK_M)
        least_slack[:1], least_slack[self._of_doors] = OPENING_SLACK_M, OPEN_SLACK
        slack = np.maximum(least_slack, _SLACK_SHARE * (most - least))
        self._least, self._most = least - slack, most + slack
        # A door opened wider than demonstrated, between two observations, is open.
        for phase, kind in enumerate(self._kinds if sees.phase else ()):
            if kind is Primitive.ARTICULATE_OPEN:
                self._most[phase, self._of_doors] = np.inf
            elif kind is Primitive.ARTICULATE_CLOSE:
                self._least[phase, self._of_doors] = -np.inf
        self._plan: list[int] = []
        self._predicted: NDArray | None = None
        self._looks_a_second = record.rate_hz / execute
        self._most_looks = np.maximum(OVERDUE * record.longest_s, PATIENCE_S) * self._looks_a_second
        self._stage = self._first = self._held_back = self._looks = self._restarts = 0

    @property
    def phase(self) -> int:
        """Index of the running step among the policy's steps."""
        return self._plan[self._stage]

    @property
    def restarts(self) -> int:
        """Number of restarts in this episode."""
        return self._restarts

    def begin(self, plan: Sequence[int]) -> None:
        """Begin with the step numbers of a plan, in order."""
        known = self._known
        self._plan = [known.index(number) for number in plan if number in known] or [0]
        self._first = 0
        if self._takeovers:
            # First steps of the planner where it takes over from a robot that has closed its hand on something else,
            # or leans on something: no plan begins with these.
            own = [
                (step, kind)
                for step, kind in zip(known, self._kinds, strict=True)
                if subtask_of(step) == subtask_of(known[self._plan[0]])
            ]
            before = [step for step, kind in own if kind is Primitive.UNGRASP or step not in plan]
            self._plan = [*map(known.index, before), *self._plan]
            self._first = len(before)
        self._stage, self._predicted, self._held_back, self._looks, self._restarts = self._first, None, 0, 0, 0

    def note_prediction(self, logits: NDArray) -> None:
        """Note the predicted logits (P,) of the step at the next observation."""
        self._predicted = logits

    def go_on(self, now: NDArray, shown: Numbers) -> None:
        """Update the running step.

        The step advances while the next one is likelier than the present one. Both predictions count: the earlier one,
        since the duration of a grasp is not observable, and the present one, since a hand that has arrived would
        otherwise overshoot.

        Args:
            now: (P,) logits of the step at the next action.
            shown: (G,) the observed progress numbers.
        """
        began, self._looks = self._stage, self._looks + 1
        is_last = self._stage == len(self._plan) - 1
        if is_last and self._looks > BACK_S * self._looks_a_second and not self._doors_are_open(shown):
            self._restart(self._first)
            return
        foreseen = max(self._ahead(logits) for logits in (now, self._predicted) if logits is not None)
        if (missed := self._missed(foreseen, shown)) is not None:
            self._restart(missed)
            return
        is_overdue = not is_last and self._looks > self._most_looks[self.phase]
        if is_overdue:
            foreseen = max(foreseen, self._stage + 1)
        while self._stage < foreseen and self._may_exit(self._stage, shown):
            self._stage += 1
        self._held_back = self._held_back + 1 if self._stage < foreseen else 0
        if self._held_back and (is_overdue or self._held_back > PATIENCE_S * self._looks_a_second):
            if self._kinds[self.phase] in _SKIPPED_WHEN_STUCK:
                self._stage, self._held_back = self._stage + 1, 0
            else:
                self._restart(self._approach_before(self._stage))
        self._looks = self._looks if self._stage == began else 0

    def _restart(self, stage: int) -> None:
        """Restart at a step of the plan; a policy trained on corrections, where its subtask begins."""
        if self._takeovers:
            subtasks = [subtask_of(self._known[phase]) for phase in self._plan]
            stage = 0 if subtasks[stage] == subtasks[self._first] else subtasks.index(subtasks[stage], self._first)
        self._stage, self._held_back, self._looks = stage, 0, 0
        self._restarts += 1

    def _may_exit(self, stage: int, shown: Numbers) -> bool:
        """Decide whether a step, before its successor, is done as far as observable."""
        now, following = self._plan[stage], self._plan[stage + 1]
        if self._kinds[now] in DRIVES or Primitive.GRASP in (self._kinds[now], self._kinds[following]):
            part = self._of_grasps
        elif self._kinds[now] in _MOVES_DOORS:
            part = self._of_doors
        else:
            return True
        return self._within_exit_bounds(now, shown, part)

    def _doors_are_open(self, shown: Numbers) -> bool:
        """Decide whether doors are as open, or as shut, as demonstrations left the plan's last step at one."""
        moved = [phase for phase in self._plan if self._kinds[phase] in _MOVES_DOORS]
        return not moved or self._within_exit_bounds(moved[-1], shown, self._of_doors)

    def _within_exit_bounds(self, phase: int, shown: Numbers, part: slice) -> bool:
        return bool(((self._least[phase, part] <= shown[part]) & (shown[part] <= self._most[phase, part])).all())

    def _missed(self, foreseen: int, shown: Numbers) -> int | None:
        """Return the APPROACH step of a grasp that should hold by now, and shut on nothing; else None."""
        kinds = [self._kinds[phase] for phase in self._plan[: max(foreseen, self._stage)]]
        holding = (Primitive.GRASP, Primitive.UNGRASP)
        grasped = next((at for at in reversed(range(len(kinds))) if kinds[at] in holding), None)
        if grasped is None or kinds[grasped] is Primitive.UNGRASP or shown[0] >= self._empty_m[self._plan[grasped]]:
            return None
        return self._approach_before(grasped)

    def _approach_before(self, stage: int) -> int:
        """Return the APPROACH step that leads to another one; without one, that step itself."""
        kinds = [self._kinds[phase] for phase in self._plan[:stage]]
        return next((at for at in reversed(range(stage)) if kinds[at] is Primitive.APPROACH), stage)

    def _ahead(self, logits: NDArray) -> int:
        """Return the step that is reached while each next one is likelier than the one before it.

        Before the plan's first step, one of the preparing steps may run, or none: the likeliest of them and of the
        plan's first.
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
