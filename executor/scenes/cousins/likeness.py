"""What stands for a reconstructed thing: a model of the library, by category and size, upright and with its front."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Collection
from dataclasses import dataclass
from importlib import resources

import numpy as np

from bddl import near_names
from executor.assets.library import LIBRARY
from executor.assets.parameters import ModelEntry, Range
from executor.geometry import Array, rotation_z, wrap_angle
from executor.scenes.cousins.form import Cousin
from oag import kind_of

Size = tuple[float, float, float]
_CATEGORIES = tomllib.loads((resources.files(__package__) / "data" / "categories.toml").read_text("utf-8"))
FLAT = frozenset(_CATEGORIES["flat"])
"""Categories that are left out."""

MOST_TILTED_RAD = math.radians(20.0)

ABSURD = 3.0
"""Times larger than the largest of its kind, or smaller than the smallest, is no size that somebody means."""

_UNITS_M = {"centimetres": 0.01, "millimetres": 0.001, "inches": 0.0254}


class Unlike(ValueError):
    """The library has nothing like it, or nothing that leans as it does; the message says so in half a sentence."""


def category_of(theirs: str) -> str:
    """Returns the library's category for a category or a synset of BEHAVIOR.

    A `bottle_of_water` is a bottle, a `breakfast_table` a table: words after "of" are dropped, then the longest ending
    that is known decides.

    Raises:
        Unlike: There is none; the message has near ones.
    """
    exact = next((entry.category for entry in LIBRARY.values() if entry.synset == theirs), None)
    if exact is not None:
        return exact
    known = {entry.category: entry.category for entry in LIBRARY.values()} | dict(_CATEGORIES["alike"])
    words = theirs.lower().split(".", 1)[0].replace("__", "_").replace("-", "_").split("_")
    words = words[: words.index("of")] if "of" in words[1:] and theirs not in known else words
    for start in range(len(words)):
        name = "_".join(words[start:])
        if name in known:
            return known[name]
    near = near_names(words[-1], sorted(known))
    hint = f"; near it: {', '.join(near)}" if near else ""
    raise Unlike(f"the library has nothing of the category {theirs!r}{hint}")


def model_for(category: str, size_m: Size) -> ModelEntry:
    """Returns the model of a category whose ranges are nearest to a size; the first one among equals."""
    return min(models_of(category), key=lambda entry: _misfit(entry, size_m))


def written_category(theirs: str, entry: ModelEntry) -> str:
    """Returns the category for the scene: theirs where it names the same more exactly, else that of the model."""
    own = theirs.endswith(f"_{entry.category}") and kind_of(theirs, 0.0) is kind_of(entry.category, 0.0)
    return theirs if own else entry.category


def shaped(entry: ModelEntry, size_m: Size) -> Size:
    """Returns a size with the proportions that the model always has: a glass is round, an apple is a ball.

    Lengths that the model has no fixed ratio for stay as they are, in or out of the range that it is drawn from.
    """
    length, width, height = size_m
    if entry.length.of_width:
        width = (length + width) / 2 if entry.length.low == entry.length.high else min(length, width)
        length = _within(max(size_m[:2]), entry.length, width)
    return (length, width, _within(height, entry.height, width) if entry.height.of_width else height)


def _within(value: float, span: Range, width_m: float) -> float:
    return min(max(value, span.low * width_m), span.high * width_m)


def _misfit(entry: ModelEntry, size_m: Size) -> float:
    """How far a size is from a model's ranges: the sum over the axes of the logarithm of the ratio."""
    total = 0.0
    for value, span in zip(size_m, (entry.length, entry.width, entry.height), strict=True):
        unit = size_m[1] if span.of_width else 1.0
        total += abs(math.log(value / _within(value, span, unit)))
    return total


def unlike_size(size_m: Size, entries: Collection[ModelEntry]) -> str | None:
    """Returns how a size is far larger or smaller than that of any of some models; None where it is not.

    A slip of a decimal point or of a unit is meant; a unit that makes it a usual size is named.
    """
    low, high = _smallest_and_largest_m(entries)

    def is_like(unit_m: float) -> bool:
        sides = zip(size_m, low, high, strict=True)
        return all(least / ABSURD <= value * unit_m <= ABSURD * most for value, least, most in sides)

    if is_like(1.0):
        return None
    own, least, most = (" x ".join(f"{value:.3g}" for value in size) for size in (size_m, low, high))
    unit = next((f"; {name}?" for name, unit_m in _UNITS_M.items() if is_like(unit_m)), "")
    return f"is {own} m; its like are {least} to {most} m{unit}"


