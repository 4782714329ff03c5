"""Which model of the library stands for a thing of another one: by what it is, then by how well its size fits."""

from __future__ import annotations

import math
from collections.abc import Mapping
from types import MappingProxyType

from bddl import near_names
from executor.assets.library import LIBRARY
from executor.assets.parameters import Entry, Span
from oag import kind_of

Size = tuple[float, float, float]

# What hangs or lies flat and nothing meets; Digital Cousins, too, leaves it out of collisions.
FLAT = frozenset({"towel", "rug", "carpet", "mirror", "picture", "painting", "window", "art"})

# Categories of BEHAVIOR whose name does not end in that of one of ours.
_ALIKE: Mapping[str, str] = MappingProxyType(
    {
        "armchair": "chair",
        "base_cabinet": "bottom_cabinet",
        "bookcase": "shelf",
        "bookshelf": "shelf",
        "bottom_cabinet_no_top": "bottom_cabinet",
        "cabinet": "bottom_cabinet",
        "chest_of_drawers": "bottom_cabinet",
        "coffee_cup": "mug",
        "couch": "sofa",
        "counter": "countertop",
        "dresser": "bottom_cabinet",
        "drinking_glass": "water_glass",
        "fridge": "refrigerator",
        "glass": "water_glass",
        "hardback": "book",
        "kitchen_island": "countertop",
        "loveseat": "sofa",
        "notebook": "book",
        "pill_bottle": "medicine_bottle",
        "stove": "oven",
        "teacup": "cup",
        "teddy": "teddy_bear",
    }
)


class Unlike(ValueError):
    """The library has nothing like it; the message says so in half a sentence."""


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
    known = {entry.category: entry.category for entry in LIBRARY.values()} | dict(_ALIKE)
    words = theirs.lower().split(".", 1)[0].replace("__", "_").replace("-", "_").split("_")
    words = words[: words.index("of")] if "of" in words[1:] and theirs not in known else words
    for start in range(len(words)):
        name = "_".join(words[start:])
        if name in known:
            return known[name]
    near = near_names(words[-1], sorted(known))
    hint = f"; near it: {', '.join(near)}" if near else ""
    raise Unlike(f"the library has nothing of the category {theirs!r}{hint}")


def model_for(category: str, size_m: Size) -> Entry:
    """Returns the model of a category whose ranges are nearest to a size; the first one among equals."""
    return min(
        (entry for entry in LIBRARY.values() if entry.category == category), key=lambda entry: _misfit(entry, size_m)
    )


def written_category(theirs: str, entry: Entry) -> str:
    """Returns the category for the scene: theirs where it names the same more exactly, else that of the model."""
    own = theirs.endswith(f"_{entry.category}") and kind_of(theirs, 0.0) is kind_of(entry.category, 0.0)
    return theirs if own else entry.category


def shaped(entry: Entry, size_m: Size) -> Size:
    """Returns a size with the proportions that the model always has: a glass is round, an apple is a ball.

    Lengths that the model has no fixed ratio for stay as they are, in or out of the range that it is drawn from.
    """
    length, width, height = size_m
    if entry.length.of_width:
        width = (length + width) / 2 if entry.length.low == entry.length.high else min(length, width)
        length = _within(max(size_m[:2]), entry.length, width)
    return (length, width, _within(height, entry.height, width) if entry.height.of_width else height)


def _within(value: float, span: Span, width_m: float) -> float:
    return min(max(value, span.low * width_m), span.high * width_m)


def _misfit(entry: Entry, size_m: Size) -> float:
    """How far a size is from a model's ranges: the sum over the axes of the logarithm of the ratio."""
    total = 0.0
    for value, span in zip(size_m, (entry.length, entry.width, entry.height), strict=True):
        unit = size_m[1] if span.of_width else 1.0
        total += abs(math.log(value / _within(value, span, unit)))
    return total
