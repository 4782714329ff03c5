"""What a benchmark consists of: units with names for people, and ids that change when their outcome may."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from functools import cache
from importlib import metadata
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, StrictBool, StrictInt

from executor.machine.files import content_key
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


_PACKAGES = ("bddl", "oag", "llm", "executor")
# What only shows, draws, stores or counts.
_WITHOUT_A_SAY = (
    *("executor/bench", "executor/cli", "executor/pictures", "executor/results", "executor/machine/workers"),
    *("executor/datasets/formats", "executor/datasets/upkeep", "executor/envs", "executor/policies"),
    "executor/baselines",
)
# Of the benchmark, what makes the scene, the task and the flows has a say, and what prepares the process.
_WITH_A_SAY = (
    "executor/bench/data/initial_flows.json",
    "executor/bench/units.py",
    "executor/bench/paper.py",
    "executor/bench/work.py",
    "executor/bench/worker.py",
)
_LIBRARIES = ("sapien", "numpy", "scipy", "trimesh", "example-robot-data")


@cache
def running_version() -> str:
    """Return the `outcome_version` that this process runs: that of the files when it asked first.

    A worker asks before it takes a request, so that a change of the files does not pass for what it has loaded.
    """
    return outcome_version()


def version_with(*rooms: str) -> str:
    """Return 16 hexadecimal digits that change when `outcome_version` or a module of some rooms does.

    Args:
        rooms: Folders of the executor that have a say in a measurement, and none in an episode's outcome.
    """
    executor = Path(__file__).resolve().parents[1]
    files = sorted(path for room in rooms for path in (executor / room).rglob("*.py"))
    return content_key(outcome_version(), *(path.read_bytes() for path in files))


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
