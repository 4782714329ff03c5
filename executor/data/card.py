"""Contents of a store, variety between its demonstrations, and the data card.

Variety is measured from what each demonstration records. Requests are not trusted: an axis that drew the same value
every time did not vary, nor did colours without pictures.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

from executor.campaign.rate import Rate
from executor.data.store import EpisodeStore, StoredEpisode
from executor.data.units import DemoUnit
from executor.geometry import heading_of, transform_from_quaternion
from executor.system.files import content_key, json_text
from oag.measurements import clopper_pearson
from oag.model.robots import robot_of_record

_MOST_RANGES = 6
_LOOKS = ("lights", "surfaces", "cameras")
# Labels on the card of quantities that may differ, in this order.
QUANTITIES = (
    *("sentence", "things in the room", "models", "sizes", "places of things", "headings of things", "parameters"),
    *("robot's start", "target", "distractors", "physics", "noise", *_LOOKS, "motion"),
)


@dataclass
class VariedQuantity:
    """A quantity that may differ between demonstrations.

    Attributes:
        values: Keys of the values that occur.
        ranges: Name of a number -> its minimum and maximum.
    """

    values: set[str] = field(default_factory=set)
    ranges: dict[str, tuple[float, float]] = field(default_factory=dict)

    def add(self, value: object) -> None:
        """Count one demonstration's value."""
        self.values.add(content_key(json_text(value)))
        for name, number in _numbers(value):
            least, most = self.ranges.get(name, (number, number))
            self.ranges[name] = (min(least, number), max(most, number))

    def to_json(self) -> dict[str, Any]:
        """Return the number of values, and the ranges of the numbers that differ."""
        return {"values": len(self.values), "ranges": {name: list(span) for name, span in self._differing()}}

    @property
    def words(self) -> str:
        """The ranges that are widest, in words."""
        spans = sorted(self._differing(), key=lambda one: (one[1][0] - one[1][1], one[0]))
        parts = [f"{name} {least:.3g} to {most:.3g}" for name, (least, most) in spans[:_MOST_RANGES]]
        more = len(spans) - _MOST_RANGES
        return ", ".join(parts) + (f", and {more} more" if more > 0 else "")

    def _differing(self) -> Iterator[tuple[str, tuple[float, float]]]:
        return ((name, span) for name, span in sorted(self.ranges.items()) if span[0] < span[1])


@dataclass
class Variety:
    """Differences between the demonstrations of one origin.

    Attributes:
        count: Number of demonstrations.
        quantities: Name of a quantity -> its values.
    """

    count: int = 0
    quantities: dict[str, VariedQuantity] = field(
        default_factory=lambda: {name: VariedQuantity() for name in QUANTITIES}
    )

    def add(self, meta: Mapping[str, Any]) -> None:
        """Count a demonstration by its `unit.json`."""
        self.count += 1
        for name, value in _drawn(meta).items():
            self.quantities[name].add(value)

    @property
    def varied(self) -> dict[str, VariedQuantity]:
        """Quantities that differ."""
        return {name: found for name, found in self.quantities.items() if len(found.values) > 1}

    @property
    def same(self) -> tuple[str, ...]:
        """Quantities that are present and equal in all of them."""
        return tuple(name for name, found in self.quantities.items() if len(found.values) == 1)

    def to_json(self) -> dict[str, Any]:
        """Return it as plain data."""
        return {"varied": {name: found.to_json() for name, found in self.varied.items()}, "same": list(self.same)}


