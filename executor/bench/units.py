"""Units of a benchmark: names for people, and ids that change when outcomes may change."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from functools import cache
from importlib import metadata
from typing import Annotated, Any, Literal

from pydantic import Field, StrictBool, StrictInt

from executor.scenes.generators import household, long_horizon
from executor.scenes.pair import UNCHANGED, LayoutChanges, ScenePair
from executor.scenes.vary import LARGEST_SEED, MOST_EPISODES
from executor.system.files import content_key, json_text
from oag.model.forms import adapter

SCHEMA = "scene2demo-bench-unit/1"

Family = Literal["T1", "T2", "T3", "T4", "T5", "T6"]
Flows = Literal["planned", "paper"]
Baseline = Literal["unchecked", "checked", "repaired", "constraint-pose", "sampled-grasp", "one-demonstration"]
Seed = Annotated[StrictInt, Field(ge=0, le=LARGEST_SEED)]


LONG_HORIZON: tuple[Family, ...] = ("T1", "T2", "T3", "T4")
HOUSEHOLD: tuple[Family, ...] = ("T5", "T6")
FAMILIES = LONG_HORIZON + HOUSEHOLD


BASELINES: dict[Baseline, str] = {
    "unchecked": "one mistake, unchecked",
    "checked": "one mistake, checked",
    "repaired": "one mistake, repaired",
    "constraint-pose": "like GenSim2 (own code)",
    "sampled-grasp": "like RoboGen (own code)",
    "one-demonstration": "like MimicGen (own code)",
}
"""Baseline -> its label in the table."""


@dataclass(frozen=True, slots=True)
class BenchSetting:
    """Setting of one row of the table.

    Attributes:
        flows: The offline planner's flows, or the paper's, numbers verbatim.
        evolve: Whether failing flows are revised.
        views: Whether pictures of three cameras are rendered for every success.
        keep_sizes: Whether handled things keep their sizes.
        full_size: Whether the robot is of full size.
        baseline: Baseline in place of the executor.
    """

    flows: Flows = "planned"
    evolve: StrictBool = False
    views: StrictBool = False
    keep_sizes: StrictBool = False
    full_size: StrictBool = False
    baseline: Baseline | None = None

    @property
    def name(self) -> str:
        """Short name that is valid in file names."""
        words = {"evolve": self.evolve, "views": self.views, "own-sizes": self.keep_sizes, "full-size": self.full_size}
        own = [self.flows] if self.baseline is None else [self.baseline]
        return "-".join([*own, *(word for word, enabled in words.items() if enabled)])

    @property
    def label(self) -> str:
        """Label of the row in the table."""
        own = "planned flows" if self.flows == "planned" else "paper's flows"
        if self.baseline is not None:
            own = BASELINES[self.baseline]
        words = {
            "evo": self.evolve,
            "pictures": self.views,
            "own sizes": self.keep_sizes,
            "full-size robot": self.full_size,
        }
        return " + ".join([f"here: {own}", *(word for word, enabled in words.items() if enabled)])


@dataclass(frozen=True, slots=True)
class Unit:
    """One episode of a benchmark.

    Attributes:
        family: "T1" to "T6".
        seed: For T1 to T4 the episode's seed; for T5 and T6 that of the set of pairs.
        index: Position of the pair in its set; None for T1 to T4.
        setting: Its setting.
    """

    family: Family
    seed: Seed
    index: Annotated[StrictInt, Field(ge=0, lt=household.COUNT)] | None
    setting: BenchSetting

    @property
    def name(self) -> str:
        """Human-readable name, unique within one version of the program."""
        pair = f"{self.seed:06d}" if self.index is None else f"{self.seed:06d}-{self.index:03d}"
        return f"{self.family}-{pair}-{self.setting.name}"

    def id(self, version: str) -> str:
        """Return a key that is equal when scene, task, seed, setting and all other inputs of the outcome are.

        Scene and task follow from family, seed and index by code and data, which the version stands for.
        """
        parts = [SCHEMA, version, self.family, str(self.seed), str(self.index), self.setting.name]
        return content_key(*parts)

    def to_json(self) -> dict[str, Any]:
        """Return the unit as plain data."""
        return asdict(self)

    @classmethod
    def from_json(cls, value: Mapping[str, Any]) -> Unit:
        """Parse the unit that `to_json` returned.

        Raises:
            ValueError: It is no such data.
        """
        unit = adapter(cls).validate_python(value)
        if (unit.index is None) is not (unit.family in LONG_HORIZON):
            raise ValueError(f"{unit.family} has no unit {unit.index}")
        return unit


@dataclass(frozen=True, slots=True)
class Series:
    """Consecutive units of one family in one setting: one cell of the table.

    Attributes:
        family: "T1" to "T6".
        seed: Seed of the first episode, or of the first set of pairs.
        episodes: Number of units.
        setting: Their setting.
        version: Version of the program.
    """

    family: Family
    seed: Seed
    episodes: Annotated[StrictInt, Field(ge=0, le=MOST_EPISODES)]
    setting: BenchSetting
    version: str

    def units(self) -> Iterator[Unit]:
        """Yield the units in order; those of T5 and T6 go through one set of pairs after the other."""
        if self.family in LONG_HORIZON:
            for seed in range(self.seed, self.seed + self.episodes):
                yield Unit(self.family, seed, None, self.setting)
            return
        indices = indices_of(self.family)
        for number in range(self.episodes):
            beyond, place = divmod(number, len(indices))
            yield Unit(self.family, self.seed + beyond, indices[place], self.setting)

    def to_json(self) -> dict[str, Any]:
        """Return the series as plain data."""
        return asdict(self)

    @classmethod
    def from_json(cls, value: Mapping[str, Any]) -> Series:
        """Parse the series that `to_json` returned.

        Raises:
            ValueError: It is no such data.
        """
        return adapter(cls).validate_python(value)


def pair_of(
    family: str,
    seed: int,
    index: int | None,
    *,
    keep_sizes: bool = False,
    full_size: bool = False,
    changes: LayoutChanges = UNCHANGED,
) -> ScenePair:
    """Return a scene-task pair; equal arguments give equal pairs.

    Args:
        family: "T1" to "T6".
        seed: For T1 to T4 the episode's seed; for T5 and T6 that of the set of pairs.
        index: Position in the set; None for T1 to T4.
        keep_sizes: Whether nothing is scaled to the gripper.
        full_size: Whether the robot is of full size.
        changes: Deviations from what the seed alone gives.

    Raises:
        NotDrawn: No room could be drawn for this seed.
    """
    if index is None:
        return long_horizon.draw(family, seed, keep_sizes=keep_sizes, full_size=full_size, changes=changes)
    return household.pair(seed, index, keep_sizes=keep_sizes, full_size=full_size, changes=changes)


@cache
def indices_of(family: str) -> tuple[int, ...]:
    """Return the indices of a household family's pairs in a set, in order."""
    wishes = [wish for layout in household.layouts() for wish in layout.wishes]
    return tuple(index for index, wish in enumerate(wishes) if wish.family == family)


OUTCOME_VERSION = 1
"""Raised by hand where a change alters how an episode goes; frozen outcomes (`make golden`) fail where it was not."""
BASELINE_VERSION = 1
"""Raised by hand whenever a change alters what a baseline does with an episode."""
EVALUATION_VERSION = 1
"""Raised by hand whenever a change alters how a policy is evaluated or what a trained one does."""
_LIBRARIES = ("sapien", "numpy", "scipy", "trimesh", "example-robot-data")


@cache
def outcome_version(*more: object) -> str:
    """Return 16 hexadecimal digits that change when a stored result may not be repeated exactly.

    Args:
        more: Further constants that decide a measurement, and not an episode's outcome.
    """
    versions = [f"{library} {_version_of(library)}" for library in _LIBRARIES]
    return content_key(json_text([OUTCOME_VERSION, *more, *versions]))


def _version_of(library: str) -> str:
    try:
        return metadata.version(library)
    except metadata.PackageNotFoundError:
        return "missing"
