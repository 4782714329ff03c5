"""Start hypotheses of a search, and the few that are refined.

Starts are boxes around the object's points, oriented like their outline and like the walls.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from functools import cache

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import label

from executor.assets.families.generic import GENERIC, PANEL, SHELF, THING, WITH_BACK
from executor.assets.library import LIBRARY
from executor.assets.parameters import ModelEntry
from executor.geometry import Array
from executor.photo.fitting.hypothesis import PoseHypothesis, Size, has_ear, is_round, raycaster_of
from executor.photo.fitting.likelihood import (
    CARRIED,
    Likelihood,
    Neighbourhood,
    RatedHypothesis,
    best_of_models,
    by_cost,
    is_large,
    usual_size_m,
)
from executor.photo.fitting.refinement import (
    cheapest_openings,
    cheapest_turns,
    fit_handles,
    refine_nelder_mead,
    shapes,
)
from executor.photo.geometry.observation import Observation
from executor.photo.geometry.walls import Wall
from executor.photo.inputs.annotations import Detection, plain_name
from executor.photo.inputs.usual import (
    is_folding,
    is_hollow,
    is_inset,
    is_mostly_open,
)
from oag.model.symbols import Kind, is_known, kind_of

_OUTLINE_TURNS = 45  # Of a quarter turn, in which the smallest rectangle is looked for.
_ASKEW = (0.0, 1 / 3, 2 / 3)  # Of a quarter turn.
_APART_M, _AJAR = 0.1, (0.2, 0.35, 0.5, 0.65, 0.8, 0.95)  # Step of places, and openings, of open starts.
_SAME_RAD = math.radians(6.0)
LEAST_POINTS = 12
"""Of a thing: fewer have neither size nor turn."""

_GAP_M = 0.05
_UNDER_OTHERS = 80.0  # Percentile of an object's heights, including objects on it.
_FARTHEST_M = 12.0
_BEFORE_MIDDLE = math.pi / 4  # Of its radius, is the mean of the side that a round thing shows.
_IN_HAND_SHARE = 0.6  # Of the smallest width of an item: too wide ones are scaled.
_TALLER, _FOLDED_M = 1.3, 0.33  # Times as high as what lies there; usual width of what the picture's border cuts.
_ODD_SHARE = 0.7  # Share of a model's smallest height that is allowed.


def named_models(detection: Detection) -> list[ModelEntry]:
    """Return the models of a detection's category; the generic shapes if the library has none."""
    named = [entry for entry in LIBRARY.values() if entry.category == detection.category]
    return named or generic_models(detection)


def generic_models(detection: Detection) -> list[ModelEntry]:
    """Return the generic shapes as models of a detection's category, whose word decides what kind of thing it is.

    What is furniture by its name is no open box, and no slab with a back: it has a top, which may only look so. What is
    hollow by its name, such as a sink, is an open box or cylinder, and only that is. A laptop is open or shut.
    """
    category = plain_name(detection.label) or THING
    # A panel on a stand is for what boxes alone tell of: depth shows more. What is on a shelf tells of its boards.
    entries = [replace(one, category=category) for one in GENERIC.values() if one.model not in (PANEL, SHELF)]
    if is_hollow(detection.label):
        kept = {"generic_open_box", "generic_open_cylinder"}
    elif is_folding(detection.label):
        kept = {"generic_box", WITH_BACK}
    else:
        kept = {*GENERIC} - (set() if is_mostly_open(detection.label) else {"generic_open_cylinder"})
        if is_known(category) and kind_of(category, 0.0) is not Kind.ITEM:
            kept -= {"generic_open_box", WITH_BACK}
    return [entry for entry in entries if entry.model in kept]


def stands_on_floor(detection: Detection) -> bool:
    """Return whether a detection's category stands on the floor."""
    large = all(is_large(entry) for entry in named_models(detection))
    return large and detection.category not in CARRIED and not is_inset(detection.label)