def _drawn(meta: Mapping[str, Any]) -> dict[str, Any]:
    """Return each quantity's value in a demonstration, from its own record."""
    scene, drawn, pictures = meta["scene"], meta.get("drawn") or {}, meta.get("pictures") or {}
    things: Mapping[str, Mapping[str, Any]] = scene["objects"]
    x, y, *_ = scene["robot"]["position"]
    found: dict[str, Any] = {
        "sentence": meta.get("query"),
        "things in the room": {name: thing["category"] for name, thing in things.items()},
        "models": {name: thing["model"] for name, thing in things.items()},
        "sizes": {name: _named(_size(thing), "width_m", "depth_m", "height_m") for name, thing in things.items()},
        "places of things": {name: _named(thing["position"], "x_m", "y_m", "z_m") for name, thing in things.items()},
        "headings of things": {name: {"yaw_rad": _yaw_rad(thing)} for name, thing in things.items()},
        "parameters": {name: thing["parameters"] for name, thing in things.items() if thing.get("parameters")},
        "robot's start": {"x_m": x, "y_m": y, "yaw_rad": scene["robot"]["yaw"]},
        "motion": meta["state_hash"],
        **{name: drawn[name] for name in ("target", "distractors", "physics") if name in drawn},
    }
    if "noise" in drawn:
        # The noise's seed is not a quantity.
        found["noise"] = {**drawn["noise"], "seed": str(drawn["noise"]["seed"])}
    if views := pictures.get("views"):
        found["cameras"] = {name: view.get("T_mount_camera") for name, view in views.items()}
        found |= {name: pictures.get(name) for name in ("lights", "surfaces")}
    return found


def _size(thing: Mapping[str, Any]) -> list[float]:
    return [round(side * factor, 6) for side, factor in zip(thing["bbox_extent"], thing["scale"], strict=True)]


def _yaw_rad(thing: Mapping[str, Any]) -> float:
    return round(heading_of(transform_from_quaternion(thing["position"], thing["orientation"])[:3, 0]), 6)


def _named(values: Any, *names: str) -> dict[str, float]:
    return {name: round(value, 6) for name, value in zip(names, values, strict=True)}


def _numbers(value: object, name: str = "") -> Iterator[tuple[str, float]]:
    """Yield the numbers in plain data, each with its path of names."""
    if isinstance(value, Mapping):
        for key, entry in value.items():
            yield from _numbers(entry, f"{name} {key}".strip())
    elif isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value):
        yield name, float(value)


@dataclass
class Part:
    """Episodes of one origin.

    Attributes:
        query: A sentence of one of them.
        made, succeeded, kept: Number of episodes, of successes, and of those with motion.
        seeds: The first seed and the last.
        simulated_s: Simulated time of those that are kept [s].
    """

    query: str = ""
    made: int = 0
    succeeded: int = 0
    kept: int = 0
    seeds: tuple[int, int] | None = None
    simulated_s: float = 0.0

    def add(self, episode: StoredEpisode, unit: DemoUnit, *, kept: bool) -> None:
        """Count an episode."""
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
    """Contents of a store.

    Attributes:
        parts: Label of an origin -> its episodes.
        failures: Failures by kind.
        store_bytes: Bytes of all units' folders.
        samples: Samples of kept episodes.
        rates_hz, robots, versions, programs: Values that occur: rates, robots in words, versions of libraries,
            hashes of the program.
        views: Camera -> number of kept episodes with it.
        varieties: Label of an origin -> differences between its demonstrations.
        scaled: Category of things whose size was drawn or fitted to the gripper -> the minimum and maximum factor.
        asked: Number of requested episodes, or of successes where these were requested.
        audited: Verdict of an audit -> number of episodes with it.
        repeats: Number of demonstrations that duplicate the states, sentence and pictures of another one; they are not
            counted.
    """

    parts: dict[str, Part] = field(default_factory=dict)
    failures: Counter[str] = field(default_factory=Counter)
    store_bytes: int = 0
    samples: int = 0
    rates_hz: set[float] = field(default_factory=set)
    robots: set[str] = field(default_factory=set)
    views: Counter[str] = field(default_factory=Counter)
    versions: set[tuple[str, str]] = field(default_factory=set)
    programs: set[str] = field(default_factory=set)
    varieties: dict[str, Variety] = field(default_factory=dict)
    scaled: dict[str, tuple[float, float]] = field(default_factory=dict)
    asked: int = 0
    audited: Counter[str] = field(default_factory=Counter)
    repeats: int = 0

    @property
    def made(self) -> int:
        """Number of episodes."""
        return sum(part.made for part in self.parts.values())

    @property
    def succeeded(self) -> int:
        """Number of episodes that reached their goals."""
        return sum(part.succeeded for part in self.parts.values())

    @property
    def kept(self) -> int:
        """Number of demonstrations to export."""
        return sum(part.kept for part in self.parts.values())

    def to_json(self) -> dict[str, Any]:
        """Return all of it as plain data."""
        return {
            "asked": self.asked,
            "made": self.made,
            "succeeded": self.succeeded,
            "kept": self.kept,
            "repeats": self.repeats,
            "yield_interval": list(clopper_pearson(self.succeeded, self.made)) if self.made else None,
            "failures": dict(sorted(self.failures.items())),
            "audited": dict(sorted(self.audited.items())),
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
                label: {**asdict(part), "simulated_s": round(part.simulated_s, 3)}
                for label, part in sorted(self.parts.items())
            },
        }


