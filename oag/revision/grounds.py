"""What a critique rests on: what a step measured, what its goal lacks, and how far items are from their places."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Annotated

from oag.model.jsonfile import ReadBy, members, number
from oag.revision.measurements import (
    NOTHING_MEASURED,
    AtomMeasured,
    Measurement,
    Measurements,
    first_of,
    measurements_json,
    read_measurements,
)

_Number = Annotated[float, ReadBy(number)]


@dataclass(frozen=True, slots=True)
class GoalReading:
    """A conjunct of a goal, as the detectors read it at some moment.

    Attributes:
        literal: The atom, or the formula, as BDDL.
        wanted: What the goal asks for.
        value: What was read.
        measurements: The numbers behind it.
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
        """Returns the condition with its numbers."""
        return {self.condition: self.measurements.to_json()}


@dataclass(frozen=True, slots=True)
class Miss:
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

    def to_json(self) -> dict[str, object]:
        """Returns the miss as JSON values."""
        return {entry.name: getattr(self, entry.name) for entry in fields(self)}


def _read_measured(told: object) -> Measurements:
    return read_measurements(members(told))


def _read_unmet(told: object) -> tuple[Unmet, ...]:
    return tuple(
        Unmet(condition, first_of(read_measurements(members(one), (AtomMeasured,)), AtomMeasured) or NOTHING_MEASURED)
        for condition, one in members(told).items()
    )


@dataclass(frozen=True, slots=True)
class Grounds:
    """What a critique rests on.

    Attributes:
        measurements: What the step measured; None where nothing measured was looked at.
        failure: Kind of the step's own failure; empty when it did what it should.
        failure_measurements: The numbers behind the failure.
        unmet: What the step was to bring about and did not.
        misses: How far items are from their places.
        measured: What the measurements alone said of the step, where a model was asked as well.
        pictures: Which pictures were looked at.
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
        """Returns the grounds as JSON values; what there is none of is left out."""
        told: dict[str, object] = {}
        if self.measurements is not None:
            told["measurements"] = measurements_json(self.measurements)
        if self.failure:
            told |= {"failure": self.failure, "failure_measurements": measurements_json(self.failure_measurements)}
        if self.unmet:
            told["unmet"] = measurements_json(self.unmet)
        if self.misses:
            told["misses"] = [miss.to_json() for miss in self.misses]
        if self.measured is not None:
            told["measured"] = dict(self.measured)
        if self.pictures:
            told["pictures"] = [dict(picture) for picture in self.pictures]
        return told | ({"model_did_not_judge": self.model_did_not_judge} if self.model_did_not_judge else {})
