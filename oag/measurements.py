"""Measurements of a step, the evidence that a critique rests on, and the confidence interval of a success rate.

Records travel unchanged from a primitive to the critique and the cause. A step, and a failure, has a tuple of records:
one for what its primitive does, and more for other measurements, such as the contact that ended a motion. In files they
are one mapping with the units in its keys.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import MISSING, dataclass, fields
from numbers import Integral
from typing import Annotated, Literal, TypeVar

from oag.model.codec import ReadBy, Record, as_json, fields_json, members, number
from oag.model.diagnostics import EvidenceError


@dataclass(frozen=True, slots=True)
class Measurement(Record):
    """Base of all records; values that are None or not finite were not measured, and are not written."""

    def to_json(self) -> dict[str, object]:
        """Return what was measured as JSON values."""
        return {name: value for name, value in fields_json(self).items() if value is not None}

    @classmethod
    def is_in(cls, written: Mapping[str, object]) -> bool:
        """Decide whether a mapping has a record of this kind: every field without a default, or any field at all."""
        required = [field.name for field in fields(cls) if field.default is MISSING]
        return all(name in written for name in required)


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
    """NAVIGATE_TO_TARGET: where the base stands, and how far the stance's joints are from their limits.

    Attributes:
        suits_place: False where no hand that could also put the target into its place found a stance.
    """

    base_x_m: float
    base_y_m: float
    base_yaw_deg: float
    joint_margin_deg: float
    legs: int
    suits_place: bool | None = None


@dataclass(frozen=True, slots=True)
class SupportDrive(Measurement):
    """NAVIGATE_TO_SUPPORT.

    Attributes:
        leaning_deg: Lean of the held object [deg].
        region: Where the thing will be put; None where no place was found.
        joint_margin_deg: How far the joints are from their limits there.
        stance: Remark on a nominal stance, where the flow's numbers reach no free spot from anywhere.
        beside_m: Distance from the base to its goal at the end [m].
    """

    support: str
    leaning_deg: float | None = None
    region: str | None = None
    joint_margin_deg: float | None = None
    stance: str | None = None
    beside_m: float | None = None

    @classmethod
    def is_in(cls, written: Mapping[str, object]) -> bool:
        """Decide whether a mapping has a drive: `support` alone may be that of a step without a plan."""
        own = {field.name for field in fields(cls)} & written.keys()
        return "support" in own and (len(own) > 1 or not _UNPLANNED & written.keys())

    @property
    def nominal(self) -> bool:
        """True when the base stands at a nominal place, since no other one was found."""
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
    """A straight path whose end the arm does not reach: the shortfall, the reach, and what was asked."""

    residual_m: float
    reach_m: float
    asked: float
    joints_at_limit: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class FollowedInPart(Measurement):
    """A joint that the arm follows only a part of its path."""

    residual_m: float
    fraction_followed: float


@dataclass(frozen=True, slots=True)
class UnmeantContact(Measurement):
    """An unintended contact: a link of the robot or of what it holds, and a link of something else."""

    mover: str
    other: str
    other_link: str
    force_n: float


@dataclass(frozen=True, slots=True, kw_only=True)
class GripLoss(Measurement):
    """An object that slipped in the fingers, and how far, or that they lost."""

    slip_m: float | None = None
    time_s: float


@dataclass(frozen=True, slots=True)
class SideEffect(Measurement):
    """An item outside the plan that was moved or tipped over."""

    object: str
    moved_m: float
    tipped: bool


@dataclass(frozen=True, slots=True)
class RobotStall(Measurement):
    """How far the robot is short of its commanded pose."""

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
    """An object that does not fit between the fingers, and how high its rim is, if it has one."""

    width_m: float
    gripper_opening_m: float
    rim_height_m: float | None = None
    rim_height_needed_m: float | None = None


@dataclass(frozen=True, slots=True)
class StageCount(Measurement):
    """How many motions of an articulation were done before it failed."""

    stages: int

    @classmethod
    def is_in(cls, written: Mapping[str, object]) -> bool:
        """Decide whether a mapping has a count: the stages of a joint's motion are a list."""
        return isinstance(written.get("stages"), int)