def contents_of(store: EpisodeStore) -> Contents:
    """Summarise a store.

    Raises:
        NotADataset: It is none, or an episode is unreadable.
    """
    found = Contents(asked=sum(int(request.get("successes") or request["episodes"]) for request in store.requests()))
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
    if (audited := episode.audited) is not None:
        found.audited[str(audited["verdict"])] += 1
    if not episode.succeeded:
        found.failures[str((meta.get("failure") or {}).get("kind") or meta["ended"])] += 1
    if not kept:
        return
    found.samples += int(meta["samples"])
    found.rates_hz.add(float(meta["record_hz"]))
    found.robots.add(robot_of_record(meta["robot"]).words)
    found.views.update(unit.recording.views)
    found.versions.update((str(name), str(version)) for name, version in meta["versions"].items())
    found.varieties.setdefault(unit.origin.label, Variety()).add(meta)
    objects = meta["scene"]["objects"]
    for change in meta["scaled"]:
        category = objects[change["object_id"]]["category"]
        least, most = found.scaled.get(category, (float("inf"), 0.0))
        found.scaled[category] = (min(least, *change["factors"]), max(most, *change["factors"]))


CARD = "README.md"

_FRONT = """---
license: apache-2.0
task_categories:
- robotics
tags:
- scene2demo
- simulation
- mobile-manipulation
{extra}---
"""
_LEROBOT = "- LeRobot\nconfigs:\n- config_name: default\n  data_files: data/*/*.parquet\n"
_FIELDS = (
    ("observation.state", "20", "m, rad", "12 joints; the hand in the world: x y z, quaternion x y z w; opening"),
    ("observation.velocity", "12", "m/s, rad/s", "of the joints"),
    (
        "observation.environment_state",
        "216",
        "m, rad",
        "12 things and 8 handles in the world, what the task names first",
    ),
    (
        "observation.object_poses",
        "7 M",
        "m",
        "what can be moved, in the world; `object_ids` of the episode has the order",
    ),
    (
        "observation.joint_positions",
        "J",
        "rad or m",
        "of articulated things; `joint_names` of the episode has the order",
    ),
    ("observation.camera_pose_VIEW", "7", "m", "the camera in the world, where pictures were drawn"),
    ("observation.point_cloud", "1024 4", "m", "from the base, and 1 on the hand; where it was asked for"),
    ("action", "10", "m, rad", "hand: 3 of position, 3 of rotation, from the base; gripper; base: 3, in its own axes"),
    ("action.joint_target", "12", "m, rad", "where the joints shall be at the next row"),
    ("subtask_index, primitive_index", "1", "", "what was going on; a primitive's number in flows, 0 for none"),
    ("next.reward, next.done", "1", "", "1 / number of subtasks at the end of each; true in the last row"),
    ("observation.images.VIEW", "H W 3", "RGB", "where pictures were drawn"),
    ("observation.depth.VIEW", "H W", "mm", "along the camera's axis, 0 for nothing; where it was asked for"),
    ("observation.segmentation.VIEW", "H W", "", "number of a body, in the episode's legend; where it was asked for"),
)


def card(text: str, kind: str | None = None) -> str:
    """Return a data set's card in Markdown: its page, after the header that readers of formats expect.

    Args:
        text: The page, from `page`.
        kind: The format of the export, or None for the store itself.
    """
    tag = "" if kind is None else f"- {kind}\n"
    return (
        _FRONT.format(extra=tag + (_LEROBOT if kind is not None and kind.startswith("lerobot") else "")) + "\n" + text
    )


