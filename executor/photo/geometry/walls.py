"""Walls: large vertical planes outside all boxes, behind which nothing is measured."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from executor.geometry import Array
from executor.photo.geometry.observation import Observation
from executor.photo.inputs.annotations import Detection

_MOST = 4
_SHARE, _LEAST_SHARE = 0.06, 0.03  # Of all points outside floor and boxes; the least for a wall at the room's end.
_LEAST_POINTS = 800
_LEAST_LENGTH_M, _LEAST_VISIBLE_M, _LEAST_TOP_M = 0.8, 0.5, 0.6  # The second for a wall that may continue at both ends.
_FLAT_M, _FLAT_SIGMAS = 0.01, 0.7  # Median distance of a wall's points from its plane.
_LONG_M, _HIGH_M = 1.5, 1.2  # Rows are lower, wardrobes and refrigerators narrower.
_STRIP_M, _LEAST_BELOW = 0.06, 0.2  # Below its top, and the least share of its points that are lower.
_FRONT_M = 0.1  # Distance of a front from the plane of the wall that it was taken for.
_BEYOND_END_M, _NEARER_M = (0.03, 0.13), 0.03
_TOP_M, _AT_TOP_M = (0.15, 0.6), 0.12  # Behind its face furniture has its top, and walls no longer have theirs.
_ABOUT_TOP_M = (0.06, 0.04)  # Below and above a wall's top: the strip in which its depth is checked.
_LEAST_THICK_M = 0.03  # Where the picture ends below a wall's top, noise puts some of its face behind itself.
_LEAST_BEHIND_PX, _LOOKED_OVER = 100, 0.8  # Of the pixels that look there: unboxed objects hide some.
_ABOVE_FLOOR_M = 0.10
_BOX_MARGIN = 0.06  # Margin around a box, as a share of its sides: twice the error of boxes.
_NEAREST_M, _FARTHEST_M = 0.3, 9.0  # A plane through the camera is a table's edge and no wall,
_NEAREST_LARGE_M = 0.1  # unless it is larger than furniture: one may stand with a shoulder at a wall.
_TRIALS, _SAMPLES = 250, 4000
_TOLERANCES_M, _SIGMAS = (0.06, 0.03, 0.02, 0.01, 0.005, 0.005, 0.005), 1.5
"""Decreasing tolerances of a wall's points, in addition to noise: objects before it are on one side."""
_MOST_THROUGH = 0.04  # Of the pixels that look at it.
_BEGINS = 2.0  # Percentile of the pixels over a wall that gives its top despite noise.
_AS_OTHERS = math.cos(math.radians(15.0))  # Angle between a plane and another wall that may be aligned.
_BEYOND_M, _BEYOND = 0.15, 0.04
"""Largest share of visible points beyond a wall's plane, if no boxes mark furniture."""


@dataclass(frozen=True)
class Wall:
    """An upright wall in the level frame.

    Attributes:
        normal: (2,) unit vector towards the camera.
        offset_m: The plane is where normal @ (x, y) is this.
        span_m: Visible interval along the direction to the left of the normal.
        top_m: Visible height.
        residual_m: Median distance of its points.
        thick_m: How far its top reaches behind its face, if the camera looks over it; 0 if no top is visible.
    """

    normal: Array
    offset_m: float
    span_m: tuple[float, float]
    top_m: float
    residual_m: float
    thick_m: float = 0.0

    @property
    def along(self) -> Array:
        """(2,) unit vector along it."""
        return np.array([-self.normal[1], self.normal[0]])

    @property
    def yaw_rad(self) -> float:
        """Heading of furniture with its back to it, whose front is at its own -x."""
        return math.atan2(-self.normal[1], -self.normal[0])

    def depth(self, eye_m: Array, rays: Array) -> Array:
        """Return (...) the depth at which rays from an eye meet it, infinite for a miss."""
        eye = np.array([eye_m[:2] @ self.normal, eye_m[:2] @ self.along, eye_m[2]])
        directions = np.stack([rays[..., :2] @ self.normal, rays[..., :2] @ self.along, rays[..., 2]], axis=-1)
        low, high = zip((self.offset_m - self.thick_m, self.offset_m), self.span_m, (0.0, self.top_m), strict=True)
        with np.errstate(divide="ignore", invalid="ignore"):
            first, last = (low - eye) / directions, (high - eye) / directions
        enters, leaves = np.minimum(first, last).max(axis=-1), np.maximum(first, last).min(axis=-1)
        return np.where((enters <= leaves) & (enters > 0.0), enters, np.inf)

    def top_depth(self, eye_m: Array, rays: Array, behind_m: tuple[float, float]) -> Array:
        """Return (...) the depth of a level strip at the wall's top, infinite outside it.

        Args:
            eye_m: (3,) origin of the rays.
            rays: (..., 3) the rays.
            behind_m: Interval of the strip behind the wall's face.
        """
        with np.errstate(divide="ignore", invalid="ignore"):
            t = (self.top_m - eye_m[2]) / rays[..., 2]
        t = np.where((rays[..., 2] < -1e-9) & (t > 0), t, np.inf)
        with np.errstate(invalid="ignore"):
            at = eye_m[:2] + rays[..., :2] * t[..., None]
            side, behind = at @ self.along, self.offset_m - at @ self.normal
            hit = (side >= self.span_m[0]) & (side <= self.span_m[1])
            hit &= (behind >= behind_m[0]) & (behind <= behind_m[1])
        return np.where(hit, t, np.inf)

    def to_json(self) -> dict[str, object]:
        """Return it as plain data."""
        return {
            "normal": self.normal.tolist(),
            "offset_m": self.offset_m,
            "span_m": list(self.span_m),
            "top_m": self.top_m,
            "residual_m": self.residual_m,
            "thick_m": self.thick_m,
        }


