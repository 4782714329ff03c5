"""From a layout to one of its rooms: models, sizes and places drawn, furniture set up, things put on it."""

from __future__ import annotations

import math
import zlib
from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType

import numpy as np

from executor.assets import library
from executor.assets.library import asset_for
from executor.scenes.household.kinds import CLUTTER, KINDS
from executor.scenes.household.layouts import REST, SIDES, Layout, Thing
from executor.scenes.rooms import Clearance, Edge, Room, Units, build_walls, place, row, scatter, stand, stand_robot
from executor.scenes.rooms.graspable import draw_graspable
from executor.scenes.rooms.tops import EDGE_M
from executor.scenes.rooms.walls import wall_length_m
from oag import Scene, SceneObject

CORNER_M = 0.02
FRONT_INSET_M = (0.07, 0.13)
CLUTTER_CLEAR_M = 0.06
THING_CLEAR_M = 0.09
"""From a thing that a layout names to anything else on the same top: room for the fingers."""

ROBOT_SPREAD_RAD = 0.4
MICROWAVE_SUPPORT_M = 0.60
"""How wide what a microwave stands on is at least."""

# Room beside them: the door of the one reaches beyond its side when it is open, the knobs of the other stand out.
BESIDE_M = MappingProxyType({"upright_one_door": 0.06, "oven_bottom_hinge": 0.02})
COOKERS = ("oven", "dishwasher")
COOKER_HEIGHTS_M, UNIT_HEIGHTS_M = (0.80, 0.82), (0.72, 0.80)
"""Heights of worktops, with an oven or a dishwasher below them and without."""

ASKEW_RAD = 0.8
"""How far from straight a thing with two flat sides stands to whoever comes to it from the front."""

_SQUARE_TO_FRONT = ("microwave",)


def arrange(layout: Layout, variation: int, seed: int, attempt: int) -> Scene:
    """Returns a room as a layout says, before its sizes are adjusted and physics has settled it.

    Args:
        layout: The room.
        variation: 0, 1 or 2; each takes other models of the same kinds, and has a wish of its own.
        seed: What is drawn from.
        attempt: Draws sizes and places anew, with the same models.

    Raises:
        NoRoom: What was drawn does not fit.
        AssetError: What was drawn cannot be built.
    """
    name = f"{layout.name}-{seed}-{'abc'[variation]}"
    number = zlib.crc32(layout.name.encode())
    rng = np.random.default_rng([seed, number, variation, attempt])
    room = Room(name, layout.room, rng, *layout.size_m)
    maker = _Maker(room, layout, variation, np.random.default_rng([seed, number]))
    pieces = {thing.id: maker.draw(thing) for thing in layout.things}
    for wall, items in layout.walls.items():
        _set_along(room, wall, items, pieces)
    for thing, (x_m, y_m, turn_deg) in layout.floor:
        stand(room, pieces[thing.id], x_m, y_m, yaw_rad=math.radians(turn_deg))
    for support, items in layout.on.items():
        for item in (item for item in items if isinstance(item, Thing)):
            _put_on(room, item, pieces[item.id], support)
    build_walls(room)
    for support, items in layout.on.items():
        for count in (item for item in items if isinstance(item, int)):
            scatter(room, _clutter(layout), support, count, clear=Clearance(other_m=CLUTTER_CLEAR_M))
    x, y, _ = room.objects[layout.wishes[variation].target].position
    stand_robot(room, facing_m=(x, y), spread_rad=ROBOT_SPREAD_RAD)
    return room.scene()


def _clutter(layout: Layout) -> tuple[str, ...]:
    """Models that lie about in a room: none of a thing that it names, so that a query means one thing."""
    named = {_called(model) for thing in layout.things for model in KINDS[thing.kind].models}
    return tuple(model for model in CLUTTER[layout.room] if _called(model) not in named)


def _called(model: str) -> str:
    """What a thing of a model is called at its shortest: a half apple is an apple."""
    return library.entry(model).category.rsplit("_", 1)[-1]