def page(store: EpisodeStore) -> str:
    """Return the text of a data set's card, whatever its format, without time and place of its making.

    Raises:
        NotADataset: It is no store, or an episode is unreadable.
    """
    found = contents_of(store)
    sections = (
        _summary(found),
        _yields(found),
        _provenance(found),
        _variety(found),
        _sizes(found),
        "## Fields\n\n" + _table(("field", "shape", "unit", "what"), _FIELDS),
    )
    return "\n\n".join(sections) + "\n"


def _summary(found: Contents) -> str:
    simulated_s = sum(part.simulated_s for part in found.parts.values())
    rates = ", ".join(f"{rate:g}" for rate in sorted(found.rates_hz)) or "-"
    robots = " or ".join(sorted(found.robots)) or "robot"
    more = f"{found.repeats} more repeat one of these, state by state, and are left out. " if found.repeats else ""
    words = f"{found.kept} demonstrations, {simulated_s / 60:.1f} minutes of simulated time, {found.samples} samples"
    return (
        "# Demonstrations by Scene2Demo\n\n"
        f"{words} at {rates} Hz. {more}Views: {shares(found.views, found.kept)}. "
        f"A mobile {robots}, in the SAPIEN simulator. Every plan was proved before anything "
        "moved, and every goal was judged in the physics, everything at rest. One demonstration in ten, chosen by its "
        "id, is for validation; they come last, and none has the states of one for training.\n\nLicence: Apache-2.0."
    )


def _yields(found: Contents) -> str:
    rows = []
    for label, part in sorted(found.parts.items()):
        first, last = part.seeds or (0, 0)
        rows.append((label, part.query, f"{first} to {last}", part.made, part.kept, _share(part.succeeded, part.made)))
    rows.append(("all", "", "", found.made, found.kept, _share(found.succeeded, found.made)))
    head = ("origin", "such as", "seeds", "made", "demonstrations", "succeeded (95 % interval)")
    failures = [(kind, count) for kind, count in sorted(found.failures.items())]
    words = _table(("failure", "episodes"), failures) if failures else "No episode failed."
    audited = ", ".join(f"{count} {word}" for word, count in found.audited.most_common())
    verdicts = f"\n\nAudited: {audited}." if audited else ""
    return f"## Yield\n\n{_table(head, rows)}\n\n{words}{verdicts}"


def _provenance(found: Contents) -> str:
    versions = ", ".join(f"{name} {version}" for name, version in sorted(found.versions)) or "-"
    return (
        "## How it was made\n\n"
        f"Program: {', '.join(sorted(found.programs)) or '-'} (hash of what decides how an episode goes). "
        f"Libraries: {versions}. Everything follows from the seeds: the same command makes the same episodes."
    )


def _variety(found: Contents) -> str:
    """Return the section on variety, from the demonstrations' own records."""
    rows, notes = [], []
    for label, variety in sorted(found.varieties.items()):
        of = variety.count
        rows += [(label, name, f"{len(one.values)} in {of}", one.words) for name, one in variety.varied.items()]
        same = f"the same in all {of}: {', '.join(variety.same) or 'nothing'}" if of > 1 else "one demonstration only"
        notes.append(f"{label}: {same}.")
    table = (
        _table(("origin", "what differs", "different values", "numbers that differ most"), rows) + "\n\n"
        if rows
        else ""
    )
    return f"## What varies\n\n{table}{' '.join(notes) or 'There is no demonstration.'}"


def _sizes(found: Contents) -> str:
    rows = [(name, f"{least:.3g} to {most:.3g}") for name, (least, most) in sorted(found.scaled.items())]
    words = _table(("category", "factor"), rows) if rows else "Nothing was scaled."
    return f"## Sizes that were drawn, or fitted to the gripper\n\n{words}"


def shares(found: Mapping[str, int], of: int) -> str:
    """Return names in order, with their counts where not all have them; "none" for no names."""
    return ", ".join(name if n == of else f"{name} ({n} of {of})" for name, n in sorted(found.items())) or "none"


def _share(good: int, of: int) -> str:
    rate = Rate(good, of)
    low, high = rate.interval_percent or (0.0, 100.0)
    return "-" if rate.percent is None else f"{rate.percent:.1f} % ({low:.1f} to {high:.1f})"


def _table(head: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(str(cell).replace("|", "\\|") for cell in line) + " |" for line in lines)
