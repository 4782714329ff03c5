"""What differs between the demonstrations of one origin, by what each of them says was drawn for it.

Nothing that was asked for is believed: an axis that drew the same every time did not vary, nor did colours of which no
picture was drawn.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

from executor.geometry import heading_of, transform_from_quaternion
from executor.machine.files import content_key, json_text

_MOST_RANGES = 6
_LOOKS = ("lights", "surfaces", "cameras")
# Of what may differ: what the card calls it, in this order.
QUANTITIES = (
    *("sentence", "things in the room", "models", "sizes", "places of things", "headings of things", "parameters"),
    *("robot's start", "target", "distractors", "physics", "noise", *_LOOKS, "motion"),
)


@dataclass
class Quantity:
    """One thing that may differ between demonstrations.

    Attributes:
        values: Keys of the values that occur.
        ranges: Name of a number -> the least and the largest.
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
        """Return how many values there are, and the ranges of the numbers that differ."""
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
    """What differs between the demonstrations of one origin.

    Attributes:
        count: How many demonstrations there are.
        quantities: Name of a quantity -> its values.
    """

    count: int = 0
    quantities: dict[str, Quantity] = field(default_factory=lambda: {name: Quantity() for name in QUANTITIES})

    def add(self, meta: Mapping[str, Any]) -> None:
        """Count a demonstration by what its `unit.json` says."""
        self.count += 1
        for name, value in _drawn(meta).items():
            self.quantities[name].add(value)

    @property
    def varied(self) -> dict[str, Quantity]:
        """What differs."""
        return {name: found for name, found in self.quantities.items() if len(found.values) > 1}

    @property
    def same(self) -> tuple[str, ...]:
        """What is there and equal in all of them."""
        return tuple(name for name, found in self.quantities.items() if len(found.values) == 1)

    def to_json(self) -> dict[str, Any]:
        """Return it as plain data."""
        return {"varied": {name: found.to_json() for name, found in self.varied.items()}, "same": list(self.same)}


def _drawn(meta: Mapping[str, Any]) -> dict[str, Any]:
    """Return what there is of each quantity in a demonstration, by what it says of itself."""
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
        # Which noise it was is no quantity.
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
    """Yield the numbers in plain data, each with the names on the way to it."""
    if isinstance(value, Mapping):
        for key, entry in value.items():
            yield from _numbers(entry, f"{name} {key}".strip())
    elif isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value):
        yield name, float(value)
