"""What physics refuses yields: walls that reach into things go, a thing goes to a free place, then becomes narrower."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace

import numpy as np

from executor.assets.families.generic import GENERIC
from executor.assets.footprint import Footprint, overlap_depth_m, region_frame, solid_parts
from executor.assets.library import asset_for
from executor.photo.fitting.hypothesis import PoseHypothesis
from executor.photo.fitting.starts import generic_models
from executor.photo.geometry.walls import Wall
from executor.photo.inputs.usual import carries
from executor.photo.overlaps import EDGE_M, SAME_HEIGHT_M
from executor.photo.room.estimate import is_item
from executor.photo.room.reconstruct import FittedThing
from executor.photo.separation import CLEARANCE_M
from oag import Scene, SceneObject
from oag.model.symbols import Kind

YIELDS = ((1.0, 1.0, 0.3), (0.5, 1.0, 0.4), (0.4, 0.7, 0.6), (0.25, 0.4, 2.0))
"""How far a thing yields until physics accepts it: shares of its first depth along the view and of its first width, and
its way [m]."""

_IN_WALL_M = 0.003
_HANGS_M = 0.2  # A top that is nearer is likelier than a wall.
_LEVEL_SHARE = 0.6  # Of its way, that a thing goes up or down.
_STEP_M, _TURNS = 0.03, 16  # Of places around one that is taken.


def clear_walls(scene: Scene, walls: tuple[Wall, ...]) -> tuple[Wall, ...]:
    """Return the walls that no object reaches into."""
    things = [solid_parts(obj) for obj in scene.objects.values() if obj.category != "wall"]
    planes = [solid_parts(scene.objects[f"wall_{number}"]) for number in range(len(walls))]
    clear = (all(overlap_depth_m(one, parts) <= _IN_WALL_M for one in things) for parts in planes)
    return tuple(itertools.compress(walls, clear))


def yielding(thing: FittedThing, first: Scene, now: Scene, number: int) -> PoseHypothesis:
    """Return a fit that physics refuses as a narrower box, where nothing else is.

    Its front and its height stay as they were measured, and all of a size that a person gave.

    Args:
        thing: The thing as it was fitted.
        first: The scene of all fits, with the thing where it would be.
        now: The scene of what has yielded so far.
        number: How often the thing has yielded.
    """
    deep_share, wide_share, reach_m = YIELDS[number]
    guess, (x, y, z) = thing.fit.guess, first.objects[thing.id].position
    guess = replace(guess, x_m=x, y_m=y, bottom_m=max(0.0, z - guess.size_m[2] / 2))
    if deep_share < 1.0 and thing.detection.size_m is None:
        guess = _narrower(guess, deep_share, wide_share)
        if guess.entry.model not in GENERIC:
            box = replace(generic_models(thing.detection)[0], category=guess.entry.category)
            guess = replace(guess, entry=box, parameters=())
    return _at_rest(guess, thing.id, now, reach_m) or guess


def _narrower(guess: PoseHypothesis, deep_share: float, wide_share: float) -> PoseHypothesis:
    """Return a hypothesis with shares of its depth along the view and of its width; its front stays.

    What is fixed keeps its back on its wall.
    """
    if guess.fixed:
        deep_m, wide_m = deep_share * guess.size_m[0], wide_share * guess.size_m[1]
        back_m = (guess.size_m[0] - deep_m) / 2
        x_m, y_m = guess.x_m + back_m * math.cos(guess.yaw_rad), guess.y_m + back_m * math.sin(guess.yaw_rad)
        return replace(guess, x_m=x_m, y_m=y_m, size_m=(deep_m, wide_m, guess.size_m[2]))
    away = math.atan2(guess.y_m, guess.x_m) - guess.yaw_rad
    deep = int(abs(math.sin(away)) > abs(math.cos(away)))
    sides = [wide_share * side for side in guess.size_m[:2]]
    sides[deep] = deep_share * guess.size_m[deep]
    nearer_m = (guess.size_m[deep] - sides[deep]) / 2
    # The own axis along the view points away from the camera, or towards it.
    sign = math.copysign(1.0, math.sin(away) if deep else math.cos(away))
    axis = guess.yaw_rad + deep * math.pi / 2
    x_m, y_m = guess.x_m - sign * nearer_m * math.cos(axis), guess.y_m - sign * nearer_m * math.sin(axis)
    return replace(guess, x_m=x_m, y_m=y_m, size_m=(sides[0], sides[1], guess.size_m[2]))


def _is_on(obj: SceneObject, guess: PoseHypothesis) -> bool:
    """Return whether a hypothesis was fitted to the top of an object."""
    return abs(obj.position[2] + obj.extent_m[2] / 2 - guess.bottom_m) < SAME_HEIGHT_M


def _at_rest(guess: PoseHypothesis, key: str, scene: Scene, reach_m: float) -> PoseHypothesis | None:
    """Return the nearest place at which a thing is in nothing else, over a top or the floor; None within reach.

    Furniture may hang where it is, if no top is near. What is fixed moves in the plane of its wall.
    """
    others = [obj for name, obj in scene.objects.items() if name != key]
    solids = [(Footprint.of(obj), solid_parts(obj)) for obj in others]
    floor = 0.0 if is_item(guess) else guess.bottom_m
    hangs_m = _HANGS_M if floor > 0.0 else 0.0
    places: list[tuple[float, np.ndarray, np.ndarray]] = [(floor, np.eye(4), np.full(2, math.inf))]
    for obj in others if is_item(guess) or hangs_m else ():
        if obj.kind is Kind.ITEM and not (carries(obj.category) or _is_on(obj, guess)):
            continue
        for region in asset_for(obj).regions:
            if region.kind == "surface":
                T, half = region_frame(obj, region)
                places.append((float(T[2, 3]), T, np.asarray(half)))
    turns = np.linspace(0.0, 2.0 * math.pi, _TURNS, endpoint=False)
    steps = [(0.0, 0.0), *((r, turn) for r in np.arange(_STEP_M, reach_m, _STEP_M) for turn in turns)]
    tried: list[tuple[float, float, float, float]] = []
    if guess.fixed:
        places = []
        for by_m, turn in steps:
            aside_m, height_m = by_m * math.cos(turn), guess.bottom_m + by_m * math.sin(turn)
            at = np.array([guess.x_m, guess.y_m]) + aside_m * np.array(
                [-math.sin(guess.yaw_rad), math.cos(guess.yaw_rad)]
            )
            if height_m >= 0.0:
                tried.append((by_m, float(at[0]), float(at[1]), height_m))
    # It stays at its height as long as it can: a pillow between arms becomes narrower before it goes to the floor.
    if reach_m < YIELDS[-1][-1]:
        places = [one for one in places if abs(one[0] - guess.bottom_m) <= _LEVEL_SHARE * reach_m]
    for (by_m, turn), (height_m, T, half) in itertools.product(steps, places):
        at = np.array([guess.x_m + by_m * math.cos(turn), guess.y_m + by_m * math.sin(turn)])
        if (np.abs(T[:2, :2].T @ (at - T[:2, 3])) <= half - EDGE_M).all():
            cost_m = by_m + abs(height_m - guess.bottom_m) + (hangs_m if math.isinf(half[0]) else 0.0)
            tried.append((cost_m, float(at[0]), float(at[1]), height_m))
    for _, x, y, height_m in sorted(tried):
        moved = replace(guess, x_m=x, y_m=y, bottom_m=height_m)
        own, parts = Footprint.of(moved.as_object()), solid_parts(moved.as_object())
        near = (theirs for outline, theirs in solids if own.depth_m(outline) > 0.0)
        if all(overlap_depth_m(parts, theirs) <= CLEARANCE_M for theirs in near):
            return moved
    return None
