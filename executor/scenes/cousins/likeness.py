"""What stands for a reconstructed thing: a model of the library, by category and size, upright and with its front."""

from __future__ import annotations

import math
import tomllib
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
    return min(
        (entry for entry in LIBRARY.values() if entry.category == category), key=lambda entry: _misfit(entry, size_m)
    )


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


@dataclass(frozen=True, slots=True)
class Upright:
    """Where a thing is and which way it faces.

    Attributes:
        centre_m: Middle of its box in the world.
        yaw_rad: Heading of the own x axis of the library's model for it, whose front is at -x.
        size_m: Sides along the model's own x, y and z.
        turned: Whether its front is taken to be the side at its own -y.
    """

    centre_m: tuple[float, float, float]
    yaw_rad: float
    size_m: tuple[float, float, float]
    turned: bool


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
        return Upright((x, y, z), wrap_angle(yaw + math.pi / 2), (width, length, height), turned)
    return Upright((x, y, z), wrap_angle(yaw + math.pi), (length, width, height), turned)


def _yaw(R: Array) -> float:
    """The turn about the vertical that was applied last; that of the own y axis where x is vertical."""
    if math.hypot(R[0, 0], R[1, 0]) > math.sin(MOST_TILTED_RAD):
        return math.atan2(R[1, 0], R[0, 0])
    return math.atan2(-R[0, 1], R[1, 1])
