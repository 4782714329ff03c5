"""The root cause of a failed attempt: the earliest step that its critiques find fault with, and what was measured."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from enum import Enum
from typing import TypeVar

from oag import Attempt, Critique, Primitive
from oag.model.primitives import ARTICULATIONS
from oag.revision.grounds import Grounds, Miss
from oag.revision.measurements import (
    AtomMeasured,
    FollowedInPart,
    GripMeasured,
    HandMeasured,
    JointMotion,
    Measurement,
    Measurements,
    MoveMeasured,
    OutOfReach,
    SupportDrive,
    UnmeantContact,
    Unplanned,
    first_of,
)


class CauseKind(Enum):
    """What went wrong; the value is the cause in a few words."""

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


# What a step of an earlier subtask is blamed for when a later one failed because of it.
_IN_HINDSIGHT = {
    Primitive.GRASP: CauseKind.HELD_BADLY,
    Primitive.ARTICULATE_OPEN: CauseKind.OPENED_LITTLE,
    Primitive.UNGRASP: CauseKind.IN_THE_WAY,
}
_BY_FAILURE = {
    "unreachable": CauseKind.OUT_OF_REACH,
    "no-collision-free-path": CauseKind.NO_WAY,
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
class RootCause:
    """Why an attempt failed.

    Attributes:
        kind: What it was.
        step: Index of the step that it lies in.
        words: The critique's diagnosis.
        grounds: What that critique rests on.
        until_then: What all steps up to this one measured, in order: an earlier one may explain the failure.
        misses: How far items were from their goals.
        stopped: Whether several attempts ended at the same place, so that something stands there.
    """

    kind: CauseKind
    step: int
    words: str
    grounds: Grounds = field(default_factory=Grounds)
    until_then: Measurements = ()
    misses: tuple[Miss, ...] = ()
    stopped: bool = False

    @property
    def joint(self) -> JointMotion | None:
        """The joint's motion, where the step was one."""
        return first_of(self._own, JointMotion)

    @property
    def move(self) -> MoveMeasured | None:
        """The straight move, where the step was one."""
        return first_of(self._own, MoveMeasured)

    @property
    def grip(self) -> GripMeasured | None:
        """How the fingers closed, where the step closed them."""
        return first_of(self._own, GripMeasured)

    @property
    def contact(self) -> UnmeantContact | None:
        """The contact that ended the step."""
        return first_of(self._own, UnmeantContact)

    @property
    def unplanned(self) -> Unplanned | None:
        """What kept a plan from being found, where none was."""
        return first_of(self._own, Unplanned)

    @property
    def residual_m(self) -> float | None:
        """How far the hand stayed off."""
        kinds = OutOfReach | FollowedInPart | Unplanned | HandMeasured
        known = (record.residual_m for record in self._own if isinstance(record, kinds))
        return next((residual_m for residual_m in known if residual_m is not None), None)

    @property
    def beside_m(self) -> float | None:
        """How far beside its goal the base ended."""
        return self._latest(SupportDrive, lambda drive: drive.beside_m)

    @property
    def leaning_deg(self) -> float | None:
        """How the held thing leaned."""
        return self._latest(SupportDrive, lambda drive: drive.leaning_deg)

    @property
    def was_planned(self) -> bool:
        """Whether planning chose where the base stood, for the flow's own moves, or the thing is in some place."""
        planned = self._latest(SupportDrive, lambda drive: drive.region) is not None
        return planned or any(unmet.measurements.region is not None for unmet in self.grounds.unmet)

    @property
    def off_the_aim_m(self) -> tuple[float, float]:
        """How far the target was from the aim: forward and to the left."""
        hand = self._latest(HandMeasured, lambda hand: hand if hand.target_left_m is not None else None)
        return (0.0, 0.0) if hand is None else (hand.target_forward_m or 0.0, hand.target_left_m or 0.0)

    @property
    def held_off_m(self) -> tuple[float, float]:
        """How far the thing is from its place in the hand: forward and to the left."""
        grip = self._latest(GripMeasured, lambda grip: grip if grip.held_left_m is not None else None)
        return (0.0, 0.0) if grip is None else (grip.held_forward_m or 0.0, grip.held_left_m or 0.0)

    @property
    def fingers_touching(self) -> float | None:
        """How many fingers touch the thing, by the goal's reading or by the grasp's own."""
        read = self._unmet(lambda measured: measured.fingers_touching)
        return read if read is not None else None if self.grip is None else self.grip.fingers_touching

    @property
    def open_fraction(self) -> float | None:
        """How far a door is open that the goal wants otherwise."""
        return self._unmet(lambda measured: measured.open_fraction)

    @property
    def _own(self) -> Measurements:
        return (*self.grounds.failure_measurements, *(self.grounds.measurements or ()))

    def _latest(self, kind: type[_Kind], read: Callable[[_Kind], _Read | None]) -> _Read | None:
        """Returns what the last record of a kind has of something, of those that have it."""
        found = (read(record) for record in reversed(self.until_then) if isinstance(record, kind))
        return next((value for value in found if value is not None), None)

    def _unmet(self, read: Callable[[AtomMeasured], float | None]) -> float | None:
        """Returns a number that the detectors read of the last unmet condition that has it."""
        found = (read(unmet.measurements) for unmet in reversed(self.grounds.unmet))
        return next((value for value in found if value is not None), None)


_Kind = TypeVar("_Kind", bound=Measurement)
_Read = TypeVar("_Read")


def diagnose(attempt: Attempt) -> RootCause | None:
    """Returns the root cause of a failed attempt; None when no critique finds fault."""
    critique = next((critique for critique in attempt.critiques if critique.finds_fault), None)
    if critique is None:
        return None
    kind = _kind(critique)
    if attempt.hindsight is not None:
        kind = _IN_HINDSIGHT.get(critique.primitive, kind)
    # Where a navigation is to blame, what was missed shows at a later step.
    later = (other.evidence.misses for other in attempt.critiques if other.step >= critique.step)
    return replace(cause_at(attempt, critique.step, kind), misses=next((misses for misses in later if misses), ()))


def cause_at(attempt: Attempt, step: int, kind: CauseKind) -> RootCause:
    """Returns a step of an attempt as a cause, with what was measured there and before."""
    critique = next((critique for critique in attempt.critiques if critique.step == step), None)
    earlier = (other.evidence.measurements or () for other in attempt.critiques if other.step <= step)
    until_then = tuple(record for records in earlier for record in records)
    if critique is None:
        return RootCause(kind, step, "", until_then=until_then)
    return RootCause(kind, step, critique.text, critique.evidence, until_then)


def _kind(critique: Critique) -> CauseKind:
    failure = critique.evidence.failure
    primitive = critique.primitive
    if failure in ("stalled", "unexpected-contact") and primitive is Primitive.CONVERGE:
        # Fingers that come down on the thing may touch it, and stop there; the palm may not.
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
