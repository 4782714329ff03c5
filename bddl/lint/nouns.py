"""What words for things tell about them: large things that stand still, small things that are taken, substances."""

from __future__ import annotations

import re
from enum import Enum

_SYNSET = re.compile(r"\.[a-z]\.\d+.*\Z")
_INDEX = re.compile(r"_\d+\Z")


class Size(Enum):
    """How a kind of thing is usually met with."""

    FIXTURE = "stands in a room"
    ITEM = "fits into a hand"
    SUBSTANCE = "fills or covers other things"


_NOUNS_IN_WORDS = {
    Size.FIXTURE: (
        "table desk counter countertop shelf bookcase bench island sofa couch bed sink floor refrigerator fridge "
        "cabinet cupboard wardrobe microwave oven dishwasher freezer washer dryer stove dresser bathtub fireplace "
        "driveway lawn toilet"
    ),
    Size.ITEM: (
        "cup glass apple bottle bowl knife mug plate can jar fork spoon pan pot banana orange lemon peach pear tomato "
        "potato onion carrot egg book sponge teapot pitcher jug pen pencil fruit vegetable sandwich wineglass "
        "phone remote candle toy napkin sock teaspoon"
    ),
    Size.SUBSTANCE: (
        "water dust stain dirt mud milk juice oil sauce wine beer coffee tea soup salt pepper sugar flour rust grease "
        "vinegar detergent soap sand snow"
    ),
}
_NOUNS = {size: frozenset(nouns.split()) for size, nouns in _NOUNS_IN_WORDS.items()}


def size_of(category: str) -> Size | None:
    """Returns how big things of a category are, or None when the word does not tell.

    Args:
        category: Such as `water_glass`, `refrigerator.n.01` or the name of an object, `glass_0`. The last word of a
            compound says what a thing is.

    Example:
        >>> size_of("breakfast_table.n.01"), size_of("water_glass"), size_of("thing")
        (<Size.FIXTURE: 'stands in a room'>, <Size.ITEM: 'fits into a hand'>, None)
    """
    stem = _INDEX.sub("", _SYNSET.sub("", category.casefold()))
    last = stem.replace("-", "_").rsplit("_", 1)[-1]
    return next((size for size, nouns in _NOUNS.items() if last in nouns), None)
