"""What a store has: how many episodes of what, how they ended, how long they are, what they take."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from typing import Any

from executor.datasets.store import EpisodeStore, StoredEpisode
from executor.datasets.units import DemoUnit
from executor.datasets.upkeep.variety import Variety
from oag import clopper_pearson


@dataclass
class Part:
    """Episodes of one origin.

    Attributes:
        query: A sentence of one of them.
        made, succeeded, kept: How many there are, how many reached the goal, and with motion kept.
        seeds: The first seed and the last.
        simulated_s: Of those that are kept.
    """

    query: str = ""
    made: int = 0
    succeeded: int = 0
    kept: int = 0
    seeds: tuple[int, int] | None = None
    simulated_s: float = 0.0

    def add(self, episode: StoredEpisode, unit: DemoUnit, *, kept: bool) -> None:
        """Counts an episode."""
        first, last = self.seeds or (unit.seed, unit.seed)
        self.seeds = (min(first, unit.seed), max(last, unit.seed))
        self.query = self.query or str(episode.meta.get("query") or unit.origin.query)
        self.made += 1
        self.succeeded += episode.succeeded
        if kept:
            self.kept += 1
            self.simulated_s += float(episode.meta["simulated_s"])


@dataclass
class Contents:
    """What a store has.

    Attributes:
        parts: Label of an origin -> its episodes.
        failures: How many failed, by kind.
        store_bytes: What the folders of all units take.
        samples: Of what is kept.
        rates_hz, scales, versions, programs: What occurs: rates, scales of the robot, versions of libraries, hashes of
            the program.
        views: In how many of what is kept: cameras.
        varieties: Label of an origin -> what differs between its demonstrations.
        scaled: Category of things whose size was drawn or fitted to the gripper -> the least factor and the largest.
        asked: How many episodes were asked for.
        repeats: How many demonstrations are not counted as such, since they have another one's states, sentence and
            pictures.
    """

    parts: dict[str, Part] = field(default_factory=dict)
    failures: Counter[str] = field(default_factory=Counter)
    store_bytes: int = 0
    samples: int = 0
    rates_hz: set[float] = field(default_factory=set)
    scales: set[float] = field(default_factory=set)
    views: Counter[str] = field(default_factory=Counter)
    versions: set[tuple[str, str]] = field(default_factory=set)
    programs: set[str] = field(default_factory=set)
    varieties: dict[str, Variety] = field(default_factory=dict)
    scaled: dict[str, tuple[float, float]] = field(default_factory=dict)
    asked: int = 0
    repeats: int = 0

    @property
    def made(self) -> int:
        """How many episodes there are."""
        return sum(part.made for part in self.parts.values())

    @property
    def succeeded(self) -> int:
        """How many of them reached their goals."""
        return sum(part.succeeded for part in self.parts.values())

    @property
    def kept(self) -> int:
        """How many demonstrations there are to export."""
        return sum(part.kept for part in self.parts.values())

    def to_json(self) -> dict[str, Any]:
        """Returns all of it as plain data."""
        return {
            "asked": self.asked,
            "made": self.made,
            "succeeded": self.succeeded,
            "kept": self.kept,
            "repeats": self.repeats,
            "yield_interval": list(clopper_pearson(self.succeeded, self.made)) if self.made else None,
            "failures": dict(sorted(self.failures.items())),
            "simulated_s": round(sum(part.simulated_s for part in self.parts.values()), 3),
            "samples": self.samples,
            "bytes": self.store_bytes,
            "rates_hz": sorted(self.rates_hz),
            "views": dict(sorted(self.views.items())),
            "variety": {label: variety.to_json() for label, variety in sorted(self.varieties.items())},
            "programs": sorted(self.programs),
            "versions": [list(pair) for pair in sorted(self.versions)],
            "scaled": {name: list(span) for name, span in sorted(self.scaled.items())},
            "parts": {
                label: {
                    "query": part.query,
                    "made": part.made,
                    "succeeded": part.succeeded,
                    "kept": part.kept,
                    "seeds": part.seeds,
                    "simulated_s": round(part.simulated_s, 3),
                }
                for label, part in sorted(self.parts.items())
            },
        }


def contents_of(store: EpisodeStore) -> Contents:
    """Returns what a store has.

    Raises:
        NotADataset: It is none, or an episode cannot be read.
    """
    found = Contents(asked=sum(int(request["episodes"]) for request in store.requests()))
    known: set[str] = set()
    for episode in store.episodes():
        kept = episode.succeeded and episode.has_samples
        if kept and episode.demonstration_key in known:
            found.repeats, kept = found.repeats + 1, False
        elif kept:
            known.add(episode.demonstration_key)
        _count(found, episode, kept=kept)
    return found


def _count(found: Contents, episode: StoredEpisode, *, kept: bool) -> None:
    meta, unit = episode.meta, DemoUnit.from_json(episode.meta["unit"])
    found.parts.setdefault(unit.origin.label, Part()).add(episode, unit, kept=kept)
    found.store_bytes += sum(file.stat().st_size for file in episode.path.rglob("*") if file.is_file())
    found.programs.add(str(meta["version"]))
    if not episode.succeeded:
        found.failures[str((meta.get("failure") or {}).get("kind") or meta["ended"])] += 1
    if not kept:
        return
    found.samples += int(meta["samples"])
    found.rates_hz.add(float(meta["record_hz"]))
    found.scales.add(float(meta["robot"]["scale"]))
    found.views.update(unit.recording.views)
    found.versions.update((str(name), str(version)) for name, version in meta["versions"].items())
    found.varieties.setdefault(unit.origin.label, Variety()).add(meta)
    objects = meta["scene"]["objects"]
    for change in meta["scaled"]:
        category = objects[change["object_id"]]["category"]
        least, most = found.scaled.get(category, (float("inf"), 0.0))
        found.scaled[category] = (min(least, *change["factors"]), max(most, *change["factors"]))
