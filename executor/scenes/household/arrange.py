"""The 102 pairs of a seed: each room arranged as its layout says, models, sizes and places drawn, its wish planned."""

from __future__ import annotations

import math
import zlib
from collections.abc import Iterator, Mapping
from dataclasses import replace
from types import MappingProxyType

import numpy as np

import llm
from executor.assets import library
from executor.assets.library import asset_for
from executor.scenes.household.layouts import CLUTTER, KINDS, REST, SIDES, Layout, Thing, Wish, layouts
from executor.scenes.pair import UNCHANGED, Changes, Misplanned, ScenePair, first_that_holds
from executor.scenes.rooms import AtEdge, Clearance, Room, Units, build_walls, place, row, scatter, stand, stand_robot
from executor.scenes.rooms.furniture import row_length_m, wall_length_m
from executor.scenes.rooms.tops import EDGE_M
from llm import QueryError
from oag import Scene, SceneObject, Task, Verdict, compose
from oag.model.scenefile import FULL_SCALE, PAPER_SCALE
from oag.task.sizes import Sizing

VARIATIONS = 3
COUNT = 34 * VARIATIONS
MOST_ATTEMPTS = 25
"""How often sizes and places are drawn where things do not fit or stay; of 102 pairs none needed more than seven."""

_FLOWS = {"open": "ARTICULATE_OPEN", "close": "ARTICULATE_CLOSE", "pick": "GRASP"}
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


def pairs(seed: int) -> tuple[ScenePair, ...]:
    """Returns the 102 pairs of a seed in their fixed order: each layout's three variations, kitchens first.

    Args:
        seed: Any integer from 0.

    Raises:
        NotDrawn: A room could not be arranged.
    """
    return tuple(pair(seed, index) for index in range(COUNT))


def pair(
    seed: int, index: int, *, keep_sizes: bool = False, full_size: bool = False, changes: Changes = UNCHANGED
) -> ScenePair:
    """Returns one pair of a seed; equal seeds and indices give equal ones.

    Args:
        seed: Any integer from 0.
        index: 0 to 101.
        keep_sizes: Whether nothing is scaled to the gripper.
        full_size: Whether the robot is of full size, not the paper's 0.7.
        changes: How it differs from what the seed alone gives.

    Raises:
        IndexError: There is no pair of that index.
        NotDrawn: The room could not be arranged.
    """
    if not 0 <= index < COUNT:
        raise IndexError(f"there are {COUNT} pairs, 0 to {COUNT - 1}; got {index}")
    layout, variation = layouts()[index // VARIATIONS], index % VARIATIONS
    wish = layout.wishes[variation]
    # A seed has 102 pairs, whose glasses are not all to be of one width.
    sizing = Sizing(seed * COUNT + index, keep_sizes)
    return first_that_holds(
        f"{wish.family}-{seed}-{layout.name}-{'abc'[variation]}",
        wish.family,
        wish.query,
        lambda attempt: _arranged(layout, variation, seed, attempt, changes),
        most_tries=MOST_ATTEMPTS,
        plan=lambda _, scene: _planned(scene, wish, sizing),
        robot_scale=FULL_SCALE if full_size else PAPER_SCALE,
        changes=changes,
    )


def mismatches(task: Task, wish: Wish) -> Iterator[str]:
    """Yields how a planned task differs from what a wish means; nothing where it is what is meant."""
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


def _planned(scene: Scene, wish: Wish, sizing: Sizing) -> Task:
    try:
        task = llm.propose(wish.query, scene, sizing=sizing).task
    except QueryError as error:
        raise Misplanned(f"{wish.query!r}: {error}") from None
    problems = list(mismatches(task, wish))
    if problems:
        raise Misplanned(f"{wish.query!r}: {'; '.join(problems)}")
    return task


def _arranged(layout: Layout, variation: int, seed: int, attempt: int, changes: Changes) -> Room:
    """Returns a room as a layout says, before its sizes are adjusted and physics has settled it.

    Each variation takes other models of the same kinds; each attempt draws sizes and places anew.
    """
    name, number = f"{layout.name}-{seed}-{'abc'[variation]}", zlib.crc32(layout.name.encode())
    rng = np.random.default_rng([seed, number, variation, attempt])
    room = Room(name, layout.room, rng, *layout.size_m, changes.stray(attempt))
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
            scatter(room, _clutter(layout), support, count, clear=Clearance(other_m=CLUTTER_CLEAR_M))
    x, y, _ = room.objects[layout.wishes[variation].target].position
    stand_robot(room, facing_m=(x, y), spread_rad=ROBOT_SPREAD_RAD)
    return room


def _clutter(layout: Layout) -> tuple[str, ...]:
    """Models that lie about in a room: none of a thing that it names, so that a query means one thing."""
    named = {_called(model) for thing in layout.things for model in KINDS[thing.kind].models}
    return tuple(model for model in CLUTTER[layout.room] if _called(model) not in named)


def _called(model: str) -> str:
    """What a thing of a model is called at its shortest: a half apple is an apple."""
    return library.entry(model).category.rsplit("_", 1)[-1]


def _drawn(room: Room, layout: Layout, variation: int, order: np.random.Generator) -> dict[str, SceneObject]:
    """Draws what a layout names, not yet placed; the variations of a room take the models of a kind in turn."""
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
    """Stands a wall's furniture in a row; what is left of the wall is shared among the places marked for it."""
    if REST not in items:
        items = (REST, *items, REST)
    furniture = [pieces[item.id] for item in items if isinstance(item, Thing)]
    taken = sum(item for item in items if isinstance(item, float))
    taken += sum(row_length_m(room, [piece]) + 2 * BESIDE_M.get(piece.model, 0.0) for piece in furniture)
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
    turn = 0.0 if thing.kind == "microwave" else _turn(room, obj)
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
    at = AtEdge(edge, inset_m, side) if edge is not None else None
    place(room, obj, support, region=region, at=at, yaw_rad=turn, clear=Clearance(other_m=THING_CLEAR_M))


def _turn(room: Room, obj: SceneObject) -> float | None:
    """A turn on its support with which fingers from the front can close on a thing; None where any will do."""
    axes = asset_for(obj).grasp_axes
    if len(axes) != 1:
        return None
    (x, y, _), askew = axes[0], float(room.rng.uniform(-ASKEW_RAD, ASKEW_RAD))
    return math.pi / 2 - math.atan2(y, x) + askew + math.pi * int(room.rng.integers(2))
