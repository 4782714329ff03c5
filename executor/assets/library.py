"""Every model that a scene object can name, with its builder, its category, and the ranges that it varies in."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from bddl import near_names
from executor.assets import (
    appliances,
    base_cabinet,
    bedroom,
    book,
    bottle,
    can,
    carton,
    cold_storage,
    cup,
    desk,
    die,
    fruit,
    plate,
    seating,
    supports,
    teddy_bear,
)
from executor.assets.apple import apple
from executor.assets.bowl import bowl
from executor.assets.entry import SAME_AS_WIDTH, Entry, Option, Quantity, Span
from executor.assets.refrigerator import refrigerator
from executor.assets.water_glass import water_glass
from oag import Kind, SceneObject, kind_of

# The first families have builders that the published scenes depend on; here they only get their ranges.
_FIRST = (
    Entry(
        "upright_one_door",
        "refrigerator",
        "refrigerator.n.01",
        refrigerator,
        Span(0.62, 0.72),
        Span(0.54, 0.66),
        Span(1.10, 1.45),
        (Option("hinge", ("left", "right")), Quantity("handle_height_m", 0.75, 0.68, 0.80)),
    ),
    Entry(
        "tumbler", "water_glass", "water_glass.n.02", water_glass, SAME_AS_WIDTH, Span(0.060, 0.080), Span(0.09, 0.14)
    ),
    Entry("red_apple", "apple", "apple.n.01", apple, SAME_AS_WIDTH, Span(0.065, 0.085), SAME_AS_WIDTH),
    Entry("porcelain_bowl", "bowl", "bowl.n.01", bowl, SAME_AS_WIDTH, Span(0.14, 0.20), Span(0.05, 0.07)),
)
_FAMILIES = (
    cold_storage,
    base_cabinet,
    bedroom,
    desk,
    appliances,
    supports,
    seating,
    cup,
    bottle,
    can,
    fruit,
    plate,
    carton,
    die,
    book,
    teddy_bear,
)
LIBRARY: Mapping[str, Entry] = MappingProxyType(
    {entry.model: entry for entry in (*_FIRST, *(entry for family in _FAMILIES for entry in family.ENTRIES))}
)


class ModelNotFound(LookupError):
    """The library has no model of this name."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.near = tuple(near_names(name, tuple(LIBRARY)))
        hint = f"did you mean {' or '.join(self.near)}? " if self.near else ""
        super().__init__(f"the library has no model {name!r}; {hint}`scene2demo assets` lists them")


def entry(model: str) -> Entry:
    """Returns the library's entry of a model.

    Raises:
        ModelNotFound: When there is none of that name; the message has near ones.
    """
    if model not in LIBRARY:
        raise ModelNotFound(model)
    return LIBRARY[model]


def models_of(category: str) -> tuple[Entry, ...]:
    """Returns the models whose scene category is this one, in the library's order."""
    return tuple(item for item in LIBRARY.values() if item.category == category)


def sample(model: str, seed: int, object_id: str | None = None) -> SceneObject:
    """Returns a variation of a model that stands on the floor at the origin; equal seeds give equal ones.

    Raises:
        ModelNotFound: When the library has no such model.
    """
    return entry(model).sample(seed, object_id)


def kind(item: Entry) -> Kind:
    """Returns how the robot deals with things of a model: articulated fixture, support or item."""
    return kind_of(item.category, item.width.low)
