"""Reading an object's own geometry parameters, with one clear sentence where one is wrong."""

from __future__ import annotations

from collections.abc import Sequence

from oag import SceneObject


class AssetError(ValueError):
    """A scene object cannot be built: its category, its size or a parameter is not one that a family knows."""

    def __init__(self, obj: SceneObject, problem: str, legal: str = "") -> None:
        self.object_id = obj.id
        self.problem = problem
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


def numbers(obj: SceneObject, name: str, default: Sequence[float]) -> tuple[float, ...]:
    """Returns a parameter that is a list of increasing numbers.

    Raises:
        AssetError: When it is anything else.
    """
    value = obj.parameters.get(name, list(default))
    items = value if isinstance(value, list | tuple) else [None]
    result = [float(item) for item in items if isinstance(item, int | float) and not isinstance(item, bool)]
    if len(result) != len(items) or result != sorted(result):
        raise AssetError(obj, f"parameter {name!r} is {value!r}", "expected a list of increasing numbers")
    return tuple(result)


def choice(obj: SceneObject, name: str, default: str, legal: Sequence[str]) -> str:
    """Returns a parameter that is one of a few words.

    Raises:
        AssetError: When it is none of them.
    """
    value = obj.parameters.get(name, default)
    if value not in legal:
        raise AssetError(obj, f"parameter {name!r} is {value!r}", f"expected one of {', '.join(legal)}")
    return str(value)


def require_size(obj: SceneObject, smallest_m: Sequence[float]) -> tuple[float, float, float]:
    """Returns the object's extent (x, y, z) in metres.

    Raises:
        AssetError: When an axis is shorter than the family needs for its parts.
    """
    extent = tuple(float(value) for value in obj.extent_m)
    for axis, value, least in zip("xyz", extent, smallest_m, strict=True):
        if value < least:
            problem = f"its {axis} extent is {value:.3f} m"
            raise AssetError(obj, problem, f"the family needs at least {least:.3f} m")
    return extent[0], extent[1], extent[2]