def points_of(
    observation: Observation,
    box_px: tuple[float, float, float, float],
    other_m: Array,
    smaller: NDArray[np.bool_],
) -> Array:
    """Return the points (N, 3) that are most likely the object's: the central residual segment of its box.

    Args:
        observation: The picture.
        box_px: The detection's box.
        other_m: (H, W) depth of everything else known.
        smaller: (H, W) pixels in boxes of smaller objects, which may be in front of it.
    """
    x0, y0, x1, y1 = (round(value) for value in box_px)
    window = np.s_[y0 : max(y1, y0 + 1), x0 : max(x1, x0 + 1)]
    z, sigma = observation.z_m[window], observation.sigma_m[window]
    out = observation.measured[window] & (z < other_m[window] - np.maximum(0.015, 3.0 * sigma))
    apart = out & ~smaller[window]
    out = apart if apart.sum() > 0.3 * out.sum() else out
    pieces, count = label(out & ~observation.edges[window])
    points = observation.points_m[window]
    if count == 0:
        return np.zeros((0, 3))
    rows, columns = np.mgrid[: out.shape[0], : out.shape[1]]
    middle = (((columns + 0.5) / out.shape[1] - 0.5) ** 2 + ((rows + 0.5) / out.shape[0] - 0.5) ** 2) * 4.0
    worth = np.bincount(pieces.ravel(), weights=np.exp(-middle).ravel(), minlength=count + 1)
    worth[0] = 0.0
    best = int(worth.argmax())
    chosen = pieces == best
    if int(chosen.sum()) < LEAST_POINTS:
        return np.asarray(points[out])
    # Segments near it belong to it too: legs, an open door, parts divided by a rod.
    low, high = points[chosen].min(axis=0) - _GAP_M, points[chosen].max(axis=0) + _GAP_M
    for piece in np.flatnonzero(worth > 0.02 * worth[best]):
        near = (points[pieces == piece] > low).all(axis=1) & (points[pieces == piece] < high).all(axis=1)
        if near.mean() > 0.5:
            chosen |= pieces == piece
    return np.asarray(points[chosen])


def starts(
    points: Array, entries: Sequence[ModelEntry], bottom_m: float, walls: Sequence[Wall]
) -> Iterator[PoseHypothesis]:
    """Yield hypotheses around some points (N, 3): every model, in four orientations, within the model's sizes.

    Args:
        points: In the level frame.
        entries: The models.
        bottom_m: Height of the support.
        walls: Their directions are usual ones of furniture.
    """
    if not len(points):
        return
    flat = points[:, :2]
    own, *_ = distinct = _likely_yaws(flat, walls)
    # Things may stand on it, and be no part of it.
    tops = [float(one) for one in np.percentile(points[:, 2], [_UNDER_OTHERS, 98.0])]
    for entry in entries:
        bases = distinct[:1] if is_round(entry) else distinct
        if _is_turned(entry):
            # Its own x axis along the view: across it noise widens nothing.
            bases = [math.atan2(*flat.mean(axis=0)[::-1])]
        if has_ear(entry):
            # An object with an ear, such as a mug, has no sides but an orientation.
            bases = [own + share * math.pi / 2 for share in _ASKEW]
        for base in bases:
            for quarter in range(1 if is_round(entry) else 4):
                yield from _placed(entry, flat, base + quarter * math.pi / 2, bottom_m, tops)


def opened_starts(
    points: Array, entries: Sequence[ModelEntry], bottom_m: float, walls: Sequence[Wall]
) -> Iterator[PoseHypothesis]:
    """Yield open hypotheses: bodies of usual size over some points (N, 3), doors and drawers out.

    Args:
        points: In the level frame.
        entries: The models; only those with doors or drawers are used.
        bottom_m: Height of the support.
        walls: Their directions are usual ones of furniture.
    """
    if len(points) < LEAST_POINTS:
        return
    flat = points[:, :2]
    for entry in entries:
        size = usual_size_m(entry)
        if kind_of(entry.category, size[1]) is not Kind.ARTICULATED:
            continue
        for base, quarter in itertools.product(_likely_yaws(flat, walls), range(4)):
            yaw = base + quarter * math.pi / 2
            c, s = math.cos(yaw), math.sin(yaw)
            local = flat @ np.array([[c, -s], [s, c]])
            first = np.percentile(local, 2.0, axis=0) + np.divide(size[:2], 2)
            last = np.maximum(first, np.percentile(local, 98.0, axis=0) - np.divide(size[:2], 2))
            places = (np.arange(first[axis], last[axis] + _APART_M, _APART_M) for axis in range(2))
            for x, y, fraction in itertools.product(*places, _AJAR):
                at = float(c * x - s * y), float(s * x + c * y)
                yield from shapes(
                    PoseHypothesis(entry, *at, yaw, bottom_m, size).with_parameters(open_fraction=fraction)
                )


