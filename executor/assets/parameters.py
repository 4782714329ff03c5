"""What a model is and the ranges of its size and parameters.

A range is declared once. Reading a parameter checks against it, drawing a variation draws from it, and the table of
the documentation prints it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from bddl.syntax.errors import Portable
from executor.assets.model import Asset, Vector
from oag import SceneObject

_DIGITS = 3  # Drawn lengths are whole millimetres.


class AssetError(Portable, ValueError):
    """A scene object cannot be built: its category, its size or a parameter is not one that a family knows."""

    def __init__(self, obj: SceneObject, problem: str, legal: str = "") -> None:
        # What is wrong and what would be right, without saying again of what.
        self.words = problem + (f"; {legal}" if legal else "")
        super().__init__(f"object {obj.id} ({obj.category}): {self.words}")


def number(obj: SceneObject, name: str, default: float, low: float, high: float) -> float:
    """Returns a numeric parameter.

    Raises:
        AssetError: When it is no number between `low` and `high`.
    """
    value = obj.parameters.get(name, default)
    if isinstance(value, bool) or not isinstance(value, int | float) or not low <= value <= high:
        legal = f"expected a number from {low:g} to {high:g}"
        raise AssetError(obj, f"parameter {name!r} is {value!r}", legal)
    return float(value)


def require_size(obj: SceneObject, smallest_m: Vector) -> Vector:
    """Returns the object's extent (x, y, z) in metres.

    Raises:
        AssetError: When an axis is shorter than the family needs for its parts.
    """
    for axis, value, least in zip("xyz", obj.extent_m, smallest_m, strict=True):
        if value < least:
            raise AssetError(obj, f"its {axis} extent is {value:.3f} m", f"the family needs at least {least:.3f} m")
    x, y, z = obj.extent_m
    return float(x), float(y), float(z)


@dataclass(frozen=True, slots=True)
class Range:
    """A range of lengths in metres, or of multiples of the object's width (its y extent)."""

    low: float
    high: float
    of_width: bool = False

    def draw(self, rng: np.random.Generator, width_m: float = 1.0) -> float:
        """Returns a length in metres from the range, to the millimetre where it is not tied to the width."""
        value = float(rng.uniform(self.low, self.high))
        return value * width_m if self.of_width else round(value, _DIGITS)

    def clipped(self, value_m: float, width_m: float = 1.0) -> float:
        """Returns the length in metres of the range that is nearest to some length."""
        unit = width_m if self.of_width else 1.0
        return min(max(value_m, self.low * unit), self.high * unit)

    def __str__(self) -> str:
        text = f"{self.low:g}" if self.low == self.high else f"{self.low:g}-{self.high:g}"
        return f"{text} x width" if self.of_width else text


SAME_AS_WIDTH = Range(1.0, 1.0, of_width=True)


@dataclass(frozen=True, slots=True)
class Quantity:
    """A numeric parameter of a scene object, such as a height in metres or a number of shelves.

    Attributes:
        name: Key in the object's `parameters`; its ending names the unit.
        default: What it is where the object does not say.
        low, high: What the family can build.
        whole: True for counts.
    """

    name: str
    default: float
    low: float
    high: float
    whole: bool = False

    def read(self, obj: SceneObject) -> float:
        """Returns the object's value.

        Raises:
            AssetError: When it is no number of the range.
        """
        return number(obj, self.name, self.default, self.low, self.high)

    def count(self, obj: SceneObject) -> int:
        """Returns the object's value as a whole number.

        Raises:
            AssetError: When it is no whole number of the range.
        """
        value = self.read(obj)
        if value != round(value):
            legal = f"expected a whole number from {self.low:g} to {self.high:g}"
            raise AssetError(obj, f"parameter {self.name!r} is {value!r}", legal)
        return round(value)

    def draw(self, rng: np.random.Generator) -> float | int:
        """Returns a value from the range."""
        if self.whole:
            return int(rng.integers(round(self.low), round(self.high) + 1))
        return round(float(rng.uniform(self.low, self.high)), _DIGITS)

    def __str__(self) -> str:
        return f"{self.name} {self.low:g}-{self.high:g}"


@dataclass(frozen=True, slots=True)
class Option:
    """A parameter that is one of a few words; the first one is the default."""

    name: str
    words: tuple[str, ...]

    def read(self, obj: SceneObject) -> str:
        """Returns the object's value.

        Raises:
            AssetError: When it is none of the words.
        """
        value = obj.parameters.get(self.name, self.words[0])
        if value not in self.words:
            problem = f"parameter {self.name!r} is {value!r}"
            raise AssetError(obj, problem, f"expected one of {', '.join(self.words)}")
        return str(value)

    def draw(self, rng: np.random.Generator) -> str:
        """Returns one of the words."""
        return self.words[int(rng.integers(len(self.words)))]

    def __str__(self) -> str:
        return f"{self.name} {'/'.join(self.words)}"


Builder = Callable[[SceneObject], Asset]


@dataclass(frozen=True, slots=True)
class ModelEntry:
    """One model of the library.

    Attributes:
        model: The name that a scene object's `model` gives.
        category: Category of a scene object of this model; `oag.kind_of` reads its kind from it.
        synset: BEHAVIOR's name of the category.
        build: The family's builder.
        length, width, height: Ranges of the extent along the object's own x, y and z.
        parameters: What shapes it besides its size.
    """

    model: str
    category: str
    synset: str
    build: Builder
    length: Range
    width: Range
    height: Range
    parameters: tuple[Quantity | Option, ...] = ()

    def sample(self, seed: int, object_id: str | None = None) -> SceneObject:
        """Returns a variation of the model that stands on the floor at the origin; equal seeds give equal ones.

        Args:
            seed: Any integer from 0.
            object_id: Its id; by default the category with `_0`.
        """
        rng = np.random.default_rng([seed, *self.model.encode()])
        width = self.width.draw(rng)
        extent: Vector = (self.length.draw(rng, width), width, self.height.draw(rng, width))
        return SceneObject(
            id=object_id or f"{self.category}_0",
            category=self.category,
            model=self.model,
            position=(0.0, 0.0, extent[2] / 2),
            orientation=(1.0, 0.0, 0.0, 0.0),
            bbox_extent=extent,
            scale=(1.0, 1.0, 1.0),
            parameters={parameter.name: parameter.draw(rng) for parameter in self.parameters},
        )
