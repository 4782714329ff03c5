"""The household benchmark: 34 rooms, each with three variations and a simple task for each, 102 pairs a seed.

    from executor.scenes.generators import household

    pair = household.pair(13000, 4)          # the fifth of the 102 pairs of this seed, without building the others

Rooms are data: `data/*.toml` lists their contents, places and tasks, validated on reading. Models, sizes, hinge sides,
handles and places are drawn from the seed.

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

A thing's name begins with its kind (`data/kinds.toml`); a model of the library may follow it. The first wish is the
task of the first variation, and so on.

Source: the paper's appendix "Scalable Scene Generation Statistics" (16 kitchens, 10 bedrooms, 8 others, three
variations each; 36 pairs open or close something, 66 pick something up).
"""

from __future__ import annotations

import math
import tomllib
import zlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cache
from importlib import resources
from types import MappingProxyType
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import BaseModel, BeforeValidator, ConfigDict, ValidationError, model_validator

import llm
from executor.assets import library
from executor.assets.library import asset_for
from executor.scenes.pair import UNCHANGED, LayoutChanges, Misplanned, ScenePair, draw_first_valid
from executor.scenes.placement import EDGE_M, AtEdge, Clearance, PlaceSpec, place, scatter, stand_robot
from executor.scenes.room import Room, Units, build_walls, row, row_length_m, stand, wall_length_m
from llm import QueryError
from oag import Scene, SceneObject, Task, Verdict, compose
from oag.model.forms import first_mistake
from oag.model.robots import PAPER_ROBOT
from oag.sizes import Sizing

Deed = Literal["open", "close", "pick"]
DEEDS: tuple[Deed, ...] = ("open", "close", "pick")
REST = "..."
SIDES = ("front", "back", "left", "right", "middle")
REGIONS = ("top", "niche")
"""Names of places without an underscore."""

FILES = ("kitchens", "bedrooms", "others")
_DATA = resources.files(__package__) / "data"


class LayoutError(ValueError):
    """A layout file cannot be arranged; the message names layout and place."""


