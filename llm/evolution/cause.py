"""The root cause of a failed attempt: the earliest step that its critiques find fault with, and what was measured."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum

from llm.evolution.observation import Miss
from oag import Attempt, Critique, Primitive
from oag.model.primitives import ARTICULATIONS


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
class Cause:
    """Why an attempt failed.

    Attributes:
        kind: What it was.
        step: Index of the step that it lies in.
        words: The critique's diagnosis.
        measurements: What the step measured, the failure's numbers included.
        misses: How far items were from their goals.
    """

    kind: CauseKind
    step: int
    words: str
    measurements: Mapping[str, object] = field(default_factory=dict)
    misses: tuple[Miss, ...] = ()

    def number(self, key: str) -> float | None:
        """Returns a measured number, or None when there is none of that name."""
        value = self.measurements.get(key)
        return float(value) if isinstance(value, int | float) and not isinstance(value, bool) else None


def diagnose(attempt: Attempt) -> Cause | None:
    """Returns the root cause of a failed attempt; None when no critique finds fault."""
    critique = next((critique for critique in attempt.critiques if critique.finds_fault), None)
    if critique is None:
        return None
    kind = _kind(critique)
    if attempt.hindsight is not None:
        kind = _IN_HINDSIGHT.get(critique.primitive, kind)
    # Where a navigation is to blame, what was missed shows at a later step.
    later = (_misses(other.evidence.get("misses")) for other in attempt.critiques if other.step >= critique.step)
    measurements = measured_at(attempt, critique.step)
    return Cause(kind, critique.step, critique.text, measurements, next((m for m in later if m), ()))


def measured_at(attempt: Attempt, step: int) -> Mapping[str, object]:
    """Returns what was measured at a step of an attempt: its own numbers, its failure's, and those aimed by before."""
    evidence = next((critique.evidence for critique in attempt.critiques if critique.step == step), {})
    aimed = [_mapping(other.evidence.get("measurements")) for other in attempt.critiques if other.step <= step]
    return {
        **{key: value for seen in aimed for key, value in seen.items() if key in _CARRIED_ON},
        **_mapping(evidence.get("measurements")),
        **_mapping(evidence.get("failure_measurements")),
        **{key: value for unmet in _mapping(evidence.get("unmet")).values() for key, value in _mapping(unmet).items()},
    }


# What was measured at one step and explains the failure of a later one.
_CARRIED_ON = frozenset(
    {f"{what}_{way}_m" for what in ("target", "held") for way in ("forward", "left", "up")}
    | {"beside_m", "driven_m", "region", "leaning_deg"}
)


def _kind(critique: Critique) -> CauseKind:
    failure = str(critique.evidence.get("failure", ""))
    primitive = critique.primitive
    if failure == "stalled":
        return CauseKind.JOINT_STALLED if primitive in ARTICULATIONS else CauseKind.BLOCKED
    if failure == "dropped" and primitive is Primitive.UNGRASP:
        return CauseKind.MISPLACED
    if failure == "unexpected-contact" and primitive is Primitive.CONVERGE:
        return CauseKind.GRASP_MISSED
    if failure:
        return _BY_FAILURE.get(failure, CauseKind.UNKNOWN)
    if primitive in ARTICULATIONS and critique.state_reached is False:
        return CauseKind.JOINT_SHORT
    if primitive is Primitive.NAVIGATE_TO_SUPPORT:
        return CauseKind.NOWHERE
    if primitive is Primitive.UNGRASP and _still_touched(critique):
        return CauseKind.STILL_TOUCHED
    if critique.evidence.get("misses"):
        return CauseKind.MISPLACED
    return CauseKind.GRASP_MISSED if primitive is Primitive.GRASP else CauseKind.UNKNOWN


def _still_touched(critique: Critique) -> bool:
    unmet = [_mapping(measured) for measured in _mapping(critique.evidence.get("unmet")).values()]
    return bool(unmet) and all(measured.get("fingers_touching") in (1, 2) for measured in unmet)


def _misses(value: object) -> tuple[Miss, ...]:
    if not isinstance(value, list | tuple):
        return ()
    return tuple(
        Miss(str(entry["literal"]), *(float(entry[key]) for key in _MISS_NUMBERS))
        for entry in value
        if isinstance(entry, Mapping) and all(isinstance(entry.get(key), int | float) for key in _MISS_NUMBERS)
    )


_MISS_NUMBERS = ("forward_m", "left_m", "up_m", "centre_forward_m", "centre_left_m")


def _mapping(value: object) -> Mapping[str, object]:
    return value if isinstance(value, Mapping) else {}