def _likely_yaws(flat: Array, walls: Sequence[Wall]) -> list[float]:
    """Return the yaw of the smallest rectangle around points (N, 2), and those of walls that differ from it."""
    distinct: list[float] = []
    for yaw in (_outline_yaw(flat), *(wall.yaw_rad for wall in walls)):
        if all(abs(math.remainder(yaw - other, math.pi / 2)) > _SAME_RAD for other in distinct):
            distinct.append(yaw)
    return distinct


@cache
def _is_turned(entry: ModelEntry) -> bool:
    """Return whether a model is a rotationally symmetric item: a glass is, a die is not."""
    body = raycaster_of(PoseHypothesis(entry, 0.0, 0.0, 0.0, 0.0, usual_size_m(entry)))
    return kind_of(entry.category, entry.width.low) is Kind.ITEM and body is not None and body.symmetric


def foot_of(observation: Observation, box_px: tuple[float, float, float, float], bottom_m: float) -> Array | None:
    """Return (2,) the point of a level plane at the middle of a box's lower edge; None above the horizon."""
    x0, _, x1, y1 = box_px
    width, height = observation.size_px
    column, row = min(int((x0 + x1) / 2), width - 1), min(int(y1), height - 1)
    ray = observation.rays[row, column]
    share = (bottom_m - observation.eye_m[2]) / ray[2] if ray[2] < -1e-3 else math.inf
    return np.asarray((observation.eye_m + share * ray)[:2]) if 0.0 < share < _FARTHEST_M else None


def is_raised(observation: Observation, thing: Detection, bottom_m: float) -> bool:
    """Return whether a thing that folds is taller in the picture than it would be if it lay there, as deep as wide."""
    (x0, y0, x1, y1), foot = thing.box_px, foot_of(observation, thing.box_px, bottom_m)
    if not is_folding(thing.label) or foot is None:
        return is_folding(thing.label)
    far_m = float(np.linalg.norm(foot))
    is_cut = x0 < 1.0 or x1 > observation.size_px[0] - 1.0
    wide_m = max((x1 - x0) / observation.K.fx * far_m, _FOLDED_M if is_cut else 0.0)
    end = foot * (1.0 + wide_m / max(far_m, 1e-6))
    lying_px = y1 - float(observation.pixels(np.array([*end, bottom_m]))[0, 1])
    return bool(y1 - y0 > _TALLER * lying_px)


def _placed(
    entry: ModelEntry, flat: Array, yaw: float, bottom_m: float, tops_m: Sequence[float]
) -> Iterator[PoseHypothesis]:
    """Yield hypotheses of one yaw by the corners of some points: at some tops' heights and the largest one."""
    lower_m, top_m = tops_m
    c, s = math.cos(yaw), math.sin(yaw)
    local = flat @ np.array([[c, -s], [s, c]])
    low, high = np.percentile(local, 2.0, axis=0), np.percentile(local, 98.0, axis=0)
    width = entry.width.clipped(float(high[1] - low[1]))
    if kind_of(entry.category, width) is Kind.ITEM:
        width = min(width, max(float(high[1] - low[1]), _IN_HAND_SHARE * entry.width.low))
    length = entry.length.clipped(float(high[0] - low[0]), width)
    unit = width if entry.height.of_width else 1.0
    visible_m = entry.height.clipped(top_m - bottom_m, width)
    # Thin parts before a wall, such as a headboard, do not stand out: the box may be better evidence.
    # Objects lower or higher than their model usually is are also tried at their visible height.
    highest_m, least_m = entry.height.high * unit, _ODD_SHARE * entry.height.low * unit
    odd_m = min(max(top_m - bottom_m, least_m), highest_m / _ODD_SHARE)
    under_m = entry.height.clipped(lower_m - bottom_m, width)
    usual = () if entry.model in GENERIC else ((visible_m + highest_m) / 2, highest_m, odd_m)
    heights = {round(one, 3) for one in (visible_m, under_m, *usual)}
    size: Size = (length, width, visible_m)
    to_eye = -local.mean(axis=0)
    along: list[list[float]] = []
    for axis, side in enumerate(size[:2]):
        near = high[axis] - side / 2 if to_eye[axis] > 0 else low[axis] + side / 2
        far = low[axis] + side / 2 if to_eye[axis] > 0 else high[axis] - side / 2
        along.append([near, far] if abs(near - far) > _GAP_M else [near])
    if _is_turned(entry):
        # Along the view its points lie as far apart as noise is large: their middle is just before its own.
        middle = float(np.median(local[:, 0]))
        along[0] = [middle, middle + _BEFORE_MIDDLE * width / 2]
    for x in along[0]:
        for y in along[1]:
            for height in sorted(heights):
                at = c * x - s * y, s * x + c * y
                yield PoseHypothesis(entry, *at, yaw, bottom_m, (length, width, height))