class _RoomForm(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class ThingKind(_RoomForm):
    """A kind of thing; `data/kinds.toml` documents its fields."""

    models: tuple[str, ...]
    sizes_m: dict[str, tuple[float, float]] = {}
    category: str = ""
    parameters: dict[str, Any] = {}
    single: tuple[str, ...] = ()
    single_parameters: dict[str, Any] = {}
    unit: bool = False


class _Kinds(_RoomForm):
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
        model: Model of the library; "" if the seed chooses one of its kind.
        words: Its place on the support: front, back, left, right, middle, or the name of a region.
    """

    id: str
    kind: str
    model: str = ""
    words: tuple[str, ...] = ()


def _thing(text: str, places: tuple[str, ...] = ()) -> Thing:
    """Parse a thing; without places it stands on the floor and has no further words."""
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


class RoomWish(_RoomForm):
    """The request in one variation of a room.

    Attributes:
        target: Id of the object that it is about.
        query: The sentence that a person would type.
        start_fraction: Open fraction of the target at the start.
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


class Layout(_RoomForm):
    """One room.

    Attributes:
        name: Its kind and number, such as "kitchen01".
        size_m: Lengths along x and y.
        east, north, west, south: Row along a wall, from the left of who faces it: things, gaps [m], and `REST`.
        floor: Id of a free-standing thing -> x, y [m] and its turn [deg].
        on: Id of a support -> the things on it; a number is a count of clutter.
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
    wishes: tuple[RoomWish, ...] = ()

    @property
    def room(self) -> str:
        """Kind of the room, such as "kitchen"."""
        return self.name.rstrip("0123456789")

    @property
    def walls(self) -> dict[str, _Row]:
        """Rows of the walls that have furniture."""
        walls = {"east": self.east, "north": self.north, "west": self.west, "south": self.south}
        return {wall: items for wall, items in walls.items() if items}

    @property
    def things(self) -> tuple[Thing, ...]:
        """All named things, furniture first."""
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
    """Return the 34 layouts in their fixed order: kitchens, bedrooms, others."""
    return tuple(layout for name in FILES for layout in read(_DATA.joinpath(f"{name}.toml").read_text("utf-8")))


def read(text: str) -> tuple[Layout, ...]:
    """Return the layouts of a TOML text of the module's form."""
    found = []
    for entry in tomllib.loads(text).get("layout", ()):
        try:
            found.append(Layout.model_validate(entry))
        except ValidationError as problem:
            raise LayoutError(f"layout {entry.get('name', '?')}, {first_mistake(problem, Layout)}") from None
    return tuple(found)


VARIATIONS = 3
COUNT = 34 * VARIATIONS
MOST_ATTEMPTS = 25
"""Most draws of sizes and places where things do not fit or hold; of 102 pairs none needed more than seven."""

_FLOWS = {"open": "ARTICULATE_OPEN", "close": "ARTICULATE_CLOSE", "pick": "GRASP"}
CORNER_M = 0.02
FRONT_INSET_M = (0.07, 0.13)
CLUTTER_CLEAR_M = 0.06
THING_CLEAR_M = 0.09
"""Least distance from a named thing to anything else on the same top, for the fingers."""

ROBOT_SPREAD_RAD = 0.4
MICROWAVE_SUPPORT_M = 0.60
"""Least width of a microwave's support."""

# Room beside them: the door of the one reaches beyond its side when it is open, the knobs of the other stand out.
SIDE_GAP_M = MappingProxyType({"upright_one_door": 0.06, "oven_bottom_hinge": 0.02})
COOKERS = ("oven", "dishwasher")
COOKER_HEIGHTS_M, UNIT_HEIGHTS_M = (0.80, 0.82), (0.72, 0.80)
"""Heights of worktops, with an oven or a dishwasher below them and without."""

ASKEW_RAD = 0.8
"""Largest turn of an item with two flat sides from the pose that is graspable straight from the front."""


def pair(
    seed: int,
    index: int,
    *,
    keep_sizes: bool = False,
    robot: str = PAPER_ROBOT.name,
    changes: LayoutChanges = UNCHANGED,
) -> ScenePair:
    """Draw one pair of a seed; equal seeds and indices give equal pairs.

    Args:
        index: 0 to 101.
        keep_sizes, robot, changes: As for `executor.scenes.generators.families.pair_of`.
    """
    if not 0 <= index < COUNT:
        raise IndexError(f"there are {COUNT} pairs, 0 to {COUNT - 1}; got {index}")
    layout, variation = layouts()[index // VARIATIONS], index % VARIATIONS
    wish = layout.wishes[variation]
    # A seed has 102 pairs, whose glasses are not all to be of one width.
    sizing = Sizing(seed * COUNT + index, keep_sizes)
    return draw_first_valid(
        f"{wish.family}-{seed}-{layout.name}-{'abc'[variation]}",
        wish.family,
        wish.query,
        lambda attempt: _arranged(layout, variation, seed, attempt, changes),
        most_tries=MOST_ATTEMPTS,
        plan=lambda _, scene: _planned(scene, wish, sizing),
        robot=robot,
        changes=changes,
    )


def mismatches(task: Task, wish: RoomWish) -> Iterator[str]:
    """Yield differences between a planned task and the intended request."""
    if len(task.subtasks) != 1:
        yield f"it has {len(task.subtasks)} subtasks"
    subtask = task.subtasks[-1]
    if subtask.target != wish.target:
        yield f"it is about {subtask.target}, not {wish.target}"
    if subtask.flow is None or _FLOWS[wish.deed] not in {action.primitive.name for action in subtask.flow}:
        yield f"it does not {wish.deed} anything"
    verdict = compose(task).verify().verdict
    if verdict is not Verdict.PROVED:
        yield f"it is {verdict.name}"


def _planned(scene: Scene, wish: RoomWish, sizing: Sizing) -> Task:
    try:
        task = llm.propose(wish.query, scene, sizing=sizing).task
    except QueryError as error:
        raise Misplanned(f"{wish.query!r}: {error}") from None
    problems = list(mismatches(task, wish))
    if problems:
        raise Misplanned(f"{wish.query!r}: {'; '.join(problems)}")
    return task


def _arranged(layout: Layout, variation: int, seed: int, attempt: int, changes: LayoutChanges) -> Room:
    """Return a room as its layout specifies, before sizes are adjusted and physics has settled it.

    Each variation takes other models of the same kinds; each attempt draws new sizes and places.
    """
    name, number = f"{layout.name}-{seed}-{'abc'[variation]}", zlib.crc32(layout.name.encode())
    rng = np.random.default_rng([seed, number, variation, attempt])
    room = Room(name, layout.room, rng, *layout.size_m, changes.draw_perturbation(attempt))
    pieces = _drawn(room, layout, variation, np.random.default_rng([seed, number]))
    for wall, items in layout.walls.items():
        _set_along(room, wall, items, pieces)
    for key, (x_m, y_m, turn_deg) in layout.floor.items():
        stand(room, pieces[key], x_m, y_m, yaw_rad=math.radians(turn_deg))
    for support, items in layout.on.items():
        for item in (item for item in items if isinstance(item, Thing)):
            _put_on(room, item, pieces[item.id], support)
    build_walls(room)
    for support, items in layout.on.items():
        for count in (item for item in items if isinstance(item, int)):
            scatter(room, _clutter(layout), PlaceSpec(support, clear=Clearance(other_m=CLUTTER_CLEAR_M)), count)
    x, y, _ = room.objects[layout.wishes[variation].target].position
    stand_robot(room, facing_m=(x, y), spread_rad=ROBOT_SPREAD_RAD)
    return room


def _clutter(layout: Layout) -> tuple[str, ...]:
    """Models of clutter for a room, without models of its named things, so that a query has one meaning."""
    named = {_called(model) for thing in layout.things for model in KINDS[thing.kind].models}
    return tuple(model for model in CLUTTER[layout.room] if _called(model) not in named)


def _called(model: str) -> str:
    """Return the shortest name of a model's things: a half apple is an apple."""
    return library.entry(model).category.rsplit("_", 1)[-1]


def _drawn(room: Room, layout: Layout, variation: int, order: np.random.Generator) -> dict[str, SceneObject]:
    """Draw the layout's things, not yet placed; the variations of a room cycle through the models of a kind."""
    wish = layout.wishes[variation]
    cooks = any(thing.kind in COOKERS for thing in layout.things)
    units = Units.drawn(room, COOKER_HEIGHTS_M if cooks else UNIT_HEIGHTS_M)
    pieces = {}
    for thing in layout.things:
        kind = KINDS[thing.kind]
        # Drawn for every thing, so that a wish about one changes no other.
        turn = order.permutation(60)
        ajar = thing.id == wish.target and wish.start_fraction > 0.0
        models = kind.single if ajar else kind.models
        in_turn = [models[int(index)] for index in turn if index < len(models)]
        lengths = {axis: round(float(room.rng.uniform(*span)), 3) for axis, span in kind.sizes_m.items()}
        if kind.unit:
            lengths |= {"x": units.depth_m, "z": units.height_m}
        parameters = dict(kind.parameters)
        if ajar:
            parameters |= {**kind.single_parameters, "open_fraction": wish.start_fraction}
        model = thing.model or in_turn[variation % len(in_turn)]
        target = thing.id == wish.target
        drawn = room.draw(model, thing.id, extent_m=lengths, parameters=parameters, target=target)
        above = [item.kind for item in layout.on.get(thing.id, ()) if isinstance(item, Thing)]
        if "microwave" in above and drawn.extent_m[1] < MICROWAVE_SUPPORT_M:
            width_m = MICROWAVE_SUPPORT_M / drawn.scale[1]
            drawn = replace(drawn, bbox_extent=(drawn.bbox_extent[0], width_m, drawn.bbox_extent[2]))
        pieces[thing.id] = replace(drawn, category=kind.category or drawn.category)
    return pieces


def _set_along(
    room: Room, wall: str, items: tuple[Thing | float | str, ...], pieces: Mapping[str, SceneObject]
) -> None:
    """Place a wall's furniture in a row; the remaining length is shared among the `REST` marks."""
    if REST not in items:
        items = (REST, *items, REST)
    furniture = [pieces[item.id] for item in items if isinstance(item, Thing)]
    taken = sum(item for item in items if isinstance(item, float))
    taken += sum(row_length_m(room, [piece]) + 2 * SIDE_GAP_M.get(piece.model, 0.0) for piece in furniture)
    left_m = max(0.0, wall_length_m(room, wall) - 2 * CORNER_M - taken)
    share = left_m / items.count(REST)
    gaps = [0.0]
    for item in items:
        if isinstance(item, Thing):
            margin_m = SIDE_GAP_M.get(pieces[item.id].model, 0.0)
            gaps[-1] += margin_m
            gaps.append(margin_m)
        else:
            gaps[-1] += share if item == REST else float(item)
    row(room, wall, furniture, (gaps[-1] - gaps[0]) / 2, gaps_m=gaps[1:-1])


def _put_on(room: Room, thing: Thing, obj: SceneObject, support: str) -> None:
    """Put a thing at the place that its words name: near an edge, at a side, or in a region."""
    words = set(thing.words)
    turn = 0.0 if thing.kind == "microwave" else _turn(room, obj)
    region = next((word for word in thing.words if word not in SIDES), None)
    if "middle" in words:
        asked = PlaceSpec(support, region, (0.0, 0.0), yaw_rad=turn or 0.0, clear=Clearance(0.0, 0.0))
        place(room, obj, asked)
        return
    width = room.objects[support].extent_m[1]
    along = {"left": (0.12 * width, 0.40 * width), "right": (-0.40 * width, -0.12 * width)}
    side = next((along[word] for word in along if word in words), None)
    # However it is turned, it does not reach over the edge.
    least_m = math.hypot(*obj.extent_m[:2]) / 2 + EDGE_M
    inset_m = (max(FRONT_INSET_M[0], least_m), max(FRONT_INSET_M[1], least_m + 0.02))
    edge = "-x" if "front" in words else "+x" if "back" in words else None
    at = AtEdge(edge, inset_m, side) if edge is not None else None
    place(room, obj, PlaceSpec(support, region=region, at=at, yaw_rad=turn, clear=Clearance(other_m=THING_CLEAR_M)))


def _turn(room: Room, obj: SceneObject) -> float | None:
    """Draw a turn on the support that lets fingers from the front close on a thing; None if any turn does."""
    axes = asset_for(obj).grasp_axes
    if len(axes) != 1:
        return None
    (x, y, _), askew = axes[0], float(room.rng.uniform(-ASKEW_RAD, ASKEW_RAD))
    return math.pi / 2 - math.atan2(y, x) + askew + math.pi * int(room.rng.integers(2))
