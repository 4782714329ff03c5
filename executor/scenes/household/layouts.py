"""What the 34 rooms are: read from the TOML files beside this module, checked as they are read.

A layout:

    [[layout]]
    name = "kitchen01"
    size_m = [3.2, 3.8]                                 # along x, along y; walls are east (+x), north (+y), west, south
    east = ["drawers_0", "refrigerator_0", "counter_0"] # side by side, from the left of who faces the wall
    north = ["...", "table_0", 0.3]                     # "..." takes up what is left, a number is a gap in metres
    floor.table_1 = [-0.4, 0.5, 90]                     # x, y in metres and degrees from where its front faces west
    on.counter_0 = ["microwave_0", "apple_0 front left", "clutter 2"]
    wishes = [
      { open = "refrigerator_0", query = "open the refrigerator" },
      { pick = "apple_0", query = "pick up the apple on the counter" },
      { close = "cabinet_0", from = 0.6, query = "close the cabinet" },
    ]

A thing's name begins with its kind (`data/kinds.toml`); a model of the library may follow it. The first wish is asked
in the first variation, and so on.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from importlib import resources
from typing import Annotated, Any, Literal, Self

from pydantic import BaseModel, BeforeValidator, ConfigDict, ValidationError, model_validator

from oag.model.forms import first_mistake

Deed = Literal["open", "close", "pick"]
DEEDS: tuple[Deed, ...] = ("open", "close", "pick")
REST = "..."
SIDES = ("front", "back", "left", "right", "middle")
REGIONS = ("top", "niche")
"""Names of places without an underscore."""

FILES = ("kitchens", "bedrooms", "others")
_DATA = resources.files(__package__) / "data"


class LayoutError(ValueError):
    """A layout file says something that cannot be arranged; the message names layout and place."""


class _Form(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class ThingKind(_Form):
    """A kind of thing; `data/kinds.toml` says what its fields are."""

    models: tuple[str, ...]
    sizes_m: dict[str, tuple[float, float]] = {}
    category: str = ""
    parameters: dict[str, Any] = {}
    single: tuple[str, ...] = ()
    single_parameters: dict[str, Any] = {}
    unit: bool = False


class _Kinds(_Form):
    kinds: dict[str, ThingKind]
    clutter: dict[str, tuple[str, ...]]


_READ = _Kinds.model_validate(tomllib.loads((_DATA / "kinds.toml").read_text("utf-8")))
KINDS: Mapping[str, ThingKind] = _READ.kinds
CLUTTER: Mapping[str, tuple[str, ...]] = _READ.clutter
"""Kind of room -> models that lie about in it."""


@dataclass(frozen=True, slots=True)
class Thing:
    """A thing that a layout names.

    Attributes:
        id: Its id in the scene.
        kind: Name of its kind.
        model: Model of the library; "" where the seed chooses one of its kind's.
        words: Where it goes on its support: front, back, left, right, middle, or the name of a place.
    """

    id: str
    kind: str
    model: str = ""
    words: tuple[str, ...] = ()


def _thing(text: str, places: tuple[str, ...] = ()) -> Thing:
    """Reads a thing; without places it stands on the floor, where no words say more of it."""
    key, *words = text.split()
    kind = key.rstrip("0123456789").rstrip("_")
    if kind not in KINDS:
        raise ValueError(f"{key!r} begins with no kind of thing")
    models = KINDS[kind].models
    model, rest = (words[0], words[1:]) if words and words[0] in models else ("", words)
    for word in rest:
        if word not in places and not (places and "_" in word):
            expected = f"a side ({', '.join(SIDES)}) or a place's name" if places else "nothing"
            raise ValueError(f"{key}: {word!r} is no model of a {kind} ({', '.join(models)}); expected {expected}")
    return Thing(key, kind, model, tuple(rest))


def _in_a_row(item: object) -> object:
    return _thing(item) if isinstance(item, str) and item != REST else item


def _on_top(item: object) -> object:
    match str(item).split():
        case ["clutter", count] if count.isdigit():
            return int(count)
        case ["clutter", *_]:
            raise ValueError(f"{item!r} needs a number, such as 'clutter 2'")
    return _thing(str(item), (*SIDES, *REGIONS))


_Row = tuple[Annotated[Thing | float | Literal["..."], BeforeValidator(_in_a_row)], ...]
_Top = tuple[Annotated[Thing | int, BeforeValidator(_on_top)], ...]


class Wish(_Form):
    """What is asked in one variation of a room.

    Attributes:
        deed: What shall be done.
        target: Id of what it is done to.
        query: What a person would type.
        start_fraction: How far the target stands open at the start.
    """

    deed: Deed
    target: str
    query: str
    start_fraction: float = 0.0

    @model_validator(mode="before")
    @classmethod
    def _read(cls, entry: Mapping[str, Any]) -> dict[str, Any]:
        deeds = [deed for deed in DEEDS if deed in entry]
        if len(deeds) != 1 or "query" not in entry:
            raise ValueError(f"expected one of {', '.join(DEEDS)}, and a query, got {dict(entry)}")
        asked = {"deed": deeds[0], "target": entry[deeds[0]], "query": entry["query"]}
        return {**asked, "start_fraction": entry.get("from", 0.0)}

    @property
    def family(self) -> str:
        """The benchmark that it belongs to: "T6" for picking up, "T5" for opening and closing."""
        return "T6" if self.deed == "pick" else "T5"


class Layout(_Form):
    """One room.

    Attributes:
        name: Its kind and number, such as "kitchen01".
        size_m: Lengths along x and y.
        east, north, west, south: What stands along a wall, from the left of who faces it: things, gaps in metres, and
            `REST`.
        floor: Id of what stands free -> x, y in metres and its turn in degrees.
        on: Id of a support -> what is on it; a number stands for so many things of clutter.
        wishes: One for each variation.
    """

    name: str
    size_m: tuple[float, float]
    east: _Row = ()
    north: _Row = ()
    west: _Row = ()
    south: _Row = ()
    floor: dict[str, tuple[float, float, float]] = {}
    on: dict[str, _Top] = {}
    wishes: tuple[Wish, ...] = ()

    @property
    def room(self) -> str:
        """What kind of room it is, such as "kitchen"."""
        return self.name.rstrip("0123456789")

    @property
    def walls(self) -> dict[str, _Row]:
        """What stands along the walls that something stands at."""
        walls = {"east": self.east, "north": self.north, "west": self.west, "south": self.south}
        return {wall: items for wall, items in walls.items() if items}

    @property
    def things(self) -> tuple[Thing, ...]:
        """Everything it names, furniture first."""
        along = [item for items in self.walls.values() for item in items if isinstance(item, Thing)]
        upon = [item for items in self.on.values() for item in items if isinstance(item, Thing)]
        return (*along, *(_thing(key) for key in self.floor), *upon)

    @model_validator(mode="after")
    def _names_agree(self) -> Self:
        ids = [thing.id for thing in self.things]
        for twice in sorted({key for key in ids if ids.count(key) > 1}):
            raise ValueError(f"{twice}: is there twice")
        for key in (*self.on, *(wish.target for wish in self.wishes)):
            if key not in ids:
                raise ValueError(f"{key}: is not in the room; it has {', '.join(ids)}")
        return self


@cache
def layouts() -> tuple[Layout, ...]:
    """Returns the 34 layouts in their fixed order: kitchens, bedrooms, others.

    Raises:
        LayoutError: A file of the package is malformed.
    """
    return tuple(layout for name in FILES for layout in read(_DATA.joinpath(f"{name}.toml").read_text("utf-8")))


def read(text: str) -> tuple[Layout, ...]:
    """Returns the layouts of a TOML text of the form above.

    Raises:
        LayoutError: It is malformed.
    """
    found = []
    for entry in tomllib.loads(text).get("layout", ()):
        try:
            found.append(Layout.model_validate(entry))
        except ValidationError as problem:
            raise LayoutError(f"layout {entry.get('name', '?')}, {first_mistake(problem, Layout)}") from None
    return tuple(found)