def find_walls(
    observation: Observation, things: Sequence[Detection], fitted: NDArray[np.bool_] | None = None, seed: int = 0
) -> tuple[Wall, ...]:
    """Return the visible walls, the largest first.

    Args:
        observation: The observation.
        things: Detections; their boxes are left out, since furniture has upright planes too.
        fitted: (H, W) pixels of fitted objects, which are left out. Without detections and fits, a wall is a plane with
            nearly everything visible on one side.
        seed: Of the random planes that are tried.
    """
    rng = np.random.default_rng(seed)
    points, sigma = observation.points_m, observation.depth_distortion_m
    unboxed = observation.measured.copy() if fitted is None else observation.measured & ~fitted
    furnished = bool(things) or fitted is not None
    for thing in things:
        x0, y0, x1, y1 = thing.box_px
        over_x, over_y = _BOX_MARGIN * (x1 - x0), _BOX_MARGIN * (y1 - y0)
        left_px, top_px = max(0, round(x0 - over_x)), max(0, round(y0 - over_y))
        unboxed[top_px : round(y1 + over_y), left_px : round(x1 + over_x)] = False
    free = unboxed & (observation.z_m < _FARTHEST_M) & (points[..., 2] > _ABOVE_FLOOR_M + 3 * sigma)
    left, sigma_left = points[free], sigma[free]
    least, enough = max(_LEAST_POINTS, _LEAST_SHARE * len(left)), _SHARE * len(left)
    found: list[Wall] = []
    for _ in range(2 * _MOST):
        if len(left) < least or len(found) == _MOST:
            break
        plane = _plane(left, sigma_left, rng)
        if plane is None:
            break
        normal, offset = _along_others(left, sigma_left, plane, found)
        near = np.abs(left[:, :2] @ normal - offset) < 0.05 + 3 * sigma_left
        if int(near.sum()) < least:
            break
        wall = _lowered_to_visible_top(_wall(left[near], normal, offset), observation)
        # A strip of a table's top is in a plane, too.
        is_upright = (left[near, 2] < wall.top_m - _STRIP_M).mean() > _LEAST_BELOW
        # A piece of furniture may have no box: its front is no wall.
        is_large = furnished and int(near.sum()) >= enough and _is_beyond_furniture(wall, observation, unboxed)
        ends_room = is_large or _ends_room(wall, points[observation.measured & (observation.z_m < _FARTHEST_M)])
        # What is off the plane by more than noise is a row of things, and no wall.
        is_flat = wall.residual_m < _FLAT_M + _FLAT_SIGMAS * float(np.median(sigma_left[near]))
        if (
            ends_room
            and is_upright
            and is_flat
            and -wall.offset_m > (_NEAREST_LARGE_M if is_large else _NEAREST_M)
            and _is_solid(wall, observation)
            and not (fitted is not None and _is_front(wall, observation, fitted))
            and all(_differs(wall, other) for other in found)
        ):
            found.append(_with_top(wall, observation))
        left, sigma_left = left[~near], sigma_left[~near]
    return tuple(found)


def find_walls_again(
    walls: Sequence[Wall], observation: Observation, things: Sequence[Detection], fitted: NDArray[np.bool_]
) -> tuple[Wall, ...]:
    """Find walls again once the pixels of furniture are known; keep the old ones that are not found so.

    Args:
        walls: Walls found outside all boxes: a low one, or one right behind an object, may be in a box.
        observation: The observation.
        things: Detections that were not fitted.
        fitted: (H, W) pixels of those that were.
    """
    found = find_walls(observation, things, fitted)
    return (*found, *(wall for wall in walls if all(_differs(wall, other) for other in found)))


