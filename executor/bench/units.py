"""What a benchmark consists of: units with names for people, and ids that change when their outcome may."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from functools import cache
from importlib import metadata
from typing import Annotated, Any, Literal

from pydantic import Field, StrictBool, StrictInt

from executor.machine.files import content_key, json_text
from executor.scenes import household, long_horizon
from executor.scenes.pair import UNCHANGED, Changes, ScenePair
from executor.scenes.vary import LARGEST_SEED, MOST_EPISODES
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
"""What is done in the executor's place -> what the table calls it."""


@dataclass(frozen=True, slots=True)
class BenchSetting:
    """How the units of one row of the table are run.

    Attributes:
        flows: The offline planner's flows, or the paper's, numbers verbatim.
        evolve: Whether flows that fail are revised.
        views: Whether three cameras' pictures are drawn of every success.
        keep_sizes: Whether what is taken keeps its size.
        full_size: Whether the robot is of full size.
        baseline: What is done in the executor's place, where that is measured.
    """

    flows: Flows = "planned"
    evolve: StrictBool = False
    views: StrictBool = False
    keep_sizes: StrictBool = False
    full_size: StrictBool = False
    baseline: Baseline | None = None

    @property
    def name(self) -> str:
        """A short name, fit for files."""
        words = {"evolve": self.evolve, "views": self.views, "own-sizes": self.keep_sizes, "full-size": self.full_size}
        own = [self.flows] if self.baseline is None else [self.baseline]
        return "-".join([*own, *(word for word, said in words.items() if said)])

    @property
    def label(self) -> str:
        """What the row is called in the table."""
        own = "planned flows" if self.flows == "planned" else "paper's flows"
        if self.baseline is not None:
            own = BASELINES[self.baseline]
        words = {
            "evo": self.evolve,
            "pictures": self.views,
            "own sizes": self.keep_sizes,
            "full-size robot": self.full_size,
        }
        return " + ".join([f"here: {own}", *(word for word, said in words.items() if said)])


@dataclass(frozen=True, slots=True)
class Unit:
    """One episode of a benchmark.

    Attributes:
        family: "T1" to "T6".
        seed: Of T1 to T4 the episode's seed; of T5 and T6 that of the set of pairs.
        index: Position of the pair in its set; None for T1 to T4.
        setting: How it is run.
    """

    family: Family
    seed: Seed
    index: Annotated[StrictInt, Field(ge=0, lt=household.COUNT)] | None
    setting: BenchSetting

    @property
    def name(self) -> str:
        """A name for people, unique within one version of the program."""
        pair = f"{self.seed:06d}" if self.index is None else f"{self.seed:06d}-{self.index:03d}"
        return f"{self.family}-{pair}-{self.setting.name}"

    def id(self, version: str) -> str:
        """Returns a key that is equal when scene, task, seed, setting and everything that decides the outcome are.

        Scene and task follow from family, seed and index by code and data, which the version is a hash of.
        """
        parts = [SCHEMA, version, self.family, str(self.seed), str(self.index), self.setting.name]
        return content_key(*parts)

    def to_json(self) -> dict[str, Any]:
        """Returns the unit as plain data."""
        return asdict(self)

    @classmethod
    def from_json(cls, value: Mapping[str, Any]) -> Unit:
        """Returns the unit that `to_json` gave.

        Raises:
            ValueError: It did not give this.
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
        episodes: How many units.
        setting: How they are run.
        version: Hash of the program that ran them.
    """

    family: Family
    seed: Seed
    episodes: Annotated[StrictInt, Field(ge=0, le=MOST_EPISODES)]
    setting: BenchSetting
    version: str

    def units(self) -> Iterator[Unit]:
        """Yields the units in order; those of T5 and T6 go through one set of pairs after the other."""
        if self.family in LONG_HORIZON:
            for seed in range(self.seed, self.seed + self.episodes):
                yield Unit(self.family, seed, None, self.setting)
            return
        indices = indices_of(self.family)
        for number in range(self.episodes):
            beyond, place = divmod(number, len(indices))
            yield Unit(self.family, self.seed + beyond, indices[place], self.setting)

    def to_json(self) -> dict[str, Any]:
        """Returns the series as plain data."""
        return asdict(self)

    @classmethod
    def from_json(cls, value: Mapping[str, Any]) -> Series:
        """Returns the series that `to_json` gave.

        Raises:
            ValueError: It did not give this.
        """
        return adapter(cls).validate_python(value)


def pair_of(
    family: str,
    seed: int,
    index: int | None,
    *,
    keep_sizes: bool = False,
    full_size: bool = False,
    changes: Changes = UNCHANGED,
) -> ScenePair:
    """Returns a scene-task pair; equal arguments give equal pairs.

    Args:
        family: "T1" to "T6".
        seed: Of T1 to T4 the episode's seed; of T5 and T6 that of the set of pairs.
        index: Position in the set; None for T1 to T4.
        keep_sizes: Whether nothing is scaled to the gripper.
        full_size: Whether the robot is of full size.
        changes: How it differs from what the seed alone gives.

    Raises:
        NotDrawn: No room could be made of this seed.
    """
    if index is None:
        return long_horizon.draw(family, seed, keep_sizes=keep_sizes, full_size=full_size, changes=changes)
    return household.pair(seed, index, keep_sizes=keep_sizes, full_size=full_size, changes=changes)


@cache
def indices_of(family: str) -> tuple[int, ...]:
    """Returns the positions of a household family's pairs in a set, in order."""
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
