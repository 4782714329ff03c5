"""Where a search begins: boxes around the points of a thing, turned as their outline and as the walls are."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Iterator, Sequence
from functools import cache

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import label

from executor.assets.library import LIBRARY
from executor.assets.parameters import ModelEntry
from executor.geometry import Array
from executor.photo.fitting.body import Guess, Size, body_of, has_ear, is_round, largest_m
from executor.photo.fitting.options import shapes
from executor.photo.fitting.prior import AT_WALLS, CARRIED, is_large, usual_size_m
from executor.photo.inputs.annotations import Sighting
from executor.photo.space.observation import Observation
from executor.photo.space.walls import Wall
from oag import Kind, kind_of

_TURNS = 45  # Of a quarter turn, in which the smallest rectangle is looked for.
_ASKEW = (0.0, 1 / 3, 2 / 3)  # Of a quarter turn.
_APART_M, _AJAR = 0.1, (0.2, 0.35, 0.5, 0.65, 0.8, 0.95)  # Places and openings at which what stands open is looked for.
_SAME_RAD = math.radians(6.0)
LEAST_POINTS = 12
"""Of a thing: fewer have neither size nor turn."""

_GAP_M = 0.05
_HEADINGS, _ASKEW_HEADINGS = 8, 24
_BEYOND_M, _BEYOND_SHARE = 0.05, 0.2  # What is seen of a thing may seem so much larger than its model can be,
_CUT_SHARE = 0.3  # and its top so much lower, where something hides it.
# What is behind a pillow or a seat may be another piece in depths.
_BACKED, _BACK_SHARE = ("bed", "sofa", "chair"), 0.6
_UNDER_OTHERS = 80.0  # Percentile of a thing's heights in the picture, with what stands on it.
_FARTHEST_M = 12.0
_SEEMS_HIGHER, _SEEMS_LOWER = 2.5, 1.5  # Than it is, what is taken to stand where its box ends.
_NEARER = (0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95, 1.0, 1.05, 1.1)  # Shares of how far off a box ends on the floor.
_CUT, _ASIDE = 0.02, (0.25, 0.5)  # Of the picture, as near to its border; of a thing's sides, beyond that.
_BEFORE_MIDDLE = math.pi / 4  # Of its radius, is the mean of the side that a round thing shows.
_IN_HAND_SHARE = 0.6  # Of the least that an item comes as: what is too wide for the hand is scaled.
_SCALED = (1.0, 0.7)  # Of its usual size, as which a thing is looked for where only its box tells that.
_LOW = 0.6  # Of its usual height, what is a low one.
_FLAT_M = 0.05  # What is no higher: plates, lying books.
_ODD_SHARE = 0.7  # Of the least that a model comes as, which a thing may be.


def named_models(detection: Sighting) -> list[ModelEntry]:
    """Returns the models of what a box is called, all of them where it has no name."""
    return [entry for entry in LIBRARY.values() if detection.category in (None, entry.category)]


def stands_on_floor(detection: Sighting) -> bool:
    """Decides whether what a box is called is taken to stand on the floor."""
    large = all(is_large(entry) for entry in named_models(detection))
    return detection.category is not None and large and detection.category not in CARRIED


def points_of(
    seen: Observation,
    box_px: tuple[float, float, float, float],
    other_m: Array,
    smaller: NDArray[np.bool_],
) -> Array:
    """Returns the points (N, 3) that are most likely the thing's: the piece in the middle of its box that stands out.

    Args:
        seen: The picture.
        box_px: The thing's box.
        other_m: (H, W) depth of everything else that is known.
        smaller: (H, W) pixels in boxes of smaller things, which may be in front of it.
    """
    x0, y0, x1, y1 = (round(value) for value in box_px)
    window = np.s_[y0 : max(y1, y0 + 1), x0 : max(x1, x0 + 1)]
    z, sigma = seen.z_m[window], seen.sigma_m[window]
    out = seen.measured[window] & (z < other_m[window] - np.maximum(0.015, 3.0 * sigma))
    apart = out & ~smaller[window]
    out = apart if apart.sum() > 0.3 * out.sum() else out
    pieces, count = label(out & ~seen.edges[window])
    points = seen.points_m[window]
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
    # Pieces near it belong to it too: legs, a door that stands open, what a rod divides.
    low, high = points[chosen].min(axis=0) - _GAP_M, points[chosen].max(axis=0) + _GAP_M
    for piece in np.flatnonzero(worth > 0.02 * worth[best]):
        near = (points[pieces == piece] > low).all(axis=1) & (points[pieces == piece] < high).all(axis=1)
        if near.mean() > 0.5:
            chosen |= pieces == piece
    return np.asarray(points[chosen])


def starts(points: Array, entries: Sequence[ModelEntry], bottom_m: float, walls: Sequence[Wall]) -> Iterator[Guess]:
    """Yields guesses around some points (N, 3): every model, turned four ways, with sizes inside the model's ranges.

    Args:
        points: In the level frame.
        entries: The models.
        bottom_m: Height of what the thing stands on.
        walls: Whose directions furniture often has.
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
            # What has no sides, such as a mug with its ear, looks otherwise from turn to turn.
            bases = [own + share * math.pi / 2 for share in _ASKEW]
        for base in bases:
            for quarter in range(1 if is_round(entry) else 4):
                yield from _placed(entry, flat, base + quarter * math.pi / 2, bottom_m, tops)


