"""What a step measured: records that travel unchanged from a primitive to the critique and the cause.

A step, and a failure, has a tuple of records: one for what its primitive does, and more where something else was
measured as well, such as the contact that ended a motion. In files they are one mapping with the units in its keys.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields
from typing import Any, Literal, TypeVar


@dataclass(frozen=True, slots=True)
class Measurement:
    """The base of all records; what is None, or no finite number, was not measured, and is not written."""

    def to_json(self) -> dict[str, object]:
        """Returns the record as JSON values."""
        found = ((field.name, _plain(getattr(self, field.name))) for field in fields(self))
        return {name: value for name, value in found if value is not None}


Measurements = tuple[Measurement, ...]
_Kind = TypeVar("_Kind", bound=Measurement)


@dataclass(frozen=True, slots=True)
class JointMotion(Measurement):
    """ARTICULATE_OPEN or ARTICULATE_CLOSE: one joint by one motion, in fractions of its range.

    Attributes:
        motion: "rigid arc", "push", or what else moved it.
        joint_reached: In radians, or metres.
        stages: All motions, where it took more than this last one.
    """

    joint: str
    motion: str
    fraction_before: float
    fraction_asked: float
    fraction_reached: float
    joint_reached: float
    stages: tuple[JointMotion, ...] | None = None


@dataclass(frozen=True, slots=True)
class GripMeasured(Measurement):
    """GRASP: how the fingers closed, and how far the thing is from where the grasp meant it, in the base's directions.

    Attributes:
        motion: "push" where there was nothing to grasp: the closed gripper is to push.
    """

    motion: Literal["push"] | None = None
    fingers_touching: int | None = None
    opening_m: float | None = None
    target_width_m: float | None = None
    grip_force_n: float | None = None
    held_off_m: float | None = None
    held_forward_m: float | None = None
    held_left_m: float | None = None
    held_up_m: float | None = None


@dataclass(frozen=True, slots=True)
class ReleaseMeasured(Measurement):
    """UNGRASP: how far the thing fell and moved."""

    fell_m: float
    moved_m: float


@dataclass(frozen=True, slots=True)
class RetreatMeasured(Measurement):
    """RETREAT, or its motion before a drive: rows of the path back and of the path home."""

    already_home: Literal[True] | None = None
    back_off_rows: int | None = None
    home_rows: int | None = None


@dataclass(frozen=True, slots=True)
class TargetDrive(Measurement):
    """NAVIGATE_TO_TARGET: where the base stands, and how far the stance's joints are from their limits."""

    base_x_m: float
    base_y_m: float
    base_yaw_deg: float
    joint_margin_deg: float
    legs: int


@dataclass(frozen=True, slots=True)
class SupportDrive(Measurement):
    """NAVIGATE_TO_SUPPORT.

    Attributes:
        leaning_deg: How the held thing leans.
        region: Where the thing will be put; None where no place was found.
        joint_margin_deg: How far the joints are from their limits there.
        stance: What is said of a nominal place, where the flow's numbers reach no free spot from anywhere; else None.
        beside_m: How far from its goal the base ended.
    """

    support: str
    leaning_deg: float | None = None
    region: str | None = None
    joint_margin_deg: float | None = None
    stance: str | None = None
    beside_m: float | None = None

    @property
    def nominal(self) -> bool:
        """Whether the base stands at a nominal place, since no other one was found."""
        return self.stance is not None


@dataclass(frozen=True, slots=True)
class HandMeasured(Measurement):
    """APPROACH and CONVERGE: where the hand is, and how far the target is from the aim, in the base's directions.

    Attributes:
        residual_m: How far the hand is from where it was sent.
    """

    eef_position_m: tuple[float, ...]
    residual_m: float | None = None
    target_forward_m: float | None = None
    target_left_m: float | None = None
    target_up_m: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class MoveMeasured(Measurement):
    """A straight move, slide or turn: what was asked, and how far the hand came.

    Attributes:
        set_down: Whether it ended as what is held came to rest on its support; the contact comes with it.
    """

    asked_m: float | None = None
    asked_deg: float | None = None
    eef_moved_m: float
    set_down: Literal[True] | None = None


@dataclass(frozen=True, slots=True)
class OutOfReach(Measurement):
    """A straight way that the arm does not come to the end of: what is short, what it reaches, and what was asked."""

    residual_m: float
    reach_m: float
    asked: float
    joints_at_limit: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class FollowedInPart(Measurement):
    """A joint that the arm follows a part of its way only."""

    residual_m: float
    fraction_followed: float


@dataclass(frozen=True, slots=True)
class UnmeantContact(Measurement):
    """Two bodies that met: a link of the robot or what it holds, and a link of something else."""

    mover: str
    other: str
    other_link: str
    force_n: float


@dataclass(frozen=True, slots=True, kw_only=True)
class GripLoss(Measurement):
    """A thing that slipped in the fingers by so much, or that they lost."""

    slip_m: float | None = None
    time_s: float


@dataclass(frozen=True, slots=True)
class SideEffect(Measurement):
    """An item that nothing was to be done with, and that was moved or tipped over."""

    object: str
    moved_m: float
    tipped: bool


@dataclass(frozen=True, slots=True)
class RobotStall(Measurement):
    """How far the robot is short of where it was told to be."""

    base_short_m: float
    yaw_short_deg: float
    arm_short_deg: float