class _Maker:
    """Draws things of a kind; the variations of a room take the models of a kind in turn."""

    def __init__(self, room: Room, layout: Layout, variation: int, order: np.random.Generator) -> None:
        self._room, self._wish, self._variation, self._order = room, layout.wishes[variation], variation, order
        cooks = any(thing.kind in COOKERS for thing in layout.things)
        self._units = Units.drawn(room, COOKER_HEIGHTS_M if cooks else UNIT_HEIGHTS_M)
        self._wide = {
            support
            for support, items in layout.on.items()
            if any(isinstance(item, Thing) and item.kind == "microwave" for item in items)
        }

    def draw(self, thing: Thing) -> SceneObject:
        kind = KINDS[thing.kind]
        # Drawn for every thing, so that a wish about one changes no other.
        turn = self._order.permutation(60)
        ajar = thing.id == self._wish.target and self._wish.start_fraction > 0.0
        models = kind.single if ajar else kind.models
        order = [models[int(index)] for index in turn if index < len(models)]
        model = thing.model or order[self._variation % len(order)]
        lengths = {axis: round(float(self._room.rng.uniform(*span)), 3) for axis, span in kind.sizes_m.items()}
        if kind.unit:
            lengths |= {"x": self._units.depth_m, "z": self._units.height_m}
        parameters: Mapping[str, object] = kind.parameters
        if ajar:
            parameters = {**parameters, **kind.single_parameters, "open_fraction": self._wish.start_fraction}
        drawn = draw_graspable(self._room, model, thing.id, extent_m=lengths, parameters=parameters)
        if thing.id in self._wide and drawn.bbox_extent[1] < MICROWAVE_SUPPORT_M:
            x, _, z = drawn.bbox_extent
            drawn = replace(drawn, bbox_extent=(x, MICROWAVE_SUPPORT_M, z))
        return replace(drawn, category=kind.category) if kind.category else drawn


def _set_along(
    room: Room, wall: str, items: tuple[Thing | float | str, ...], pieces: Mapping[str, SceneObject]
) -> None:
    """Stands a wall's furniture in a row; what is left of the wall is shared among the places marked for it."""
    if REST not in items:
        items = (REST, *items, REST)
    furniture = [pieces[item.id] for item in items if isinstance(item, Thing)]
    taken = sum(item for item in items if isinstance(item, float))
    taken += sum(piece.extent_m[1] + 2 * BESIDE_M.get(piece.model, 0.0) for piece in furniture)
    left_m = max(0.0, wall_length_m(room, wall) - 2 * CORNER_M - taken)
    share = left_m / items.count(REST)
    gaps = [0.0]
    for item in items:
        if isinstance(item, Thing):
            beside_m = BESIDE_M.get(pieces[item.id].model, 0.0)
            gaps[-1] += beside_m
            gaps.append(beside_m)
        else:
            gaps[-1] += share if item == REST else float(item)
    row(room, wall, furniture, (gaps[-1] - gaps[0]) / 2, gaps_m=gaps[1:-1])


def _put_on(room: Room, thing: Thing, obj: SceneObject, support: str) -> None:
    """Puts a thing where its words say: near an edge, at a side, or in a named place."""
    words = set(thing.words)
    turn = 0.0 if thing.kind in _SQUARE_TO_FRONT else _turn(room, obj)
    region = next((word for word in thing.words if word not in SIDES), None)
    if "middle" in words:
        place(room, obj, support, region=region, at=(0.0, 0.0), yaw_rad=turn or 0.0, clear=Clearance(0.0, 0.0))
        return
    width = room.objects[support].extent_m[1]
    along = {"left": (0.12 * width, 0.40 * width), "right": (-0.40 * width, -0.12 * width)}
    side = next((along[word] for word in along if word in words), None)
    # However it is turned, it does not reach over the edge.
    least_m = math.hypot(*obj.extent_m[:2]) / 2 + EDGE_M
    inset_m = (max(FRONT_INSET_M[0], least_m), max(FRONT_INSET_M[1], least_m + 0.02))
    edge = "-x" if "front" in words else "+x" if "back" in words else None
    at = Edge(edge, inset_m, side) if edge is not None else None
    place(room, obj, support, region=region, at=at, yaw_rad=turn, clear=Clearance(other_m=THING_CLEAR_M))


def _turn(room: Room, obj: SceneObject) -> float | None:
    """A turn on its support with which fingers from the front can close on a thing; None where any will do."""
    axes = asset_for(obj).grasp_axes
    if len(axes) != 1:
        return None
    (x, y, _), askew = axes[0], float(room.rng.uniform(-ASKEW_RAD, ASKEW_RAD))
    return math.pi / 2 - math.atan2(y, x) + askew + math.pi * int(room.rng.integers(2))