def opened_starts(
    points: Array, entries: Sequence[ModelEntry], bottom_m: float, walls: Sequence[Wall]
) -> Iterator[Guess]:
    """Yields guesses of what stands open: bodies of usual size over some points (N, 3), doors and drawers out.

    Args:
        points: In the level frame.
        entries: The models; only those with doors or drawers are taken.
        bottom_m: Height of what the thing stands on.
        walls: Whose directions furniture often has.
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
                yield from shapes(Guess(entry, *at, yaw, bottom_m, size).with_parameters(open_fraction=fraction))


def _likely_yaws(flat: Array, walls: Sequence[Wall]) -> list[float]:
    """That of the smallest rectangle around points (N, 2), and those of the walls that differ from it."""
    distinct: list[float] = []
    for yaw in (_outline_yaw(flat), *(wall.yaw_rad for wall in walls)):
        if all(abs(math.remainder(yaw - other, math.pi / 2)) > _SAME_RAD for other in distinct):
            distinct.append(yaw)
    return distinct


@cache
def _is_turned(entry: ModelEntry) -> bool:
    """Decides whether a model is of an item that is the same from all sides, as a glass is and a die is not."""
    body = body_of(Guess(entry, 0.0, 0.0, 0.0, 0.0, usual_size_m(entry)))
    return kind_of(entry.category, entry.width.low) is Kind.ITEM and body is not None and body.symmetric


def flat_among(entries: Iterable[ModelEntry]) -> list[ModelEntry]:
    """Returns those of some models of which hardly a point stands out where they are far."""
    return [entry for entry in entries if usual_size_m(entry)[2] < _FLAT_M]


def large_enough(points: Array, bottoms_m: Sequence[float]) -> list[ModelEntry]:
    """Returns the models that may look as large as some points (N, 3) that stand on one of some heights."""
    if len(points) < LEAST_POINTS:
        return flat_among(LIBRARY.values())
    flat = points[:, :2] - np.median(points[:, :2], axis=0)
    _, _, axes = np.linalg.svd(flat, full_matrices=False)
    low, high = np.percentile(flat @ axes.T, [2.0, 98.0], axis=0)
    wide_m = float((high - low)[0])
    # Things may stand on it, and be no part of it.
    mostly_m, top_m = np.percentile(points[:, 2], [_UNDER_OTHERS, 98.0])
    found = []
    for entry in LIBRARY.values():
        length, width, height = largest_m(entry)
        least = entry.height.low * (entry.width.low if entry.height.of_width else 1.0)
        least *= 1.0 - (_BACK_SHARE if entry.category in _BACKED else _CUT_SHARE)
        longest = math.hypot(length, width) * (1.0 + _BEYOND_SHARE) + _BEYOND_M
        if wide_m < longest and any(
            mostly_m - bottom < height + _BEYOND_M and top_m - bottom > least - _BEYOND_M for bottom in bottoms_m
        ):
            found.append(entry)
    return found


def high_enough(
    seen: Observation, box_px: tuple[float, float, float, float], bottoms_m: Sequence[float]
) -> list[ModelEntry]:
    """Returns the models that without depth may look as high as a box that ends on one of some heights.

    Its foot may be hidden, and what is seen at its upper end may be farther off; what a border cuts may be higher.
    """
    x0, y0, x1, y1 = box_px
    width, height = seen.size_px
    is_cut = y0 <= 1.0 or y1 >= height - 1.0
    up = seen.rays[min(height - 1, max(0, int(y0))), min(width - 1, int((x0 + x1) / 2))]
    rise = float(up[2] / max(float(np.linalg.norm(up[:2])), 1e-6))
    found = []
    for entry in LIBRARY.values():
        most_m = _SEEMS_HIGHER * largest_m(entry)[2]
        least_m = entry.height.low * (entry.width.low if entry.height.of_width else 1.0) / _SEEMS_LOWER
        for bottom_m in bottoms_m:
            foot = foot_of(seen, box_px, bottom_m)
            high_m = None if foot is None else seen.eye_m[2] + rise * float(np.linalg.norm(foot)) - bottom_m
            if high_m is None or (high_m < most_m and (is_cut or high_m > least_m)):
                found.append(entry)
                break
    return found


def outline_starts(
    seen: Observation,
    box_px: tuple[float, float, float, float],
    entries: Sequence[ModelEntry],
    bottom_m: float,
    headings_rad: Sequence[float] = (),
) -> Iterator[Guess]:
    """Yields guesses of a thing of which there is no depth: of usual size and smaller, its foot where its box ends.

    Args:
        seen: The picture.
        box_px: The thing's box.
        entries: The models.
        bottom_m: Height of what the thing stands on.
        headings_rad: Directions that furniture often has; without them all are tried.
    """
    foot = foot_of(seen, box_px, bottom_m)
    if foot is None:
        return
    for entry in entries:
        for size in _sizes_m(entry):
            for x, y in _middles_m(seen, box_px, float(np.linalg.norm(foot)), size, bottom_m, large=is_large(entry)):
                # Tables stand as they like in a room, cabinets along its walls.
                count = 4 if entry.category in AT_WALLS or not is_large(entry) else _ASKEW_HEADINGS
                turns = [heading + 2 * math.pi * step / count for heading in headings_rad for step in range(count)]
                away = math.atan2(y, x)
                for turned in turns or [away + 2 * math.pi * step / _HEADINGS for step in range(_HEADINGS)]:
                    yield Guess(entry, x, y, turned, bottom_m, size)


def _sizes_m(entry: ModelEntry) -> Iterator[Size]:
    """Yields sizes that a model is looked for as: its usual one and smaller, and those that it has if it is a low one.

    Shelves are as high as a knee or as a man, and as wide either way.
    """
    length, width, height = usual_size_m(entry)
    for share in _SCALED:
        yield share * length, share * width, share * height
    if is_large(entry) and entry.height.low < _LOW * height:
        yield length, width, entry.height.low


def _middles_m(
    seen: Observation,
    box_px: tuple[float, float, float, float],
    foot_m: float,
    size_m: Size,
    bottom_m: float,
    *,
    large: bool,
) -> Iterator[tuple[float, float]]:
    """Where the middle of a thing may be whose box ends so far off: behind its box's middle, or beyond a border."""
    x0, y0, x1, y1 = box_px
    width_px, height_px = seen.size_px
    # Upright edges lean in a picture from above: above the middle of a box's end is something else.
    ahead = seen.rays[int((y0 + y1) / 2), int((x0 + x1) / 2), :2]
    ahead = ahead / max(float(np.linalg.norm(ahead)), 1e-6)
    half_m = (size_m[0] + size_m[1]) / 4
    reaches, asides = [foot_m], [0.0]
    if large:
        # A box is off by some share of its sides, and what the picture's border cuts ends farther down.
        reaches = [share * foot_m for share in _NEARER]
        asides += [share for share in _ASIDE if x0 < _CUT * width_px]
        asides += [-share for share in _ASIDE if x1 > (1.0 - _CUT) * width_px]
        far = foot_of(seen, (x0, y0, x1, y0), bottom_m + size_m[2])
        if far is not None and y1 > (1.0 - _CUT) * height_px:
            # Its far edge tells more.
            reaches += [float(np.linalg.norm(far)) - share * half_m for share in (2.0, 2.4)]
    for reach, aside in itertools.product(reaches, asides):
        along, across = reach + half_m, 2.0 * half_m * aside
        yield float(along * ahead[0] - across * ahead[1]), float(along * ahead[1] + across * ahead[0])