@dataclass(frozen=True, slots=True)
class Unplanned(Measurement):
    """Reason why no plan was found, or a step was not begun.

    Attributes:
        gripped: Whose handle is still in the gripper.
        near: What the hand touches.
        stances_tried, looked_at: How many stances, or configurations, were tried.
        in_the_way: The bodies in collision; with counts, where many configurations were tried.
        free_to_fraction: How far a joint is free, as a fraction of its range.
        residual_m, residual_deg: Remaining error of the hand.
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
    """Measurements of an atom, or of a whole condition; each detector fills in its own.

    Attributes:
        reason: Why a detector cannot decide, or need not.
        open_fraction, widest_joint, angle_deg, opening_m: `open`: the joint that stands open widest, and how far.
        region, centre_depth_m, largest_excess_m, supported_by: `inside`: the region that it lies in deepest, the depth
            of its centre there, how far it sticks out, and what touches it.
        height_above_surface_m: `ontop`: of the lowest point.
        centre_beyond_edge_m: `ontop`, `under`: of the centre; negative where it is not beyond.
        top_below_top_m: `under`.
        touching: `ontop`: whether it touches what it is on.
        fingers_touching: How many fingers press on the thing.
        gap_m, allowed_gap_m: `nextto`.
        separation_m: `touching`.
        beyond_its_furniture_m, nearest_room: `inroom`.
        tilted_deg: `upright`, and of what was put down: how far it leans from upright, or from how it stood at first.
        lifted_m: Of what was picked up: how far its lowest point is above where that was.
        control, pressed_m, turned_deg: `toggled_on`: the button or knob, and how far it is pressed or turned.
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
    control: str | None = None
    pressed_m: float | None = None
    turned_deg: float | None = None
    undecided: bool | None = None


NOTHING_MEASURED = AtomMeasured()
# Keys by which a step without a plan differs from a drive.
_UNPLANNED = {field.name for field in fields(Unplanned)} - {field.name for field in fields(SupportDrive)}


# The kinds that a mapping is read by, each from the keys that those before it left.
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
    """Return the first record of a kind, or None."""
    return next((record for record in records if isinstance(record, kind)), None)


def measurements_json(records: Iterable[Measurement]) -> dict[str, object]:
    """Return records as one JSON object."""
    return {name: value for record in records for name, value in record.to_json().items()}


def read_measurements(written: Mapping[str, object], kinds: Iterable[type[Measurement]] = _KINDS) -> Measurements:
    """Return the records that `measurements_json` wrote, of some kinds; values of no known form are left out."""
    from pydantic import ValidationError  # Takes as long to import as all of this package.

    from oag.model.forms import adapter

    left, found = dict(written), list[tuple[int, Measurement]]()
    for kind in kinds:
        own = {field.name: left[field.name] for field in fields(kind) if field.name in left}
        if own and kind.is_in(left):
            try:
                record = adapter(kind).validate_python(own)
            except ValidationError:
                continue
            found.append((min(list(written).index(name) for name in own), record))
            left = {name: value for name, value in left.items() if name not in own}
    return tuple(record for _, record in sorted(found, key=lambda entry: entry[0]))


_Number = Annotated[float, ReadBy(number)]


@dataclass(frozen=True, slots=True)
class GoalReading:
    """A conjunct of a goal, as the detectors read it at one moment.

    Attributes:
        literal: The atom, or the formula, as BDDL.
        predicate: Of the atom, such as "open"; empty for any other formula.
    """

    literal: str
    wanted: bool
    value: bool
    measurements: AtomMeasured = NOTHING_MEASURED
    predicate: str = ""

    @property
    def satisfied(self) -> bool:
        """True when it was read as the goal asks for it."""
        return self.value == self.wanted

    def __str__(self) -> str:
        return self.literal if self.wanted else f"(not {self.literal})"


@dataclass(frozen=True, slots=True)
class Unmet(Measurement):
    """A condition of a goal that does not hold, with what the detectors measured of it."""

    condition: str
    measurements: AtomMeasured = NOTHING_MEASURED

    def to_json(self) -> dict[str, object]:
        """Return the condition with its numbers."""
        return {self.condition: self.measurements.to_json()}