def _outline_yaw(flat: Array) -> float:
    """Return the yaw, within a quarter turn, of the smallest rectangle around points (N, 2)."""
    best, smallest = 0.0, math.inf
    for yaw in np.linspace(0.0, math.pi / 2, _OUTLINE_TURNS, endpoint=False):
        c, s = math.cos(yaw), math.sin(yaw)
        local = flat @ np.array([[c, -s], [s, c]])
        sides = np.percentile(local, 98.0, axis=0) - np.percentile(local, 2.0, axis=0)
        area = float((sides[0] + 0.01) * (sides[1] + 0.01))
        if area < smallest:
            best, smallest = float(yaw), area
    return best


_FOLLOWED = 10  # Starts: the sides they find are shared by all models and orientations.
_SEARCH = 240  # Renderings of a search.
_MOSTLY = 0.9  # Share of its pixels that a correct closed model explains, without handles and edges.
_FAR_WORSE = 200.0  # Of a start's cost, which a search mostly halves.


def starts_of(
    near: Neighbourhood, entries: Sequence[ModelEntry], bottoms_m: Sequence[float], points: Array
) -> list[PoseHypothesis]:
    """Return the start hypotheses of a detection around its points (N, 3)."""
    return [guess for bottom in bottoms_m for guess in starts(points, entries, bottom, near.walls)]


def likely_boxes(
    near: Neighbourhood,
    entries: Sequence[ModelEntry],
    bottoms_m: Sequence[float],
    points: Array,
    coarse: Likelihood,
    search: Likelihood,
) -> list[RatedHypothesis]:
    """Search for an object and return the end points, cheapest first; sides found once count for all models.

    Args:
        near: The walls and the other furniture.
        entries: Candidate models.
        bottoms_m: Heights that it may stand on.
        points: (N, 3) its own points.
        coarse, search: Likelihoods for choosing starts and for searching.
    """
    begun = starts_of(near, entries, bottoms_m, points)
    followed = _worth_following([coarse.rated(guess, colours=False) for guess in begun])
    boxes = by_cost(_searched(search, followed))
    named = {entry.category for entry in entries}
    if boxes and len(named) == 1 and not _explains(search, boxes):
        # A door that stands wide open makes the points' rectangle another thing's.
        out = search.evidence.own_points_m
        ajar = (guess for bottom in bottoms_m for guess in opened_starts(out, entries, bottom, near.walls))
        openings = cheapest_openings(coarse.rated(guess, colours=False) for guess in ajar)
        boxes = by_cost([*boxes, *_searched(search, openings)])
    return boxes


def _searched(search: Likelihood, begun: Iterable[RatedHypothesis]) -> Iterable[RatedHypothesis]:
    """Yield the end points of searches from some starts."""
    for one in begun:
        guess = refine_nelder_mead(search, fit_handles(search, one.guess), _SEARCH, colours=False)
        yield search.rated(guess, colours=False)


def _explains(search: Likelihood, boxes: Sequence[RatedHypothesis]) -> bool:
    """Return whether the cheapest hypothesis explains most of the residual pixels."""
    body = raycaster_of(boxes[0].guess) if boxes else None
    return body is not None and search.evidence.explained(boxes[0].guess, body) > _MOSTLY


def _worth_following(begun: list[RatedHypothesis]) -> list[RatedHypothesis]:
    """Return the cheapest start of each model, then those of other turns and heights; far worse ones are dropped."""
    found = cheapest_turns(begun)
    models = best_of_models(found)
    first = [*models, *(one for one in found if all(one is not model for model in models))]
    return [one for one in first if one.cost < found[0].cost + _FAR_WORSE][:_FOLLOWED]
