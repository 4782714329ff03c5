"""What is generated: one unit a demonstration, which says all that decides what comes of it."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, field, replace
from itertools import product
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, StrictBool, StrictFloat, StrictInt

from executor.bench.units import HOUSEHOLD, LONG_HORIZON, Family, Seed, indices_of
from executor.datasets.variation import Variation
from executor.machine.files import content_key, json_text, plain
from executor.pictures.cameras import VIEWS
from executor.scenes.vary import MOST_EPISODES
from oag import Scene
from oag.model.forms import adapter

SCHEMA = "scene2demo-demonstration/1"
MOST_STANCES = 32
View = Literal["global", "head", "wrist"]
Pushed = Literal["base", "item"]
"""What pushes in the middle of an episode are at: the robot's base, or the item that the task is about."""

Side = Annotated[StrictInt, Field(ge=32, le=1024, multiple_of=2)]


@dataclass(frozen=True, slots=True)
class Recording:
    """What is kept of an episode.

    Attributes:
        rate_hz: Samples a second of simulated time.
        views: Cameras that pictures are drawn of; none by default.
        size: Width and height of the pictures.
        depth, segmentation: Whether these are drawn beside the colours.
        failures: Whether the samples of failed episodes are kept too; what ended them always is.
    """

    rate_hz: Annotated[StrictFloat | StrictInt, Field(ge=1, le=250)] = 10
    views: tuple[View, ...] = ()
    size: tuple[Side, Side] = (128, 128)
    depth: StrictBool = True
    segmentation: StrictBool = True
    failures: StrictBool = False

    def __post_init__(self) -> None:
        if len(set(self.views)) != len(self.views):
            raise ValueError(f"a view is named twice; the views are {', '.join(VIEWS)}")


@dataclass(frozen=True, slots=True)
class Origin:
    """Where scene and task come from: a benchmark family, or a sentence in a scene.

    Attributes:
        family: "T1" to "T6", or None for a sentence of one's own.
        query: The sentence; empty for a family, which has its own.
        scene: Name of a scene, or its file; empty for a family, which draws its own.
        scene_key: Key of the scene's content, so that another content makes another unit; empty where seeds draw it.
    """

    family: Family | None = None
    query: str = ""
    scene: str = ""
    scene_key: str = ""

    def __post_init__(self) -> None:
        if (self.family is None) is not bool(self.query and self.scene):
            raise ValueError("a source is a family, or a query and a scene")

    @property
    def label(self) -> str:
        """A short name, fit for files."""
        return self.family or re.sub(r"[^a-z0-9]+", "-", self.query.casefold()).strip("-")[:40]


def scene_key(scene: Scene) -> str:
    """Return the key of a scene's content."""
    return content_key(json_text(scene.to_json()))


@dataclass(frozen=True, slots=True)
class Takeover:
    """Who acts before the planner does: a policy, from the episode's start up to where it begins anew or stalls.

    Attributes:
        policy: Key of its weights and of all that it is.
        execute: How many actions of a chunk it does before it looks again.
        pushes: What is pushed once while it acts, each at a time and in a direction that the unit's seed draws.
    """

    policy: str
    execute: Annotated[StrictInt, Field(ge=1, le=64)]
    pushes: tuple[Pushed, ...] = ()