def _smallest_and_largest_m(entries: Collection[ModelEntry]) -> tuple[list[float], list[float]]:
    """Returns the least and the largest x, y and z that models are drawn with; x and y count alike, as sides do."""
    low: list[list[float]] = []
    high: list[list[float]] = []
    for entry in entries:
        spans = (entry.length, entry.width, entry.height)
        low.append([span.low * (entry.width.low if span.of_width else 1.0) for span in spans])
        high.append([span.high * (entry.width.high if span.of_width else 1.0) for span in spans])
    least, most = [min(axis) for axis in zip(*low, strict=True)], [max(axis) for axis in zip(*high, strict=True)]
    return [min(least[:2])] * 2 + least[2:], [max(most[:2])] * 2 + most[2:]


def models_of(category: str) -> tuple[ModelEntry, ...]:
    """Returns the library's models of one of its categories."""
    return tuple(entry for entry in LIBRARY.values() if entry.category == category)


@dataclass(frozen=True, slots=True)
class Upright:
    """Where a thing is and which way it faces.

    Attributes:
        centre_m: Middle of its box in the world.
        yaw_rad: Heading of the own x axis of the library's model for it, whose front is at -x.
        size_m: Sides along the model's own x, y and z.
        turned: Whether its front is taken to be the side at its own -y.
        lean: x and y of the unit vector that was its vertical, before it was set upright.
    """

    centre_m: tuple[float, float, float]
    yaw_rad: float
    size_m: tuple[float, float, float]
    turned: bool
    lean: tuple[float, float] = (0.0, 0.0)

    @property
    def bottom_m(self) -> float:
        """Height of its bottom."""
        return self.centre_m[2] - self.size_m[2] / 2

    @property
    def lean_deg(self) -> float:
        """How far it leaned."""
        return math.degrees(math.asin(min(1.0, math.hypot(*self.lean))))


def upright(cousin: Cousin, camera_m: Array, *, front: bool) -> Upright:
    """Returns how a thing stands.

    The front of a cousin is at its own +x, or at -y for assets that were made so; the file does not say which. Fronts
    are what a photograph shows, so it is +x unless that looks away from the camera and -y looks at it.

    Args:
        cousin: The thing.
        camera_m: Where the camera was, in the world.
        front: Whether it is something with a front, such as a cabinet.

    Raises:
        Unlike: It leans by more than 20 degrees; the message says how much.
    """
    R = cousin.T_world[:3, :3]
    yaw = _yaw(R)
    stood = rotation_z(yaw).T @ R
    tilt = float(np.arccos(min(1.0, float(np.abs(stood[2]).max()))))
    if tilt > MOST_TILTED_RAD:
        raise Unlike(f"leans by {math.degrees(tilt):.0f} degrees")
    vertical = int(np.argmax(np.abs(R[2])))
    lean_x, lean_y = (float(value) for value in R[:2, vertical] * np.sign(R[2, vertical]))
    # Each own axis counts for the one of the upright frame that it is nearest to, so that a lean adds no length.
    nearest = np.abs(stood).argmax(axis=0)
    size = np.zeros(3)
    np.maximum.at(size, nearest, cousin.extent_m)
    if not size.all():
        raise Unlike("leans sideways")
    x, y, z = (float(value) for value in cousin.T_world[:3, 3])
    length, width, height = (float(value) for value in size)
    towards = np.asarray(camera_m)[:2] - (x, y)
    ahead, right = rotation_z(yaw)[:2, 0], -rotation_z(yaw)[:2, 1]
    turned = front and bool(ahead @ towards < 0.0 < right @ towards)
    if turned:
        return Upright((x, y, z), wrap_angle(yaw + math.pi / 2), (width, length, height), turned, (lean_x, lean_y))
    return Upright((x, y, z), wrap_angle(yaw + math.pi), (length, width, height), turned, (lean_x, lean_y))


def _yaw(R: Array) -> float:
    """The turn about the vertical that was applied last; that of the own y axis where x is vertical."""
    if math.hypot(R[0, 0], R[1, 0]) > math.sin(MOST_TILTED_RAD):
        return math.atan2(R[1, 0], R[0, 0])
    return math.atan2(-R[0, 1], R[1, 1])