@dataclass(frozen=True, slots=True)
class TimeUp(Measurement):
    """A primitive that took longer than it may."""

    limit_s: float
    time_s: float


@dataclass(frozen=True, slots=True)
class TooWide(Measurement):
    """A thing that does not fit between the fingers, and how high its rim is, where it has one."""

    width_m: float
    gripper_opening_m: float
    rim_height_m: float | None = None
    rim_height_needed_m: float | None = None


@dataclass(frozen=True, slots=True)
class StageCount(Measurement):
    """How many motions of an articulation were done before it failed."""

    stages: int


@dataclass(frozen=True, slots=True)
class Unplanned(Measurement):
    """What keeps a plan from being found, or a step from being begun.

    Attributes:
        target, support, joint: What it is about.
        gripped: Whose handle is still in the gripper.
        near: What the hand touches.
        stances_tried, looked_at: How many stances, or configurations, were tried.
        in_the_way: What meets; with how often, where many configurations were looked at.
        free_to_fraction: How far a joint is free, as a fraction of its range.
        residual_m, residual_deg: How far the hand stays off.
        joints_at_limit: What holds it there.
    """

    target: str | None = None
    support: str | None = None
    joint: str | None = None
    gripped: str | None = None
    near: tuple[str, ...] | None = None
    stances_tried: int | None = None
    looked_at: int | None = None
    in_the_way: tuple[str, ...] | Mapping[str, int] | None = None
    free_to_fraction: float | None = None
    residual_m: float | None = None
    residual_deg: float | None = None
    joints_at_limit: tuple[str, ...] | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class AtomMeasured(Measurement):
    """What the detectors measured of an atom, or of a whole condition: each fills in its own.

    Attributes:
        reason: Why a detector cannot tell, or need not look.
        open_fraction, widest_joint, angle_deg, opening_m: `open`: the joint that stands open widest, and how far.
        region, centre_depth_m, largest_excess_m, supported_by: `inside`: the hollow that it lies in deepest, how deep
            its centre lies in that, how far it sticks out, and what touches it.
        height_above_surface_m: `ontop`: of the lowest point.
        centre_beyond_edge_m: `ontop`, `under`: of the centre; negative where it is not beyond.
        top_below_top_m: `under`.
        touching: `ontop`: whether it touches what it is on.
        fingers_touching: How many fingers press on the thing.
        gap_m, allowed_gap_m: `nextto`.
        separation_m: `touching`.
        beyond_its_furniture_m, nearest_room: `inroom`.
        tilted_deg: Of what was put down: how far it leans from upright, or from how it stood at first.
        lifted_m: Of what was picked up: how far its lowest point is above where that was.
        undecided: Whether no detector could tell.
    """

    reason: str | None = None
    open_fraction: float | None = None
    widest_joint: str | None = None
    angle_deg: float | None = None
    opening_m: float | None = None
    region: str | None = None
    centre_depth_m: float | None = None
    largest_excess_m: float | None = None
    supported_by: tuple[str, ...] | None = None
    height_above_surface_m: float | None = None
    centre_beyond_edge_m: float | None = None
    top_below_top_m: float | None = None
    touching: bool | None = None
    fingers_touching: int | None = None
    gap_m: float | None = None
    allowed_gap_m: float | None = None
    separation_m: float | None = None
    beyond_its_furniture_m: float | None = None
    nearest_room: str | None = None
    tilted_deg: float | None = None
    lifted_m: float | None = None
    undecided: bool | None = None


NOTHING_MEASURED = AtomMeasured()


# A mapping of a file is read as the first of these that its keys and values make, then the next of the keys left over.
_KINDS: tuple[type[Measurement], ...] = (
    StageCount,
    JointMotion,
    ReleaseMeasured,
    TargetDrive,
    SupportDrive,
    HandMeasured,
    OutOfReach,
    MoveMeasured,
    FollowedInPart,
    UnmeantContact,
    TimeUp,
    GripLoss,
    SideEffect,
    RobotStall,
    TooWide,
    GripMeasured,
    RetreatMeasured,
    Unplanned,
)


def first_of(records: Iterable[Measurement], kind: type[_Kind]) -> _Kind | None:
    """Returns the first record of a kind, or None."""
    return next((record for record in records if isinstance(record, kind)), None)


def measurements_json(records: Iterable[Measurement]) -> dict[str, object]:
    """Returns records as one JSON object."""
    return {name: value for record in records for name, value in record.to_json().items()}


def read_measurements(told: Mapping[str, object], kinds: Iterable[type[Measurement]] = _KINDS) -> Measurements:
    """Returns the records that `measurements_json` wrote; what is of no known form is left out.

    Args:
        told: What was written.
        kinds: Records that it can be of.
    """
    from pydantic import TypeAdapter, ValidationError  # Takes as long to import as all of this package.

    left, found = dict(told), list[tuple[int, Measurement]]()
    for kind in kinds:
        own = {field.name: left[field.name] for field in fields(kind) if field.name in left}
        if own:
            try:
                record = TypeAdapter(kind).validate_python(own)
            except ValidationError:
                continue
            found.append((min(list(told).index(name) for name in own), record))
            left = {name: value for name, value in left.items() if name not in own}
    return tuple(record for _, record in sorted(found, key=lambda entry: entry[0]))


def _plain(value: Any) -> object:
    if isinstance(value, Measurement):
        return value.to_json()
    if isinstance(value, tuple | list):
        return [_plain(entry) for entry in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return dict(value) if isinstance(value, Mapping) else value