@dataclass(frozen=True, slots=True)
class Miss(Record):
    """How far an item is from where its goal would hold, in the robot's own directions.

    All distances are what the item would have to be moved by: positive is forward, to the left, up.

    Attributes:
        literal: The goal's atom, such as `(inside glass_0 refrigerator_0)`.
        forward_m, left_m, up_m: To the nearest place where it fits.
        centre_forward_m, centre_left_m: To the middle of that place.
    """

    literal: str
    forward_m: _Number
    left_m: _Number
    up_m: _Number
    centre_forward_m: _Number = 0.0
    centre_left_m: _Number = 0.0

    @property
    def distance_m(self) -> float:
        """How far the nearest place is; 0 where the item is over it or in it."""
        return float((self.forward_m**2 + self.left_m**2 + self.up_m**2) ** 0.5)


def _read_measured(value: object) -> Measurements:
    return read_measurements(members(value))


def _read_unmet(value: object) -> tuple[Unmet, ...]:
    return tuple(
        Unmet(condition, first_of(read_measurements(members(one), (AtomMeasured,)), AtomMeasured) or NOTHING_MEASURED)
        for condition, one in members(value).items()
    )


@dataclass(frozen=True, slots=True)
class MeasuredEvidence:
    """Measured evidence of a critique.

    Attributes:
        measurements: What the step measured; None where no measurement was read.
        failure: Kind of the step's own failure; empty when it did what it should.
        unmet: Conditions that the step should have made true and did not.
        misses: How far items are from their places.
        measured: The critique by the measurements alone, where a model was asked too.
        model_did_not_judge: Why a model did not judge the step; empty when it did, or was not asked.
    """

    measurements: Annotated[Measurements, ReadBy(_read_measured)] | None = None
    failure: str = ""
    failure_measurements: Annotated[Measurements, ReadBy(_read_measured)] = ()
    unmet: Annotated[tuple[Unmet, ...], ReadBy(_read_unmet)] = ()
    misses: tuple[Miss, ...] = ()
    measured: Mapping[str, object] | None = None
    pictures: tuple[Mapping[str, object], ...] = ()
    model_did_not_judge: str = ""

    def to_json(self) -> dict[str, object]:
        """Return the evidence as JSON values; empty entries are left out."""
        written = {
            "measurements": None if self.measurements is None else measurements_json(self.measurements),
            "failure": self.failure or None,
            "failure_measurements": measurements_json(self.failure_measurements) if self.failure else None,
            "unmet": measurements_json(self.unmet) or None,
            "misses": as_json(self.misses) or None,
            "measured": as_json(self.measured),
            "pictures": as_json(self.pictures) or None,
            "model_did_not_judge": self.model_did_not_judge or None,
        }
        return {name: value for name, value in written.items() if value is not None}


def clopper_pearson(successes: int, trials: int, confidence: float = 0.95) -> tuple[float, float]:
    """Return the exact two-sided confidence interval of a success probability.

    Raises EvidenceError, a ValueError, for impossible counts or a confidence outside of (0, 1).
    """
    if not 0.0 < confidence < 1.0:
        raise EvidenceError(f"expected a confidence between 0 and 1, such as 0.95, got {confidence:g}")
    tail = (1.0 - confidence) / 2.0
    return lower_bound(successes, trials, tail), 1.0 - lower_bound(trials - successes, trials, tail)


def lower_bound(successes: int, trials: int, alpha: float = 0.05) -> float:
    """Return the exact one-sided lower bound: the true probability is below it in at most `alpha` of cases."""
    _check_whole(successes, trials)
    if trials < 1 or not 0 <= successes <= trials or not 0.0 < alpha < 1.0:
        raise EvidenceError(f"no interval for {successes} successes in {trials} trials with an error of {alpha:g}")
    if successes == 0:
        return 0.0
    # scipy takes as long to import as all of this package, and only measurements need it.
    from scipy.special import betaincinv

    return float(betaincinv(successes, trials - successes + 1, alpha))


def is_whole(number: object) -> bool:
    """Decide whether a value is a whole number, numpy's included; truth values are not."""
    return isinstance(number, Integral) and not isinstance(number, bool)


def _check_whole(successes: object, trials: object) -> None:
    if not (is_whole(successes) and is_whole(trials)):
        raise EvidenceError(f"expected whole numbers of successes and trials, got {successes!r} and {trials!r}")
