"""What a benchmark consists of: units with names for people, and ids that change when their outcome may."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from functools import cache
from importlib import metadata
from pathlib import Path
from typing import Any, Literal, get_args

from executor.machine.files import content_key
from executor.scenes import household, long_horizon
from executor.scenes.pair import ScenePair
from executor.scenes.vary import LARGEST_SEED, MOST_EPISODES

LONG_HORIZON = ("T1", "T2", "T3", "T4")
HOUSEHOLD = ("T5", "T6")
FAMILIES = LONG_HORIZON + HOUSEHOLD
SCHEMA = "scene2demo-bench-unit/1"

Flows = Literal["planned", "paper"]


@dataclass(frozen=True, slots=True)
class BenchSetting:
    """How the units of one row of the table are run.

    Attributes:
        flows: The offline planner's flows, or the paper's, numbers verbatim.
        evolve: Whether flows that fail are revised.
        views: Whether three cameras' pictures are drawn of every success.
    """

    flows: Flows = "planned"
    evolve: bool = False
    views: bool = False

    @property
    def name(self) -> str:
        """A short name, fit for files."""
        return "-".join([self.flows, *(["evolve"] if self.evolve else []), *(["views"] if self.views else [])])

    @property
    def label(self) -> str:
        """What the row is called in the table."""
        flows = "planned flows" if self.flows == "planned" else "paper's flows"
        return f"here: {flows}{' + evo' if self.evolve else ''}{' + pictures' if self.views else ''}"


@dataclass(frozen=True, slots=True)
class Unit:
    """One episode of a benchmark.

    Attributes:
        family: "T1" to "T6".
        seed: Of T1 to T4 the episode's seed; of T5 and T6 that of the set of pairs.
        index: Position of the pair in its set; None for T1 to T4.
        setting: How it is run.
    """

    family: str
    seed: int
    index: int | None
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
            KeyError, TypeError, ValueError: It did not give this.
        """
        unit = cls(value["family"], value["seed"], value["index"], _setting(value))
        _require_number("seed", unit.seed, LARGEST_SEED)
        if unit.family in HOUSEHOLD:
            _require_number("index", unit.index, household.COUNT - 1)
        elif unit.family not in LONG_HORIZON or unit.index is not None:
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

    family: str
    seed: int
    episodes: int
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
            KeyError, TypeError, ValueError: It did not give this.
        """
        series = cls(value["family"], value["seed"], value["episodes"], _setting(value), str(value["version"]))
        if series.family not in FAMILIES:
            raise ValueError(f"{series.family} is no family")
        _require_number("seed", series.seed, LARGEST_SEED)
        _require_number("episodes", series.episodes, MOST_EPISODES)
        return series


def _setting(value: Mapping[str, Any]) -> BenchSetting:
    setting = BenchSetting(**value["setting"])
    if setting.flows not in get_args(Flows) or not (type(setting.evolve) is type(setting.views) is bool):
        raise ValueError(f"{setting} is no setting")
    return setting


def _require_number(name: str, value: object, most: int) -> None:
    if type(value) is not int or not 0 <= value <= most:
        raise ValueError(f"{name} {value!r:.40} is no whole number from 0 to {most}")


def pair_of(family: str, seed: int, index: int | None) -> ScenePair:
    """Returns a scene-task pair; equal arguments give equal pairs.

    Args:
        family: "T1" to "T6".
        seed: Of T1 to T4 the episode's seed; of T5 and T6 that of the set of pairs.
        index: Position in the set; None for T1 to T4.

    Raises:
        NotDrawn: No room could be made of this seed.
    """
    return long_horizon.draw(family, seed) if index is None else household.pair(seed, index)


@cache
def indices_of(family: str) -> tuple[int, ...]:
    """Returns the positions of a household family's pairs in a set, in order."""
    wishes = [wish for layout in household.layouts() for wish in layout.wishes]
    return tuple(index for index, wish in enumerate(wishes) if wish.family == family)


_PACKAGES = ("bddl", "oag", "llm", "executor")
# What only shows, draws, stores or counts.
_WITHOUT_A_SAY = ("executor/bench", "executor/cli", "executor/pictures", "executor/results", "executor/machine/workers")
# Of the benchmark, what makes the scene, the task and the flows has a say, and what prepares the process.
_WITH_A_SAY = (
    "executor/bench/data/initial_flows.json",
    "executor/bench/units.py",
    "executor/bench/paper.py",
    "executor/bench/work.py",
    "executor/bench/worker.py",
)
_LIBRARIES = ("sapien", "numpy", "scipy", "trimesh", "example-robot-data")


def outcome_version() -> str:
    """Returns 16 hexadecimal digits that change when a result of before may not be repeated exactly."""
    root = Path(__file__).resolve().parents[2]
    parts: list[bytes | str] = []
    for package in _PACKAGES:
        for path in sorted((root / package).rglob("*")):
            name = path.relative_to(root).as_posix()
            if path.is_file() and "__pycache__" not in name and _matters(name):
                parts += [name, path.read_bytes()]
    for library in _LIBRARIES:
        try:
            parts.append(f"{library} {metadata.version(library)}")
        except metadata.PackageNotFoundError:
            parts.append(f"{library} missing")
    return content_key(*parts)


def _matters(name: str) -> bool:
    return name in _WITH_A_SAY or not name.startswith(tuple(f"{folder}/" for folder in _WITHOUT_A_SAY))
