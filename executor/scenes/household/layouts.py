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
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, ValidationError

Deed = Literal["open", "close", "pick"]
DEEDS: tuple[Deed, ...] = ("open", "close", "pick")
WALLS = ("east", "north", "west", "south")
REST = "..."
SIDES = ("front", "back", "left", "right", "middle")
REGIONS = ("top", "niche")
"""Names of places without an underscore."""

FILES = ("kitchens", "bedrooms", "others")
_DATA = resources.files(__package__) / "data"


class _LayoutForm(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class ThingKind(_LayoutForm):
    """A kind of thing; `data/kinds.toml` says what its fields are."""

    models: tuple[str, ...]
    sizes_m: dict[str, tuple[float, float]] = {}
    category: str = ""
    parameters: dict[str, Any] = {}
    single: tuple[str, ...] = ()
    single_parameters: dict[str, Any] = {}
    unit: bool = False


class _Kinds(_LayoutForm):
    kinds: dict[str, ThingKind]
    clutter: dict[str, tuple[str, ...]]


class _Entry(_LayoutForm):
    """A layout as its file has it."""

    name: str
    size_m: tuple[float, float]
    east: tuple[float | str, ...] = ()
    north: tuple[float | str, ...] = ()
    west: tuple[float | str, ...] = ()
    south: tuple[float | str, ...] = ()
    floor: dict[str, tuple[float, float, float]] = {}
    on: dict[str, tuple[str, ...]] = {}
    wishes: tuple[dict[str, str | float], ...] = ()


_READ = _Kinds.model_validate(tomllib.loads((_DATA / "kinds.toml").read_text("utf-8")))
KINDS: Mapping[str, ThingKind] = _READ.kinds
CLUTTER: Mapping[str, tuple[str, ...]] = _READ.clutter
"""ThingKind of room -> models that lie about in it."""


class LayoutError(ValueError):
    """A layout file says something that cannot be arranged."""

    def __init__(self, layout: str, place: str, problem: str) -> None:
        super().__init__(f"layout {layout}, {place}: {problem}")


@dataclass(frozen=True, slots=True)
class Wish:
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

    @property
    def family(self) -> str:
        """The benchmark that it belongs to: "T6" for picking up, "T5" for opening and closing."""
        return "T6" if self.deed == "pick" else "T5"


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


@dataclass(frozen=True, slots=True)
class Layout:
    """One room.

    Attributes:
        name: Its kind and number, such as "kitchen01".
        size_m: Lengths along x and y.
        walls: Wall -> what stands along it, from the left of who faces it: things, gaps in metres, and `REST`.
        floor: What stands free, with x, y in metres and its turn in degrees.
        on: Id of a support -> what is on it; a number stands for so many things of clutter.
        wishes: One for each variation.
    """

    name: str
    size_m: tuple[float, float]
    walls: Mapping[str, tuple[Thing | float | str, ...]]
    floor: tuple[tuple[Thing, tuple[float, float, float]], ...]
    on: Mapping[str, tuple[Thing | int, ...]]
    wishes: tuple[Wish, ...]

    @property
    def room(self) -> str:
        """What kind of room it is, such as "kitchen"."""
        return self.name.rstrip("0123456789")

    @property
    def things(self) -> tuple[Thing, ...]:
        """Everything it names, furniture first."""
        along = [thing for row in self.walls.values() for thing in row if isinstance(thing, Thing)]
        free = [thing for thing, _ in self.floor]
        upon = [thing for row in self.on.values() for thing in row if isinstance(thing, Thing)]
        return (*along, *free, *upon)


@cache
def layouts() -> tuple[Layout, ...]:
    """Returns the 34 layouts in their fixed order: kitchens, bedrooms, others.

    Raises:
        LayoutError: A file of the package is malformed; the message names layout and place.
    """
    return tuple(layout for name in FILES for layout in read(_DATA.joinpath(f"{name}.toml").read_text("utf-8")))


def read(text: str) -> tuple[Layout, ...]:
    """Returns the layouts of a TOML text of the form above.

    Raises:
        LayoutError: It is malformed.
    """
    return tuple(_layout(entry) for entry in tomllib.loads(text).get("layout", ()))


def _layout(data: Mapping[str, Any]) -> Layout:
    name = str(data.get("name", "?"))
    try:
        entry = _Entry.model_validate(data)
    except ValidationError as problem:
        first = problem.errors(include_url=False)[0]
        raise LayoutError(name, ".".join(map(str, first["loc"])), first["msg"]) from None
    layout = Layout(
        name,
        entry.size_m,
        {wall: tuple(_along(name, wall, item) for item in row) for wall in WALLS if (row := getattr(entry, wall))},
        tuple((_thing(name, "floor", key), pose) for key, pose in entry.floor.items()),
        {key: tuple(_upon(name, f"on.{key}", item) for item in row) for key, row in entry.on.items()},
        tuple(_wish(name, wish) for wish in entry.wishes),
    )
    ids = [thing.id for thing in layout.things]
    for twice in sorted({key for key in ids if ids.count(key) > 1}):
        raise LayoutError(name, twice, "is there twice")
    for key in (*layout.on, *(wish.target for wish in layout.wishes)):
        if key not in ids:
            raise LayoutError(name, key, f"is not in the room; it has {', '.join(ids)}")
    return layout


def _along(layout: str, wall: str, item: float | str) -> Thing | float | str:
    return item if isinstance(item, float) or item == REST else _thing(layout, wall, item)


def _upon(layout: str, place: str, item: str) -> Thing | int:
    first, *rest = item.split()
    if first != "clutter":
        return _thing(layout, place, item)
    if len(rest) != 1 or not rest[0].isdigit():
        raise LayoutError(layout, place, f"{item!r} needs a number, such as 'clutter 2'")
    return int(rest[0])


def _thing(layout: str, place: str, text: str) -> Thing:
    key, *words = text.split()
    name = key.rstrip("0123456789").rstrip("_")
    if name not in KINDS:
        raise LayoutError(layout, place, f"{key!r} begins with no kind of thing")
    models = KINDS[name].models
    model, rest = (words[0], words[1:]) if words and words[0] in models else ("", words)
    places = (*SIDES, *REGIONS) if place.startswith("on.") else ()
    for word in rest:
        if word not in places and not (places and "_" in word):
            expected = f"a side ({', '.join(SIDES)}) or a place's name" if places else "nothing"
            said = f"{key}: {word!r} is no model of a {name} ({', '.join(models)}); expected {expected}"
            raise LayoutError(layout, place, said)
    return Thing(key, name, model, tuple(rest))


def _wish(layout: str, entry: Mapping[str, str | float]) -> Wish:
    deeds = [deed for deed in DEEDS if deed in entry]
    if len(deeds) != 1 or "query" not in entry:
        raise LayoutError(layout, "wishes", f"expected one of {', '.join(DEEDS)}, and a query, got {dict(entry)}")
    return Wish(deeds[0], str(entry[deeds[0]]), str(entry["query"]), float(entry.get("from", 0.0)))