def depth_of_empty(observation: Observation, walls: Sequence[Wall]) -> tuple[Array, NDArray[np.int32]]:
    """Return (H, W) depth of a room without objects, and its surface: 0 the floor, then the walls."""
    depth = np.stack([observation.floor_z_m, *(wall.depth(observation.eye_m, observation.rays) for wall in walls)])
    return depth.min(axis=0), depth.argmin(axis=0).astype(np.int32)


def _plane(points: Array, sigma: Array, rng: np.random.Generator) -> tuple[Array, float] | None:
    chosen = rng.choice(len(points), min(_SAMPLES, len(points)), replace=False)
    flat, spread = points[chosen, :2], sigma[chosen]
    best: tuple[float, Array, float] | None = None
    for _ in range(_TRIALS):
        a, b = flat[rng.choice(len(flat), 2, replace=False)]
        length = float(np.linalg.norm(b - a))
        if length < 0.4:
            continue
        normal = np.array([-(b - a)[1], (b - a)[0]]) / length
        offset = float(normal @ a)
        count = float((np.abs(flat @ normal - offset) < 0.02 + spread).sum())
        if best is None or count > best[0]:
            best = (count, normal, offset)
    if best is None:
        return None
    _, normal, offset = best
    # Distances err along rays, whose inverses are linear in them on a plane.
    away = np.maximum(np.linalg.norm(points[:, :2], axis=1), 1e-6)
    rays = points[:, :2] / away[:, None]
    for tolerance_m in _TOLERANCES_M:
        slope = np.abs(rays @ normal)
        near = np.abs(points[:, :2] @ normal - offset) < tolerance_m + _SIGMAS * sigma * slope
        if int(near.sum()) < 50:
            return None
        weight = away[near] ** 2 / sigma[near]
        inverse, *_ = np.linalg.lstsq(rays[near] * weight[:, None], weight / away[near], rcond=None)
        # Towards the camera, which is at the origin.
        offset = -1.0 / float(np.linalg.norm(inverse))
        normal = inverse * offset
    return normal, offset


def _along_others(
    points: Array, sigma: Array, plane: tuple[Array, float], others: Sequence[Wall]
) -> tuple[Array, float]:
    """Align a plane with another wall, or square to it, if that fits its points too: few points fix its yaw."""
    normal, offset = plane
    for normal_of_other in (
        sign * direction for wall in others for direction in (wall.normal, wall.along) for sign in (1.0, -1.0)
    ):
        if float(normal @ normal_of_other) < _AS_OTHERS:
            continue
        within_m = 0.05 + 3 * sigma
        near = np.abs(points[:, :2] @ normal - offset) < within_m
        across = points[:, :2] @ normal_of_other
        as_other = float(np.median(across[near]))
        if (np.abs(across - as_other) < within_m).sum() >= near.sum():
            return normal_of_other, as_other
    return plane


def _wall(points: Array, normal: Array, offset: float) -> Wall:
    side = points[:, :2] @ np.array([-normal[1], normal[0]])
    low, high = np.percentile(side, [0.5, 99.5])
    off = np.abs(points[:, :2] @ normal - offset)
    top = float(np.percentile(points[:, 2], 99.5))
    return Wall(normal, offset, (float(low), float(high)), top, float(np.median(off)))


def _lowered_to_visible_top(wall: Wall, observation: Observation) -> Wall:
    """Lower a wall to where something is visible over it: another one may cross its plane higher up."""
    through, looked, heights_m = _pixels_through(wall, observation)
    if through.sum() < _MOST_THROUGH * looked.sum():
        return wall
    return replace(wall, top_m=float(np.percentile(heights_m[through], _BEGINS)))


def _is_solid(wall: Wall, observation: Observation) -> bool:
    """Return whether it is large, and nothing is visible through it."""
    length_m = wall.span_m[1] - wall.span_m[0]
    if length_m < _LEAST_VISIBLE_M or wall.top_m < _LEAST_TOP_M:
        return False
    if length_m < _LEAST_LENGTH_M and not _has_no_end(wall, observation):
        return False
    through, looked, _ = _pixels_through(wall, observation)
    return bool(through.sum() < _MOST_THROUGH * max(1, looked.sum()))