def foot_of(seen: Observation, box_px: tuple[float, float, float, float], bottom_m: float) -> Array | None:
    """Returns (2,) where the middle of a box's lower edge is on a level plane, None where it is above the horizon."""
    x0, _, x1, y1 = box_px
    width, height = seen.size_px
    column, row = min(int((x0 + x1) / 2), width - 1), min(int(y1), height - 1)
    ray = seen.rays[row, column]
    share = (bottom_m - seen.eye_m[2]) / ray[2] if ray[2] < -1e-3 else math.inf
    return np.asarray((seen.eye_m + share * ray)[:2]) if 0.0 < share < _FARTHEST_M else None


def feet_of(seen: Observation, boxes_px: Sequence[tuple[float, float, float, float]], height_m: float) -> Array:
    """Returns (N, 2) where boxes end on a level plane; without any, where the camera looks at it, or the origin."""
    found = [foot for box in boxes_px if (foot := foot_of(seen, box, height_m)) is not None]
    width, height = seen.size_px
    middle = foot_of(seen, (0.0, 0.0, float(width), height / 2), height_m)
    return np.array(found or [np.zeros(2) if middle is None else middle])


def _placed(entry: ModelEntry, flat: Array, yaw: float, bottom_m: float, tops_m: Sequence[float]) -> Iterator[Guess]:
    """Turned so, by the corners of some points: as high as any of some tops, and as high as it may be."""
    lower_m, top_m = tops_m
    c, s = math.cos(yaw), math.sin(yaw)
    local = flat @ np.array([[c, -s], [s, c]])
    low, high = np.percentile(local, 2.0, axis=0), np.percentile(local, 98.0, axis=0)
    width = entry.width.clipped(float(high[1] - low[1]))
    if kind_of(entry.category, width) is Kind.ITEM:
        width = min(width, max(float(high[1] - low[1]), _IN_HAND_SHARE * entry.width.low))
    length = entry.length.clipped(float(high[0] - low[0]), width)
    unit = width if entry.height.of_width else 1.0
    seen_m = entry.height.clipped(top_m - bottom_m, width)
    # What is thin before a wall, such as a headboard, does not stand out from it: the box may know better.
    # What is lower or higher than its model mostly is, is looked for as high as it is seen, too.
    highest_m, least_m = entry.height.high * unit, _ODD_SHARE * entry.height.low * unit
    odd_m = min(max(top_m - bottom_m, least_m), highest_m / _ODD_SHARE)
    under_m = entry.height.clipped(lower_m - bottom_m, width)
    heights = {round(one, 3) for one in (seen_m, (seen_m + highest_m) / 2, highest_m, odd_m, under_m)}
    size: Size = (length, width, seen_m)
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
                yield Guess(entry, *at, yaw, bottom_m, (length, width, height))


def _outline_yaw(flat: Array) -> float:
    """The turn, within a quarter, in which the rectangle around points (N, 2) is smallest."""
    best, smallest = 0.0, math.inf
    for yaw in np.linspace(0.0, math.pi / 2, _TURNS, endpoint=False):
        c, s = math.cos(yaw), math.sin(yaw)
        local = flat @ np.array([[c, -s], [s, c]])
        sides = np.percentile(local, 98.0, axis=0) - np.percentile(local, 2.0, axis=0)
        area = float((sides[0] + 0.01) * (sides[1] + 0.01))
        if area < smallest:
            best, smallest = float(yaw), area
    return best
