"""Entries of the model library, and the ranges of their sizes and parameters.

Each range is declared once. It validates a parameter on reading, bounds a drawn variation, and appears in the
documentation's table.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from bddl.errors import Scene2DemoError
from executor.assets.model import Asset, Vector
from oag import SceneObject

_DIGITS = 3  # Drawn lengths are whole millimetres.


class AssetError(Scene2DemoError, ValueError):
    """A scene object cannot be built: no family accepts its category, its size or a parameter."""

    def __init__(self, obj: SceneObject, problem: str, legal: str = "") -> None:
        # The problem and the legal values, without the object's name.
        self.words = problem + (f"; {legal}" if legal else "")
        super().__init__(f"object {obj.id} ({obj.category}): {self.words}")


def number(obj: SceneObject, name: str, default: float, low: float, high: float) -> float:
    """Return a numeric parameter.

    Raises:
        AssetError: The value is not a number between `low` and `high`.
    """
    value = obj.parameters.get(name, default)
    if isinstance(value, bool) or not isinstance(value, int | float) or not low <= value <= high:
        legal = f"expected a number from {low:g} to {high:g}"
        raise AssetError(obj, f"parameter {name!r} is {value!r}", legal)
    return float(value)


def require_size(obj: SceneObject, smallest_m: Vector) -> Vector:
    """Return the object's extent (x, y, z) [m].

    Raises:
        AssetError: An axis is shorter than the family's minimum.
    """
    for axis, value, least in zip("xyz", obj.extent_m, smallest_m, strict=True):
        if value < least:
            raise AssetError(obj, f"its {axis} extent is {value:.3f} m", f"the family needs at least {least:.3f} m")
    x, y, z = obj.extent_m
    return float(x), float(y), float(z)


@dataclass(frozen=True, slots=True)
class Range:
    """A range of lengths [m], or of multiples of the object's width (its y extent)."""

    low: float
    high: float
    of_width: bool = False

    def draw(self, rng: np.random.Generator, width_m: float = 1.0) -> float:
        """Draw a length [m] from the range, rounded to millimetres unless it depends on the width."""
        value = float(rng.uniform(self.low, self.high))
        return value * width_m if self.of_width else round(value, _DIGITS)

    def clipped(self, value_m: float, width_m: float = 1.0) -> float:
        """Return a length [m] clipped to the range."""
        unit = width_m if self.of_width else 1.0
        return min(max(value_m, self.low * unit), self.high * unit)

    def __str__(self) -> str:
        text = f"{self.low:g}" if self.low == self.high else f"{self.low:g}-{self.high:g}"
        return f"{text} x width" if self.of_width else text


SAME_AS_WIDTH = Range(1.0, 1.0, of_width=True)


@dataclass(frozen=True, slots=True)
class NumericParameter:
    """A numeric parameter of a scene object, such as a height in metres or a number of shelves.

    Attributes:
        name: Key in the object's `parameters`; its ending names the unit.
        default: Value for objects without this parameter.
        whole: True for counts.
    """

    name: str
    default: float
    low: float
    high: float
    whole: bool = False

    def read(self, obj: SceneObject) -> float:
        """Return the object's value."""
        return number(obj, self.name, self.default, self.low, self.high)

    def count(self, obj: SceneObject) -> int:
        """Return the object's value as a whole number."""
        value = self.read(obj)
        if value != round(value):
            legal = f"expected a whole number from {self.low:g} to {self.high:g}"
            raise AssetError(obj, f"parameter {self.name!r} is {value!r}", legal)
        return round(value)

    def draw(self, rng: np.random.Generator) -> float | int:
        """Draw a value from the range."""
        if self.whole:
            return int(rng.integers(round(self.low), round(self.high) + 1))
        return round(float(rng.uniform(self.low, self.high)), _DIGITS)

    def __str__(self) -> str:
        return f"{self.name} {self.low:g}-{self.high:g}"


@dataclass(frozen=True, slots=True)
class ChoiceParameter:
    """A parameter with a fixed set of words; the first one is the default.

    Attributes:
        drawn: Whether a drawn variation of a model has one of the words, or always the first.
    """

    name: str
    words: tuple[str, ...]
    drawn: bool = True

    def read(self, obj: SceneObject) -> str:
        """Return the object's value."""
        value = obj.parameters.get(self.name, self.words[0])
        if value not in self.words:
            problem = f"parameter {self.name!r} is {value!r}"
            raise AssetError(obj, problem, f"expected one of {', '.join(self.words)}")
        return str(value)

    def draw(self, rng: np.random.Generator) -> str:
        """Draw one of the words."""
        return self.words[int(rng.integers(len(self.words)))]

    def __str__(self) -> str:
        return f"{self.name} {'/'.join(self.words)}"


Builder = Callable[[SceneObject], Asset]


@dataclass(frozen=True, slots=True)
class ModelEntry:
    """One model of the library.

    Attributes:
        category: Category of a scene object of this model; `oag.model.symbols.kind_of` reads its kind from it.
        synset: BEHAVIOR's name of the category.
        length, width, height: Ranges of the extent along the object's own x, y and z.
    """

    model: str
    category: str
    synset: str
    build: Builder
    length: Range
    width: Range
    height: Range
    parameters: tuple[NumericParameter | ChoiceParameter, ...] = ()

    def sample(self, seed: int, object_id: str | None = None) -> SceneObject:
        """Draw a variation of the model that stands on the floor at the origin; equal seeds give equal variations.

        Args:
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
            parameters={
                parameter.name: parameter.draw(rng)
                for parameter in self.parameters
                if not isinstance(parameter, ChoiceParameter) or parameter.drawn
            },
        )
