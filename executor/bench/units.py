"""Units of a benchmark: names for people, and ids that change when outcomes may change."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Field, StrictBool, StrictInt

from executor.campaign.planning_model import PlanningModel
from executor.campaign.versions import UNORDERED_VERSION
from executor.scenes.generators.families import LONG_HORIZON, Family, Flows, Seed, pair_name, pairs_from
from executor.scenes.generators.household import COUNT
from executor.scenes.vary import MOST_EPISODES
from executor.system.files import content_key
from oag.model.forms import adapter
from oag.model.robots import FULL_SIZE, PAPER_ROBOT, chosen_robot, known_robot, robot_named

SCHEMA = "scene2demo-bench-unit/1"
BenchFamily = Family | Literal["T7"]
"""Families of pairs, and T7, whose wishes need not have a plan."""


@dataclass(frozen=True, slots=True)
class BenchSetting:
    """Setting of one row of the table.

    Attributes:
        flows: The offline planner's flows, or the paper's, numbers verbatim.
        evolve: Whether failing flows are revised.
        keep_sizes: Whether handled things keep their sizes.
        full_size: Whether the robot is of full size.
        baseline: Name of what acts in place of the executor, such as those of `benchmarks.baselines`.
        robot: Name of the robot; empty for the paper's, or where `full_size` is said, which is another word for one.
        model: Language model that plans; None for the offline planner.
    """

    flows: Flows = "planned"
    evolve: StrictBool = False
    keep_sizes: StrictBool = False
    full_size: StrictBool = False
    baseline: Annotated[str, Field(pattern="^[a-z-]{1,40}$")] | None = None
    robot: Annotated[str, AfterValidator(known_robot)] = ""
    model: PlanningModel | None = None

    def __post_init__(self) -> None:
        if self.robot == FULL_SIZE.name:
            object.__setattr__(self, "full_size", True)
        if self.robot in (FULL_SIZE.name, PAPER_ROBOT.name):
            object.__setattr__(self, "robot", "")

    @property
    def robot_name(self) -> str:
        """Name of the robot."""
        return chosen_robot(self.robot, full_size=self.full_size) or PAPER_ROBOT.name

    @property
    def name(self) -> str:
        """Short name that is valid in file names."""
        words = {"evolve": self.evolve, "own-sizes": self.keep_sizes, "full-size": self.full_size}
        words[self.robot] = bool(self.robot)
        if self.model is not None:
            words[f"model-{self.model.key}"] = True
        own = [self.flows] if self.baseline is None else [self.baseline]
        return "-".join([*own, *(word for word, enabled in words.items() if enabled)])

    @property
    def label(self) -> str:
        """Label of the row in the table."""
        own = "planned flows" if self.flows == "planned" else "paper's flows"
        if self.model is not None:
            own = f"planned by {self.model.label}"
        if self.baseline is not None:
            own = self.baseline
        words = {
            "evo": self.evolve,
            "own sizes": self.keep_sizes,
            "full-size robot": self.full_size,
            self.robot: bool(self.robot),
        }
        return " + ".join([f"here: {own}", *(word for word, enabled in words.items() if enabled)])


@dataclass(frozen=True, slots=True)
class Unit:
    """One episode of a benchmark.

    Attributes:
        family: "T1" to "T7".
        seed: For T1 to T4 and T7 the episode's seed; for T5 and T6 that of the set of pairs.
        index: Position of the pair in its set; None for T1 to T4 and T7.
        setting: Its setting.
    """

    family: BenchFamily
    seed: Seed
    index: Annotated[StrictInt, Field(ge=0, lt=COUNT)] | None
    setting: BenchSetting

    @property
    def name(self) -> str:
        """Human-readable name, unique within one version of the program."""
        return f"{self.family}-{pair_name(self.seed, self.index)}-{self.setting.name}"

    def id(self, version: str) -> str:
        """Return a key that is equal when scene, task, seed, setting and all other inputs of the outcome are.

        Scene and task follow from family, seed and index by code and data, which the version stands for.
        """
        parts = [SCHEMA, version, self.family, str(self.seed), str(self.index), self.setting.name]
        if self.family == "T7" or not robot_named(self.setting.robot_name).keeps_order:
            parts.append(f"unordered {UNORDERED_VERSION}")
        return content_key(*parts)

    def to_json(self) -> dict[str, Any]:
        """Return the unit as plain data."""
        return _without_model(asdict(self))

    @classmethod
    def from_json(cls, value: Mapping[str, Any]) -> Unit:
        """Parse the unit that `to_json` returned.

        Raises:
            ValueError: It is no such data.
        """
        unit = adapter(cls).validate_python(value)
        if (unit.index is None) is not (unit.family in (*LONG_HORIZON, "T7")):
            raise ValueError(f"{unit.family} has no unit {unit.index}")
        return unit


def _without_model(data: dict[str, Any]) -> dict[str, Any]:
    """Leave the model out of a setting that has none, as earlier programs do."""
    if data["setting"]["model"] is None:
        del data["setting"]["model"]
    return data


@dataclass(frozen=True, slots=True)
class Series:
    """Consecutive units of one family in one setting: one cell of the table.

    Attributes:
        family: "T1" to "T7".
        seed: Seed of the first episode, or of the first set of pairs.
        episodes: Number of units.
        setting: Their setting.
        version: Version of the program.
    """

    family: BenchFamily
    seed: Seed
    episodes: Annotated[StrictInt, Field(ge=0, le=MOST_EPISODES)]
    setting: BenchSetting
    version: str

    def units(self) -> Iterator[Unit]:
        """Yield the units in order; those of T5 and T6 go through one set of pairs after the other."""
        for seed, index in pairs_from(self.family, self.seed, self.episodes):
            yield Unit(self.family, seed, index, self.setting)

    def to_json(self) -> dict[str, Any]:
        """Return the series as plain data."""
        return _without_model(asdict(self))

    @classmethod
    def from_json(cls, value: Mapping[str, Any]) -> Series:
        """Parse the series that `to_json` returned.

        Raises:
            ValueError: It is no such data.
        """
        return adapter(cls).validate_python(value)
