"""Diagnose a failed attempt: its root cause, causes in earlier subtasks, and failures that no flow corrects.

The root cause is the earliest step that the critiques find fault with, together with what was measured there.

The cause may lie in an earlier subtask that was reached at the time. An item grasped off its middle slips while
it is carried; a door opened too little lets no hand in; an item too near to the front keeps a door from closing.
Measurements of that time show it.

No flow helps where something would have to be measured again, pressed harder, or removed although it is unknown.
The library's primitives move hand and base and set joint limits only. A single loss of grip does not distinguish
weak fingers from a door that met something; a second one at the same place does.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from enum import Enum
from typing import TypeVar

from llm.evolve.flow_edits import last_up_to
from llm.evolve.observation import GiveUp, Situation
from oag import Primitive, SimpleTask, Task
from oag.measurements import (
    AtomMeasured,
    FollowedInPart,
    GripMeasured,
    HandMeasured,
    JointMotion,
    MeasuredEvidence,
    Measurement,
    Measurements,
    Miss,
    MoveMeasured,
    OutOfReach,
    SupportDrive,
    UnmeantContact,
    Unplanned,
    first_of,
)
from oag.model.symbols import ARTICULATIONS
from oag.revision import Attempt, Critique, History


class CauseKind(Enum):
    """Kinds of failure; the value is the cause in a few words."""

    JOINT_SHORT = "the joint limits end too early"
    JOINT_STALLED = "the joint did not follow to where it was asked"
    OUT_OF_REACH = "out of reach"
    NOWHERE = "the moves' numbers lead to no free place from anywhere"
    BLOCKED = "something is in the way"
    MISPLACED = "let go beside its place"
    STILL_TOUCHED = "the hand still touches what it let go of"
    GRASP_MISSED = "the fingers missed"
    TOO_WIDE = "too wide for the gripper"
    GRIP_LOST = "the grip was lost"
    NO_WAY = "no free way"
    DISPLACED = "something else was moved"
    OUT_OF_ORDER = "a step came out of place"
    TOO_LONG = "it took longer than a step may"
    HELD_BADLY = "the item was taken badly"
    OPENED_LITTLE = "the door was opened too little"
    IN_THE_WAY = "the item was left in the door's way"
    UNKNOWN = "not clear"


# Cause assigned to a step of an earlier subtask after a later one failed because of it.
_IN_HINDSIGHT = {
    Primitive.GRASP: CauseKind.HELD_BADLY,
    Primitive.ARTICULATE_OPEN: CauseKind.OPENED_LITTLE,
    Primitive.UNGRASP: CauseKind.IN_THE_WAY,
}
_BY_FAILURE = {
    "unreachable": CauseKind.OUT_OF_REACH,
    "no-collision-free-path": CauseKind.NO_WAY,
    "no-answer-in-time": CauseKind.NO_WAY,
    "grasp-missed": CauseKind.GRASP_MISSED,
    "too-wide-for-gripper": CauseKind.TOO_WIDE,
    "slipped": CauseKind.GRIP_LOST,
    "dropped": CauseKind.GRIP_LOST,
    "unexpected-contact": CauseKind.BLOCKED,
    "side-effect": CauseKind.DISPLACED,
    "precondition": CauseKind.OUT_OF_ORDER,
    "timeout": CauseKind.TOO_LONG,
}


@dataclass(frozen=True, slots=True)
class FailureCause:
    """Cause of a failed attempt.

    Attributes:
        kind: Kind of failure.
        step: Index of the step with the cause.
        words: The critique's diagnosis.
        grounds: Evidence of that critique.
        until_then: Measurements of all steps up to this one, in order: an earlier one may explain the failure.
        misses: Distances of items from their goals.
        stopped: Whether several attempts ended at the same place, so that there must be an obstacle.
    """

    kind: CauseKind
    step: int
    words: str
    grounds: MeasuredEvidence = field(default_factory=MeasuredEvidence)
    until_then: Measurements = ()
    misses: tuple[Miss, ...] = ()
    stopped: bool = False

    @property
    def joint(self) -> JointMotion | None:
        """Motion of the joint, if the step moved one."""
        return first_of(self._own, JointMotion)

    @property
    def move(self) -> MoveMeasured | None:
        """The straight move, if the step was one."""
        return first_of(self._own, MoveMeasured)

    @property
    def grip(self) -> GripMeasured | None:
        """Measurement of the grip, if the step closed the fingers."""
        return first_of(self._own, GripMeasured)

    @property
    def contact(self) -> UnmeantContact | None:
        """Contact that ended the step."""
        return first_of(self._own, UnmeantContact)

    @property
    def unplanned(self) -> Unplanned | None:
        """Obstacle to planning, if no plan was found."""
        return first_of(self._own, Unplanned)

    @property
    def residual_m(self) -> float | None:
        """Remaining distance of the hand [m]."""
        kinds = OutOfReach | FollowedInPart | Unplanned | HandMeasured
        known = (record.residual_m for record in self._own if isinstance(record, kinds))
        return next((residual_m for residual_m in known if residual_m is not None), None)

    @property
    def base_error_m(self) -> float | None:
        """Distance of the base from its goal [m]."""
        return self._latest(SupportDrive, lambda drive: drive.beside_m)

    @property
    def leaning_deg(self) -> float | None:
        """Tilt of the held object [deg]."""
        return self._latest(SupportDrive, lambda drive: drive.leaning_deg)

    @property
    def was_planned(self) -> bool:
        """Whether planning chose the base's stance for the flow's own moves, or the object is in some place."""
        planned = self._latest(SupportDrive, lambda drive: drive.region) is not None
        return planned or any(unmet.measurements.region is not None for unmet in self.grounds.unmet)

    @property
    def off_the_aim_m(self) -> tuple[float, float]:
        """Offset of the target from the aim: forward and left [m]."""
        hand = self._latest(HandMeasured, lambda hand: hand if hand.target_left_m is not None else None)
        return (0.0, 0.0) if hand is None else (hand.target_forward_m or 0.0, hand.target_left_m or 0.0)

    @property
    def held_off_m(self) -> tuple[float, float]:
        """Offset of the object from its place in the hand: forward and left [m]."""
        grip = self._latest(GripMeasured, lambda grip: grip if grip.held_left_m is not None else None)
        return (0.0, 0.0) if grip is None else (grip.held_forward_m or 0.0, grip.held_left_m or 0.0)

    @property
    def fingers_touching(self) -> float | None:
        """Number of fingers that touch the object, by the goal's reading or the grasp's own."""
        read = self._unmet(lambda measured: measured.fingers_touching)
        return read if read is not None else None if self.grip is None else self.grip.fingers_touching

    @property
    def open_fraction(self) -> float | None:
        """Opening fraction of a door that the goal wants otherwise."""
        return self._unmet(lambda measured: measured.open_fraction)

    @property
    def _own(self) -> Measurements:
        return (*self.grounds.failure_measurements, *(self.grounds.measurements or ()))

    def _latest(self, kind: type[_Kind], read: Callable[[_Kind], _Read | None]) -> _Read | None:
        found = (read(record) for record in reversed(self.until_then) if isinstance(record, kind))
        return next((value for value in found if value is not None), None)

    def _unmet(self, read: Callable[[AtomMeasured], float | None]) -> float | None:
        found = (read(unmet.measurements) for unmet in reversed(self.grounds.unmet))
        return next((value for value in found if value is not None), None)


_Kind = TypeVar("_Kind", bound=Measurement)
_Read = TypeVar("_Read")


def diagnose(attempt: Attempt) -> FailureCause | None:
    """Return the root cause of a failed attempt; None when no critique finds fault."""
    critique = next((critique for critique in attempt.critiques if critique.finds_fault), None)
    if critique is None:
        return None
    kind = _kind(critique)
    if attempt.hindsight is not None:
        kind = _IN_HINDSIGHT.get(critique.primitive, kind)
    # If a navigation is the cause, the miss is measured at a later step.
    later = (other.evidence.misses for other in attempt.critiques if other.step >= critique.step)
    return replace(cause_at(attempt, critique.step, kind), misses=next((misses for misses in later if misses), ()))


def cause_at(attempt: Attempt, step: int, kind: CauseKind) -> FailureCause:
    """Return a step of an attempt as a cause, with the measurements there and before."""
    critique = next((critique for critique in attempt.critiques if critique.step == step), None)
    earlier = (other.evidence.measurements or () for other in attempt.critiques if other.step <= step)
    until_then = tuple(record for records in earlier for record in records)
    if critique is None:
        return FailureCause(kind, step, "", until_then=until_then)
    return FailureCause(kind, step, critique.text, critique.evidence, until_then)


def _kind(critique: Critique) -> CauseKind:
    failure = critique.evidence.failure
    primitive = critique.primitive
    if failure in ("stalled", "unexpected-contact") and primitive is Primitive.CONVERGE:
        # Fingers that move onto the object may touch it and stop there; the palm may not.
        return CauseKind.GRASP_MISSED
    if failure == "stalled":
        return CauseKind.JOINT_STALLED if primitive in ARTICULATIONS else CauseKind.BLOCKED
    if failure == "dropped" and primitive is Primitive.UNGRASP:
        return CauseKind.MISPLACED
    if failure:
        return _BY_FAILURE.get(failure, CauseKind.UNKNOWN)
    if primitive in ARTICULATIONS and critique.state_reached is False:
        return CauseKind.JOINT_SHORT
    if primitive is Primitive.NAVIGATE_TO_SUPPORT:
        return CauseKind.NOWHERE
    touching = [one.measurements.fingers_touching for one in critique.evidence.unmet]
    if primitive is Primitive.UNGRASP and touching and all(count in (1, 2) for count in touching):
        return CauseKind.STILL_TOUCHED
    if critique.evidence.misses:
        return CauseKind.MISPLACED
    return CauseKind.GRASP_MISSED if primitive is Primitive.GRASP else CauseKind.UNKNOWN


TIMES = 2
"""Number of attempts that have to end in the same way before that counts as established."""

# Two final positions of a door that differ by less are equal: readings of a joint at rest are much finer.
SAME_PLACE = 0.01
AJAR = (0.03, 0.1)
"""Between these fractions of its range a door that meets something is open by too little for a hand to go in; before
them it has not come off its gasket."""

_LOST = frozenset({CauseKind.GRIP_LOST, CauseKind.JOINT_STALLED})
_NO_ACCESS = frozenset({CauseKind.NO_WAY, CauseKind.NOWHERE, CauseKind.OUT_OF_REACH, CauseKind.BLOCKED})


def find_unfixable(situation: Situation) -> GiveUp | None:
    """Return why no flow of the library corrects a failure; None while that is not evident."""
    cause = diagnose(situation.attempt)
    if cause is None:
        return None
    target = situation.task.subtasks[situation.subtask].target
    if cause.kind is CauseKind.TOO_WIDE:
        needed = "a narrower thing, or its size measured anew, and no primitive does either"
        return _hopeless(situation.attempt.message, needed, cause.kind)
    if cause.kind in _LOST and situation.attempt.flow[cause.step].primitive in ARTICULATIONS:
        tried = _attempts(situation.history.add(situation.attempt))
        joints = [lost.joint for lost in _lost_openings(tried)]
        if len(joints) < TIMES or any(joint is None or joint.fraction_reached >= AJAR[0] for joint in joints):
            return None
        why = f"the fingers slid off {target} before it was ajar, in {len(joints)} attempts"
        return _hopeless(why, "fingers that press harder, and no primitive sets their force", cause.kind)
    for earlier in situation.earlier if cause.kind in _NO_ACCESS else ():
        place = stopped_at(_attempts(earlier))
        if place is not None:
            fixture = situation.task.subtasks[earlier.subtask].target
            why = (
                f"the door of {fixture} ends at {place:.2f} of its range however far it is to be opened, which lets no"
            )
            needed = "a free door, and no primitive takes away what nobody knows of"
            return _hopeless(f"{why} hand in", needed, CauseKind.OPENED_LITTLE)
    return None


def _hopeless(why: str, needed: str, cause: CauseKind) -> GiveUp:
    return GiveUp(f"no flow of the library corrects this: {why}; it would take {needed}", cause.value, needed)


def _attempts(history: History) -> list[Attempt]:
    return [attempt for attempt, _ in history.iterations]


def _lost_openings(attempts: Sequence[Attempt]) -> Iterator[FailureCause]:
    """Yield the causes of the attempts in which a joint did not open as far as requested."""
    for attempt in attempts:
        cause = diagnose(attempt)
        opening = cause is not None and attempt.flow[cause.step].primitive is Primitive.ARTICULATE_OPEN
        if cause is not None and opening and cause.kind in _LOST:
            yield cause


def stopped_at(attempts: Sequence[Attempt]) -> float | None:
    """Return the fraction of its range at which a door stopped in several attempts, ajar; None if it did not."""
    reached = [cause.joint.fraction_reached for cause in _lost_openings(attempts) if cause.joint is not None]
    if len(reached) < TIMES or not all(AJAR[0] <= place <= AJAR[1] for place in reached):
        return None
    return max(reached) if max(reached) - min(reached) <= SAME_PLACE else None


def mark_stopped(cause: FailureCause, attempts: Sequence[Attempt]) -> FailureCause:
    """Return a cause with `stopped` set if several attempts ended at the same joint position."""
    stopped = cause.kind in _LOST and stopped_at(attempts) is not None
    return replace(cause, stopped=True) if stopped else cause


GRASP_OFFSET_M = 0.006
"""Grasp offset from which an item counts as held badly; it is then the first cause to consider."""

LEANING_DEG = 10.0
"""Tilt between the fingers from which an object may be impossible to place."""

WEAK_N = 10.0
"""Grip force far below that of a sound gripper."""

WIDE_ENOUGH = 0.6
"""Opening fraction from which a door does not keep the robot out."""

# An item tilted in the hand fits nowhere, and is released next to its place.
_HELD = frozenset({CauseKind.GRIP_LOST, CauseKind.NOWHERE, CauseKind.MISPLACED})
_DOOR_FAILURES = frozenset(
    {CauseKind.BLOCKED, CauseKind.NOWHERE, CauseKind.NO_WAY, CauseKind.OUT_OF_REACH, CauseKind.DISPLACED}
)


@dataclass(frozen=True, slots=True)
class EarlierCause:
    """A possible cause in a step of an earlier subtask.

    Attributes:
        subtask: Index of the earlier subtask.
        cause: The step and its measurements.
        evident: Whether measurements support it; otherwise it is considered only when nothing else is left.
    """

    subtask: int
    cause: FailureCause
    evident: bool


def earlier_causes(
    task: Task, subtask: int, attempt: Attempt, cause: FailureCause, earlier: tuple[History, ...]
) -> list[EarlierCause]:
    """Return the earlier steps that may have caused a failed attempt, the evident ones first."""
    found = list(_candidates(task, subtask, attempt, cause, earlier))
    return sorted(found, key=lambda candidate: not candidate.evident)


def _candidates(
    task: Task, subtask: int, attempt: Attempt, cause: FailureCause, earlier: tuple[History, ...]
) -> Iterator[EarlierCause]:
    now = task.subtasks[subtask]
    takes = any(action.primitive is Primitive.GRASP for action in attempt.flow[: cause.step + 1])

    def latest(
        fits: Callable[[SimpleTask], bool], primitive: Primitive, kind: CauseKind
    ) -> tuple[int, FailureCause] | None:
        """Return the last step of a primitive in the latest earlier subtask that has one and fits."""
        for history in reversed(earlier):
            if history.iterations and fits(task.subtasks[history.subtask]):
                done = history.iterations[-1].attempt
                step = last_up_to(done.flow, len(done.flow) - 1, primitive)
                if step is not None:
                    return history.subtask, cause_at(done, step, kind)
        return None

    if cause.kind in _HELD and not takes:
        taken = latest(lambda task: task.target == now.target, Primitive.GRASP, CauseKind.HELD_BADLY)
        if taken is not None:
            grip = taken[1].grip or GripMeasured()
            off, force = grip.held_off_m or 0.0, grip.grip_force_n
            weak = cause.kind is CauseKind.GRIP_LOST and force is not None and force < WEAK_N
            if cause.kind is CauseKind.GRIP_LOST or off >= GRASP_OFFSET_M:
                # Planning knows the object's pose in the hand: an off-centre grasp alone explains no missing place.
                askew = cause.kind is not CauseKind.NOWHERE or (cause.leaning_deg or 0.0) >= LEANING_DEG
                yield EarlierCause(*taken, (off >= GRASP_OFFSET_M and askew) or weak)
    if cause.kind in _DOOR_FAILURES:
        places = {now.support_goal, now.support_init, now.target}
        opened = latest(lambda task: task.target in places, Primitive.ARTICULATE_OPEN, CauseKind.OPENED_LITTLE)
        if opened is not None and opened[1].joint is not None:
            reached = opened[1].joint.fraction_reached
            if reached < WIDE_ENOUGH:
                yield EarlierCause(*opened, reached < WIDE_ENOUGH / 2 or cause.kind is CauseKind.NOWHERE)
    elif cause.kind is CauseKind.JOINT_STALLED and attempt.flow[cause.step].primitive is Primitive.ARTICULATE_CLOSE:
        left = latest(lambda task: task.support_goal == now.target, Primitive.UNGRASP, CauseKind.IN_THE_WAY)
        if left is not None:
            yield EarlierCause(*left, False)