def _pixels_through(wall: Wall, observation: Observation) -> tuple[NDArray[np.bool_], NDArray[np.bool_], Array]:
    """Return (H, W) pixels with something farther, the pixels of the wall, and their heights [m]."""
    depth = wall.depth(observation.eye_m, observation.rays)
    looked: NDArray[np.bool_] = np.isfinite(depth) & observation.measured
    through = looked & (observation.z_m > depth + 0.10 + 5 * observation.depth_distortion_m)
    heights_m = observation.eye_m[2] + observation.rays[..., 2] * np.where(looked, depth, 0.0)
    return through, looked, heights_m


def _is_beyond_furniture(wall: Wall, observation: Observation, unboxed: NDArray[np.bool_]) -> bool:
    """Return whether it is longer than pieces of furniture, and higher or thinner than rows of them."""
    is_long = wall.span_m[1] - wall.span_m[0] > _LONG_M or _has_no_end(wall, observation)
    return is_long and (wall.top_m > _HIGH_M or _is_thin(wall, observation, unboxed))


def _is_front(wall: Wall, observation: Observation, fitted: NDArray[np.bool_]) -> bool:
    """Return whether most of it are fronts of furniture, which is known by now."""
    depth = wall.depth(observation.eye_m, observation.rays)
    looked = np.isfinite(depth) & observation.measured & (observation.z_m < depth + _FRONT_M)
    on_it = looked & fitted & (observation.z_m > depth - _FRONT_M)
    return bool(on_it.sum() > 0.5 * looked.sum())


def _has_no_end(wall: Wall, observation: Observation) -> bool:
    """Return whether both ends are hidden, or outside the picture: its length is unknown."""
    (low, high), (least, most) = wall.span_m, _BEYOND_END_M
    ends = (low - most, low - least), (high + least, high + most)
    return all(_is_hidden(replace(wall, span_m=end), observation) for end in ends)


def _is_hidden(wall: Wall, observation: Observation) -> bool:
    """Return whether nearer objects hide nearly all of it, or hardly a pixel looks at it."""
    depth = wall.depth(observation.eye_m, observation.rays)
    looked = np.isfinite(depth) & observation.measured
    farther = looked & (observation.z_m >= depth - _NEARER_M - 3 * observation.depth_distortion_m)
    return bool(farther.sum() < max(_LEAST_BEHIND_PX, (1.0 - _LOOKED_OVER) * looked.sum()))


def _is_thin(wall: Wall, observation: Observation, unboxed: NDArray[np.bool_]) -> bool:
    """Return whether, outside all boxes, its top ends behind its face, unlike that of furniture.

    Evidence is just above the top, and just below in case the top is lower: from afar one looks far over an edge before
    something clearly farther is visible.
    """
    below_m, above_m = _ABOUT_TOP_M
    depth = replace(wall, top_m=wall.top_m + above_m).depth(observation.eye_m, observation.rays)
    heights_m = observation.eye_m[2] + observation.rays[..., 2] * np.where(np.isfinite(depth), depth, 0.0)
    behind_m = wall.offset_m - observation.points_m[..., :2] @ wall.normal
    least_m, most_m = _TOP_M
    beyond = np.isfinite(depth) & unboxed & (heights_m > wall.top_m - below_m) & (behind_m > least_m)
    on_top = beyond & (behind_m < most_m) & (np.abs(observation.points_m[..., 2] - wall.top_m) < _AT_TOP_M)
    return bool(beyond.sum() >= _LEAST_BEHIND_PX and on_top.sum() < (1.0 - _LOOKED_OVER) * beyond.sum())


def _with_top(wall: Wall, observation: Observation) -> Wall:
    """Add the visible depth of a wall's top."""
    depth = wall.top_depth(observation.eye_m, observation.rays, (0.0, _TOP_M[0]))
    on_top = observation.measured & (np.abs(observation.z_m - depth) < 3 * observation.depth_distortion_m)
    if int(on_top.sum()) < _LEAST_BEHIND_PX:
        return wall
    thick_m = float(np.percentile(wall.offset_m - observation.points_m[on_top, :2] @ wall.normal, 98.0))
    return replace(wall, thick_m=thick_m) if thick_m > _LEAST_THICK_M else wall


def _ends_room(wall: Wall, points: Array) -> bool:
    """Return whether hardly anything but floor is visible beyond its plane, to its sides and above it too."""
    beyond = (points[:, :2] @ wall.normal < wall.offset_m - _BEYOND_M) & (points[:, 2] > _ABOVE_FLOOR_M)
    return float(beyond.mean()) < _BEYOND


def _differs(wall: Wall, other: Wall) -> bool:
    parallel = abs(float(wall.normal @ other.normal)) > math.cos(math.radians(10.0))
    return not parallel or abs(wall.offset_m - other.offset_m) > 0.25