@dataclass(frozen=True, slots=True)
class DemoUnit:
    """One demonstration to generate.

    Attributes:
        origin: Where scene and task come from.
        seed: Of the layout, of what varies, and of all planning; of T5 and T6 that of the set of pairs.
        index: Position of the pair in its set; None unless the family is T5 or T6.
        variation: What else is varied.
        recording: What is kept.
        evolve: Whether flows that fail are revised; failed attempts and corrections are kept as episodes of their own.
        flows: The offline planner's flows, or the paper's, numbers verbatim.
        keep_sizes: Whether what is taken keeps its size.
        full_size: Whether the robot is of full size, whatever the scene has.
        stances: How many are planned wherever one is chosen (`Session.stances`), so that the choice follows from what
            is seen. 1 takes the one that the unit's seed gives.
        takeover: Who brought the world to where the planner begins; None for an episode from its start.
    """

    origin: Origin
    seed: Seed
    index: Annotated[StrictInt, Field(ge=0)] | None = None
    variation: Variation = field(default_factory=Variation)
    recording: Recording = field(default_factory=Recording)
    evolve: StrictBool = False
    flows: Literal["planned", "paper"] = "planned"
    keep_sizes: StrictBool = False
    full_size: StrictBool = False
    stances: Annotated[StrictInt, Field(ge=1, le=MOST_STANCES)] = 1
    takeover: Takeover | None = None

    def __post_init__(self) -> None:
        if self.takeover is not None and (self.evolve or self.flows == "paper"):
            raise ValueError("a plan that goes on from where a policy came to is the planner's, and no flow is revised")
        if (self.index is None) is not (self.origin.family not in HOUSEHOLD):
            raise ValueError(f"{self.origin.label} has no unit {self.index}")
        if self.flows == "paper" and self.origin.family not in LONG_HORIZON:
            raise ValueError(f"the paper prints no flows for {self.origin.label}")

    @property
    def name(self) -> str:
        """A name for people."""
        pair = f"{self.seed:06d}" if self.index is None else f"{self.seed:06d}-{self.index:03d}"
        return f"{self.origin.label}-{pair}"

    def id(self, version: str) -> str:
        """Returns a key that is equal when everything that decides what comes of the unit is, its recording included.

        Args:
            version: Hash of the program (`executor.bench.units.outcome_version`).
        """
        data = self.to_json()
        if self.origin.scene_key:
            data["origin"]["scene"] = ""  # Its content says which scene it is, wherever its file lies.
        return _id_of(data, version)

    def ids(self, version: str) -> Iterator[str]:
        """Yield the unit's id, and then those of earlier programs, by which it may lie in a store.

        For these 10 and 10.0 were different requests, and so were views in another order and a copy of a scene's file.

        Args:
            version: Hash of the program.
        """
        yield self.id(version)
        for rate_hz, noise_m in product(_spellings(self.recording.rate_hz), _spellings(self.variation.noise_m)):
            data = self.to_json()
            data["recording"] |= {"rate_hz": rate_hz, "views": self.recording.views}
            data["variation"]["noise_m"] = noise_m
            yield _id_of(data, version)

    def folder(self, version: str) -> str:
        """Returns the name of the unit's folder: its own, and enough of its id to tell it from others of this name."""
        return self.folder_of(self.id(version))

    def folder_of(self, unit_id: str) -> str:
        """Return the name of the unit's folder under one of its ids."""
        return f"{self.name}-{unit_id[:8]}"

    def draws(self, axis: str) -> np.random.Generator:
        """Returns what draws a unit's value on an axis: it follows from origin, seed, index and axis, nothing else."""
        of = f"{self.origin.label} {axis}".encode()
        return np.random.default_rng((self.seed, 0 if self.index is None else self.index + 1, *of))

    def looks(self, axis: str) -> np.random.Generator:
        """Returns what draws how a unit looks on an axis."""
        return self.draws(f"{axis} {self.variation.look}" if self.variation.look else axis)

    def to_json(self) -> dict[str, Any]:
        """Returns the unit as plain data, equal units as equal texts, however their numbers were typed.

        A field that earlier programs did not have is left out where it has its default.
        """
        data: dict[str, Any] = plain(asdict(self))
        data["recording"]["rate_hz"] = _measure(data["recording"]["rate_hz"])
        data["recording"]["views"].sort(key=VIEWS.index)
        data["variation"]["noise_m"] = _measure(data["variation"]["noise_m"])
        if not self.variation.look:
            del data["variation"]["look"]
        if self.stances == 1:
            del data["stances"]
        if self.takeover is None:
            del data["takeover"]
        elif not self.takeover.pushes:
            del data["takeover"]["pushes"]
        return data

    @classmethod
    def from_json(cls, value: Mapping[str, Any]) -> DemoUnit:
        """Returns the unit that `to_json` gave.

        Raises:
            ValueError: It did not give this.
        """
        return adapter(cls).validate_python(value)


def _id_of(data: Mapping[str, Any], version: str) -> str:
    return content_key(SCHEMA, version, json_text(data))


def _measure(value: float) -> float:
    """Return a number as it is written: 10, 10.0 and 1e1 alike, and no zero with a sign; a truth value stays one."""
    return value if isinstance(value, bool) else float(value) + 0.0


def _spellings(value: float) -> tuple[float, ...]:
    """Return a number as programs wrote it that kept it as it was typed."""
    return (float(value), int(value)) if float(value).is_integer() else (value,)


@dataclass(frozen=True, slots=True)
class DemoSeries:
    """Units of one origin with consecutive seeds.

    Attributes:
        first: The unit of the first seed.
        episodes: How many.
    """

    first: DemoUnit
    episodes: Annotated[StrictInt, Field(ge=0, le=MOST_EPISODES)]

    def units(self) -> Iterator[DemoUnit]:
        """Yields the units in order; those of T5 and T6 go through one set of pairs after the other."""
        family = self.first.origin.family
        indices = indices_of(family) if family in HOUSEHOLD else (None,)
        for number in range(self.episodes):
            beyond, place = divmod(number, len(indices))
            yield replace(self.first, seed=self.first.seed + beyond, index=indices[place])

    def to_json(self) -> dict[str, Any]:
        """Returns the series as plain data."""
        return {"first": self.first.to_json(), "episodes": self.episodes}

    @classmethod
    def from_json(cls, value: Mapping[str, Any]) -> DemoSeries:
        """Returns the series that `to_json` gave.

        Raises:
            ValueError: It did not give this.
        """
        return adapter(cls).validate_python(value)
