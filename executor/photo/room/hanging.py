"""Things that hang on walls: told by what is around their boxes, or by their names, and put on the plane behind them.

With depth, what hangs is near an upright plane that goes on around its box, and below it is that plane or something
farther. Without, `beneath.py` tells what hangs. Names that are usual on walls (`usual.toml`) decide where neither is
sure, but for what is on a top or ends on the floor. Furniture hangs here where a person says so, or where nothing is
below it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from executor.assets.library import LIBRARY
from executor.geometry import Array
from executor.photo.fitting.fit import fit_on_wall
from executor.photo.fitting.hypothesis import PoseHypothesis, raycaster_of
from executor.photo.fitting.likelihood import Fit, SearchContext
from executor.photo.fitting.refinement import with_parts
from executor.photo.fitting.starts import LEAST_POINTS, foot_of, generic_models, named_models
from executor.photo.geometry.observation import Observation
from executor.photo.geometry.walls import Wall
from executor.photo.inputs.annotations import WALL, Detection
from executor.photo.inputs.usual import hung_depth_m
from executor.photo.room.beneath import support_of
from executor.photo.room.estimate import NEAR_TOP_M, RoomEstimate, is_furniture, is_item, tops_of
from oag.model.symbols import has_boards

Box = tuple[float, float, float, float]

_RING_SHARE, _RING_PX = 0.3, 8.0  # Of a box's sides: how far around it a wall is looked for.
_LEAST_RING, _SHARE, _DRAWS, _DRAWN = 40, 0.5, 120, 600
_WITHIN_M, _SIGMAS = 0.05, 3.0
_LEAST_SPREAD_M = 0.05  # Between two points that give a plane its direction.
_AS_WALLS = math.cos(math.radians(15.0))  # A plane so parallel or square to a wall of the room is taken to be.
_LEAST_FACING = 0.3  # Cosine between the view and the normal of a plane that is told by a few points.
_NEAR_M = 0.35  # Of a thing's middle from the wall that it hangs on.
_STANDS_M = 0.15  # What ends lower stands on the floor.
_ON_TOP_M = 0.06  # Between a thing's end and the top that it is on.
_INNER = 0.1  # Share of a box's sides at its border that may show something else.
_STRIP_SHARE, _FREE = 0.25, 0.6  # Of a box's height, looked at below it; share of it that carries nothing.
_NEXT = 0.4  # Of what is looked at below a box: it shows the top that a thing is on, and not its front.
_OUT_PERCENTILE, _LEAST_DEEP_M, _MOST_DEEP_M = 70.0, 0.015, 0.40
_USUAL_TIMES = 2.0  # Of a usual depth, that a measured one may be smaller or larger.
_FURNITURE_DEEP_M = 0.35  # Of wall cabinets and shelves.
_TAKEN_M = 0.4  # Largest side of what people take in a hand.
_DEEP_M = 0.08  # Of what nothing says how far it stands out.
_AT_NOTHING_M = 2.5  # In a room of which nothing else is known.
_ABOVE_FLOOR_M = 0.1  # Of what hangs, at least.


def hung(room: RoomEstimate, index: int, around: SearchContext, on: int | None = None) -> Fit | None:
    """Return the fit of a thing on a wall; None for what stands on something.

    Furniture by its name hangs only where that is known, and is not fixed: it opens and carries things.

    Args:
        room: The estimate, which lacks the thing.
        index: Which detection.
        around: The context of its search.
        on: What it is on, as far as that is known; by default what a person says.
    """
    detection = room.detections[index]
    on = detection.on if on is None else on
    usual_m = hung_depth_m(detection.label)
    as_furniture = usual_m is None and is_furniture(detection)
    if on not in (None, WALL) or (as_furniture and on is None):
        return None
    if on == WALL and usual_m is None:
        usual_m = _FURNITURE_DEEP_M if as_furniture else _DEEP_M
    if room.observation.has_depth:
        found = _by_depth(room, index, around, usual_m, is_known=on == WALL)
    else:
        found = None if usual_m is None else _by_box(room, index, around, usual_m)
    if found is None or not as_furniture:
        return found
    guess = replace(found.guess, fixed=False)
    named = [entry for entry in named_models(detection) if entry.model in LIBRARY]
    entries = with_parts(named, detection.doors, detection.drawers)
    models = (replace(guess, entry=entry, parameters=()) for entry in entries)
    return replace(found, guess=next((one for one in models if raycaster_of(one) is not None), guess))


def wall_behind(view: Observation, box_px: Box, walls: Sequence[Wall]) -> Wall | None:
    """Return the upright plane that goes on around a box: a wall of the room, else one of the points there.

    Args:
        view: The picture, with depth.
        box_px: The box.
        walls: The walls of the room.
    """
    x0, y0, x1, y1 = box_px
    over_x, over_y = (_RING_SHARE * side + _RING_PX for side in (x1 - x0, y1 - y0))
    ring = _within(view, (x0 - over_x, y0 - over_y, x1 + over_x, y1 + over_y)) & ~_within(view, box_px) & view.measured
    points, within_m = view.points_m[ring], _WITHIN_M + _SIGMAS * view.depth_distortion_m[ring]
    upper = points[:, 2] > _STANDS_M
    points, within_m = points[upper], within_m[upper]
    if len(points) < _LEAST_RING:
        return None
    shares = [float((np.abs(_out_m(points, wall)) < within_m).mean()) for wall in walls]
    if shares and max(shares) >= _SHARE:
        return walls[int(np.argmax(shares))]
    return _plane(points, within_m, walls)


def _by_depth(
    room: RoomEstimate, index: int, around: SearchContext, usual_m: float | None, *, is_known: bool
) -> Fit | None:
    view, detection = room.observation, room.detections[index]
    x0, y0, x1, y1 = detection.box_px
    over_x, over_y = _INNER * (x1 - x0), _INNER * (y1 - y0)
    inner = _within(view, (x0 + over_x, y0 + over_y, x1 - over_x, y1 - over_y))
    own = (inner if detection.mask is None else detection.mask) & view.measured
    if int(own.sum()) < LEAST_POINTS:
        if usual_m is None or not (is_known or support_of(view, room.detections, index) == WALL):
            return None
        return _by_box(room, index, around, usual_m)
    points = view.points_m[own]
    low_m = float(np.percentile(points[:, 2], 5.0))
    at = np.median(points[:, :2], axis=0)
    tops = list(tops_of(fit.guess for fit in room.fits.values()))
    if usual_m is None:
        # Behind what is in a shelf is the back of that.
        foot_m = view.foot_m(detection.box_px)
        ends = [at] if foot_m is None else [at, foot_m[:2]]
        near = [top for top in tops if any(top.is_near(end) for end in ends)]
        on_top = any(abs(top.height_m - low_m) < NEAR_TOP_M or has_boards(top.of.entry.category) for top in near)
        on_top = on_top or room.top_below_m(detection, low_m) is not None
    else:
        on_top = any(abs(top.height_m - low_m) < _ON_TOP_M and top.distance_m(at) == 0.0 for top in tops)
    wall = wall_behind(view, detection.box_px, room.walls)
    if wall is None:
        return _by_box(room, index, around, usual_m) if is_known and usual_m is not None else None
    if (low_m < _STANDS_M or on_top) and not is_known:
        return None
    out_m, slack_m = _out_m(points, wall), _SIGMAS * float(np.median(view.depth_distortion_m[own]))
    # Glass and screens mirror: what seems to be behind its wall is on it.
    mirrors = float(np.median(out_m)) < -_WITHIN_M - slack_m
    if float(np.median(out_m)) > _NEAR_M and not is_known:
        return None
    below = _below(view, detection.box_px, wall, points)
    stands = below == "top" or (below == "open" and usual_m is None) or (mirrors and below != "wall")
    # A shoe on stairs has a wall behind it as well, and what hangs nobody can take; a television nobody takes anyway.
    is_small = float(np.ptp(points, axis=0).max()) < _TAKEN_M
    stands = stands or (usual_m is None and is_small and support_of(view, room.detections, index) != WALL)
    if stands and not is_known:
        return None
    deep_m = _DEEP_M if mirrors else float(np.percentile(out_m, _OUT_PERCENTILE))
    if usual_m is not None:
        deep_m = min(max(deep_m, usual_m / _USUAL_TIMES), usual_m * _USUAL_TIMES)
    return fit_on_wall(
        around,
        detection.box_px,
        generic_models(detection)[0],
        wall,
        min(max(deep_m, _LEAST_DEEP_M), _MOST_DEEP_M),
        "it hangs on the wall behind it",
    )


def _below(view: Observation, box_px: Box, wall: Wall, own_m: Array) -> Literal["wall", "farther", "top", "open"]:
    """Return what is below a box: its wall, something farther, a top at its lower end, or what may be one.

    Args:
        view: The picture.
        box_px: The box.
        wall: The plane behind it.
        own_m: (N, 3) the thing's points.
    """
    x0, y0, x1, y1 = box_px
    over_x, deep_px = _INNER * (x1 - x0), _STRIP_SHARE * (y1 - y0) + _RING_PX
    strip = _within(view, (x0 + over_x, y1 + 1.0, x1 - over_x, y1 + deep_px)) & view.measured
    if int(strip.sum()) < LEAST_POINTS:
        return "open"
    points, slack_m = view.points_m[strip], _WITHIN_M + _SIGMAS * view.depth_distortion_m[strip]
    lower = own_m[own_m[:, 2] <= np.percentile(own_m[:, 2], 30.0)]
    reach_m = float(np.median(np.linalg.norm(lower[:, :2], axis=1)))
    out_m, rows = _out_m(points, wall), np.nonzero(strip)[0].astype(float)
    if float((np.linalg.norm(points[:, :2], axis=1) > reach_m + slack_m).mean()) > _FREE:
        return "farther"
    # Down the picture, a wall goes down, and a top comes nearer.
    down_m, nearer_m = (abs(float(np.cov(rows, values)[0, 1])) for values in (points[:, 2], out_m))
    if down_m > nearer_m and float((np.abs(out_m) < slack_m).mean()) > _FREE:
        return "wall"
    # Right below what stands its top is off the wall; farther down may be the front of that, or the wall again.
    off_m = np.abs(points[:, 2] - np.percentile(own_m[:, 2], 5.0))
    carries = (np.abs(out_m) > slack_m) & (off_m < _ON_TOP_M + slack_m - _WITHIN_M)
    return "top" if float(carries[rows <= rows.min() + _NEXT * deep_px].mean()) > _SHARE else "open"


def _by_box(room: RoomEstimate, index: int, around: SearchContext, usual_m: float) -> Fit | None:
    view, detection = room.observation, room.detections[index]
    box_px = detection.box_px
    ray = view.rays[
        min(int((box_px[1] + box_px[3]) / 2), view.size_px[1] - 1),
        min(int((box_px[0] + box_px[2]) / 2), view.size_px[0] - 1),
    ]
    toward = ray[:2] / max(float(np.linalg.norm(ray[:2])), 1e-6)
    standing = {
        key: fit.guess for key, fit in room.fits.items() if not is_item(fit.guess) and fit.guess.bottom_m == 0.0
    }
    far_m = _wall_m(room.detections, standing, box_px, toward)
    if (foot := foot_of(view, box_px, _ABOVE_FLOOR_M)) is not None:
        # It ends above where its wall meets the floor.
        far_m = min(far_m, float(foot @ toward))
    away = math.atan2(toward[1], toward[0])
    turns = [heading + quarter * math.pi / 2 for heading in around.near.headings_rad for quarter in range(4)]
    along_lines = min(turns, key=lambda turn: abs(math.remainder(turn - away, 2 * math.pi)), default=away)
    entry = generic_models(room.detections[index])[0]
    assumption = "it hangs, and how far off shows nothing: behind what is below it in the picture"
    # A wide box may look beside a wall along the room's lines, and never beside one that faces the camera.
    for yaw_rad in (along_lines, away):
        normal = -np.array([math.cos(yaw_rad), math.sin(yaw_rad)])
        wall = Wall(normal, far_m * float(toward @ normal), (0.0, 0.0), 0.0, math.inf)
        found = fit_on_wall(around, box_px, entry, wall, max(usual_m, _LEAST_DEEP_M), assumption)
        if found is not None:
            return found
    return None


def _wall_m(
    detections: Sequence[Detection], standing: Mapping[int, PoseHypothesis], box_px: Box, toward: Array
) -> float:
    """Return how far off a wall is: at the back of the furniture below a box in the picture, or next to that."""
    aside = {
        key: max(0.0, detections[key].box_px[0] - box_px[2], box_px[0] - detections[key].box_px[2])
        for key in standing
        if detections[key].box_px[3] > box_px[3]
    }
    nearest = min(aside.values(), default=0.0)
    ends_m = [_end_m(standing[key], toward) for key, aside_px in aside.items() if aside_px == nearest]
    return max(ends_m, default=_AT_NOTHING_M)


def _end_m(guess: PoseHypothesis, toward: Array) -> float:
    """Return how far along a direction (2,) a thing ends."""
    return float((guess.corners_m()[:, :2] @ toward).max())


def _plane(points: Array, within_m: Array, walls: Sequence[Wall]) -> Wall | None:
    """Return the upright plane that most of some points (N, 3) are on; None where half of them are on none."""
    rng = np.random.default_rng(0)
    some = rng.choice(len(points), min(_DRAWN, len(points)), replace=False)
    flat, slack = points[some, :2], within_m[some]
    first, second = rng.integers(0, len(flat), (2, _DRAWS))
    apart = flat[second] - flat[first]
    length = np.linalg.norm(apart, axis=1)
    apart, first, length = (one[length > _LEAST_SPREAD_M] for one in (apart, first, length))
    if not len(apart):
        return None
    normals = np.stack([-apart[:, 1], apart[:, 0]], axis=1) / length[:, None]
    offsets = (normals * flat[first]).sum(axis=1)
    best = int((np.abs(flat @ normals.T - offsets) < 0.5 * slack[:, None]).sum(axis=0).argmax())
    near = np.abs(flat @ normals[best] - offsets[best]) < slack
    middle = flat[near].mean(axis=0)
    normal = np.linalg.svd(flat[near] - middle, full_matrices=False)[2][1]
    for other in (one for wall in walls for one in (wall.normal, wall.along)):
        if abs(float(other @ normal)) > _AS_WALLS:
            normal = other
    offset_m = float(np.median(flat[near] @ normal))
    if offset_m > 0.0:
        normal, offset_m = -normal, -offset_m
    middle_m = np.linalg.norm(middle)
    if -offset_m < _LEAST_FACING * middle_m:
        # A narrow strip of a level top is a line along the view, too.
        return None
    off_m = np.abs(points[:, :2] @ normal - offset_m)
    found = off_m < within_m
    if float(found.mean()) < _SHARE:
        return None
    wall = Wall(normal, offset_m, (0.0, 0.0), float(points[found, 2].max()), float(np.median(off_m[found])))
    side = points[found, :2] @ wall.along
    return Wall(normal, offset_m, (float(side.min()), float(side.max())), wall.top_m, wall.residual_m)


def _out_m(points: Array, wall: Wall) -> Array:
    """Return (N,) how far points (N, 3) stand out from a wall."""
    return np.asarray(points[:, :2] @ wall.normal - wall.offset_m)


def _within(view: Observation, box_px: Box) -> NDArray[np.bool_]:
    """Return (H, W) the pixels of a box."""
    x0, y0, x1, y1 = (max(0, round(value)) for value in box_px)
    inside = np.zeros(view.z_m.shape, dtype=bool)
    inside[y0:y1, x0:x1] = True
    return inside
