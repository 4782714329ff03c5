"""What a category of object can be: an articulated fixture, a support, or an item that the gripper can take."""

from __future__ import annotations

from enum import Enum
from functools import lru_cache
from typing import Literal

Role = Literal["A", "B"]


class Kind(Enum):
    """How the robot deals with an object of a category."""

    ARTICULATED = "articulated fixture"
    SUPPORT = "support"
    ITEM = "item"

    @property
    def role(self) -> Role:
        """The paper's size-adjustment type: A for fixtures and supports (never scaled), B for items."""
        return "B" if self is Kind.ITEM else "A"


def _words(text: str) -> frozenset[str]:
    return frozenset(text.split())


# The first words of each line are the paper's own lists; the rest are their close relatives in the asset libraries.
_ARTICULATED = _words(
    "refrigerator fridge cabinet microwave oven drawer dishwasher freezer cupboard wardrobe washer dryer "
    "stove safe nightstand dresser chest door"
)
_SUPPORT = _words(
    "table desk counter countertop shelf bench workbench island stand sofa couch bed chair stool rack sink floor wall"
)
_ITEM = _words(
    "cup glass apple bottle box bowl knife mug plate can jar fork spoon pan pot tray banana orange lemon "
    "pear peach tomato potato onion carrot egg book sponge carton lid kettle teapot pitcher jug block "
    "cube ball basket toy phone remote pen"
)

_RIMMED = _words("bowl cup mug")
"""Items with a wall that two fingers can hold, however wide the item is."""

_SOLID = _words(
    "table desk counter countertop bench workbench island sofa couch bed chair stool floor wall door "
    "apple knife plate fork spoon banana orange lemon pear peach tomato potato onion carrot egg book sponge "
    "lid block cube ball die toy phone remote pen"
)
"""What has no inside that a thing could be put into; of what is not known, anything may have one."""

_BOARDED = _words("shelf rack bookshelf bookcase shelving")
"""What has boards above each other: what stands on one of them is under another, and a lift alone takes it nowhere."""

# A thing of unknown category whose smaller horizontal side is longer than this is taken for furniture: no scaling
# that keeps it recognisable would bring it between the fingers.
FURNITURE_SIDE_M = 0.30


def has_rim(category: str) -> bool:
    """Decides whether things of a category have a wall that two fingers can hold, however wide they are."""
    return _category_words(category)[-1] in _RIMMED


def has_inside(category: str) -> bool:
    """Decides whether a thing can be inside things of a category: False for tables and apples, True where unknown."""
    last = _category_words(category)[-1]
    return last not in _SOLID and last.removesuffix("s") not in _SOLID


def has_boards(category: str) -> bool:
    """Decides whether what stands on things of a category may stand under a part of it, as on the boards of a shelf."""
    return _category_words(category)[-1] in _BOARDED


def _category_words(category: str) -> list[str]:
    """Returns the words of a category; its last one says what a thing is."""
    return category.lower().split(".", 1)[0].replace("-", "_").split("_")


@lru_cache(maxsize=4096)
def kind_of(category: str, smaller_side_m: float) -> Kind:
    """Decides the kind of an object from its category, and from its size where the category is not known.

    Args:
        category: Such as `water_glass`, `bottom_cabinet` or `fridge.n.01`; the last known word decides, since
            compound names end in what the thing is.
        smaller_side_m: The smaller horizontal side of its bounding box.

    Returns:
        The kind. An unknown category longer than `FURNITURE_SIDE_M` counts as an articulated fixture, since that
        allows the most; a smaller one as an item.

    Source: the paper's object size adjustment (types A and B), extended by common relatives.
    """
    for word in reversed(_category_words(category)):
        for kind, known in ((Kind.ARTICULATED, _ARTICULATED), (Kind.SUPPORT, _SUPPORT), (Kind.ITEM, _ITEM)):
            if word in known or (word.endswith("s") and word[:-1] in known):
                return kind
    return Kind.ARTICULATED if smaller_side_m > FURNITURE_SIDE_M else Kind.ITEM
