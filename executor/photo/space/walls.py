"""The walls: large vertical planes outside the boxes of things, through which nothing is seen."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from executor.geometry import Array
from executor.photo.inputs.annotations import Sighting
from executor.photo.space.observation import Observation

_MOST = 4
_SHARE, _LEAST_SHARE = 0.06, 0.03  # Of what is neither floor nor in boxes; the least, of what the room ends at.
_LEAST_POINTS = 800
_LEAST_LENGTH_M, _LEAST_SEEN_M, _LEAST_TOP_M = 0.8, 0.5, 0.6  # The second, of what may go on at both ends.
_LONG_M, _HIGH_M = 1.5, 1.2  # Rows are lower, wardrobes and refrigerators narrower.
_STRIP_M, _LEAST_BELOW = 0.06, 0.2  # Below its top, and the least share of its points that are lower.
_FRONT_M = 0.1  # How far before or behind a wall's plane a front is that was taken for it.
_BEYOND_END_M, _NEARER_M = (0.03, 0.13), 0.03
_TOP_M, _AT_TOP_M = (0.15, 0.6), 0.12  # Behind its face furniture has its top, and walls no longer have theirs.
_ABOUT_TOP_M = (0.06, 0.04)  # Below and above a wall's top, where what is behind it is looked at.
_LEAST_THICK_M = 0.03  # Where the picture ends below a wall's top, noise puts some of its face behind itself.
_LEAST_BEHIND_PX, _LOOKED_OVER = 100, 0.8  # Of the pixels that look there: what nobody has boxed hides some.
_ABOVE_FLOOR_M = 0.10
_BESIDE = 0.06  # Of a box's sides, left out around it: twice what boxes are off by.
_NEAREST_M, _FARTHEST_M = 0.3, 9.0  # Nobody stands in a wall: a plane through the camera is a table's edge,
_BESIDE_CAMERA_M = 0.1  # unless it is larger than furniture: one may stand with a shoulder at a wall.
_TRIALS, _SAMPLES = 250, 4000
_TOLERANCES_M, _SIGMAS = (0.06, 0.03, 0.02, 0.01, 0.005, 0.005, 0.005), 1.5
"""How near to a wall its points are taken to be, ever nearer, beside noise: what stands before it is one-sided."""
_SEEN_THROUGH = 0.04  # Of the pixels that look at it.
_BEGINS = 2.0  # Percent of the pixels that look over a wall: its top, but for noise.
_ON_FLOOR, _BEND_PX, _FAR_FROM_FLOOR = 0.03, 40.0, 1e-4
"""Of bent depths: how near to the floor, as a share, it is seen; how far in the picture that tells how they are bent;
what counts where no floor is near."""

_AS_OTHERS = math.cos(math.radians(15.0))  # Of a plane's turn beside another wall's.
_SQUARE, _CORNER_M = math.cos(math.radians(10.0)), 0.3  # Of walls that meet.
_ASKEW_RAD = math.radians(15.0)  # What bends turn a wall by; one that is turned by more does not go along the lines.
_BEYOND_M, _BEYOND = 0.15, 0.04
"""So much of what is seen may stand beyond a wall's plane, of what can be a wall where no boxes tell furniture."""


@dataclass(frozen=True)
class Wall:
    """A wall in the level frame, upright.

    Attributes:
        normal: (2,) unit vector towards the camera.
        offset_m: The plane is where normal @ (x, y) is this.
        span_m: From where to where it is seen, along the direction to the left of the normal.
        top_m: How high it is seen.
        residual_m: Median distance of its points.
        thick_m: How far its top reaches behind its face, where it is looked over; 0 where no top is seen.
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
        """Heading of what stands with its back to it, whose front is at its own -x."""
        return math.atan2(-self.normal[1], -self.normal[0])

    def depth(self, eye_m: Array, rays: Array) -> Array:
        """Returns (...) the depth at which rays from an eye meet it, infinite where they do not."""
        eye = np.array([eye_m[:2] @ self.normal, eye_m[:2] @ self.along, eye_m[2]])
        ways = np.stack([rays[..., :2] @ self.normal, rays[..., :2] @ self.along, rays[..., 2]], axis=-1)
        low, high = zip((self.offset_m - self.thick_m, self.offset_m), self.span_m, (0.0, self.top_m), strict=True)
        with np.errstate(divide="ignore", invalid="ignore"):
            first, last = (low - eye) / ways, (high - eye) / ways
        enters, leaves = np.minimum(first, last).max(axis=-1), np.maximum(first, last).min(axis=-1)
        return np.where((enters <= leaves) & (enters > 0.0), enters, np.inf)

    def top_depth(self, eye_m: Array, rays: Array, behind_m: tuple[float, float]) -> Array:
        """Returns (...) the depth of a level strip at the wall's top, infinite beside it.

        Args:
            eye_m: (3,) where rays begin.
            rays: (..., 3) where they go.
            behind_m: From how far behind the wall's face the strip reaches how far.
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
        """Returns it as plain data."""
        return {
            "normal": self.normal.tolist(),
            "offset_m": self.offset_m,
            "span_m": list(self.span_m),
            "top_m": self.top_m,
            "residual_m": self.residual_m,
            "thick_m": self.thick_m,
        }


def find_walls(
    seen: Observation, things: Sequence[Sighting], fitted: NDArray[np.bool_] | None = None, seed: int = 0
) -> tuple[Wall, ...]:
    """Returns the walls that are seen, the largest first.

    Args:
        seen: The observation.
        things: What stands in the room; their boxes are left out, since furniture has upright planes too.
        fitted: (H, W) pixels of other things, none of which is in them. Where there are no things, and none were
            fitted, a wall is what nearly all that is seen is on one side of.
        seed: Of the random planes that are tried.
    """
    rng = np.random.default_rng(seed)
    points, sigma = seen.points_m, seen.bent_m
    beside = seen.measured.copy() if fitted is None else seen.measured & ~fitted
    furnished = bool(things) or fitted is not None
    for thing in things:
        x0, y0, x1, y1 = thing.box_px
        over_x, over_y = _BESIDE * (x1 - x0), _BESIDE * (y1 - y0)
        left_px, top_px = max(0, round(x0 - over_x)), max(0, round(y0 - over_y))
        beside[top_px : round(y1 + over_y), left_px : round(x1 + over_x)] = False
    free = beside & (seen.z_m < _FARTHEST_M) & (points[..., 2] > _ABOVE_FLOOR_M + 3 * sigma)
    left, sigma_left = points[free], sigma[free]
    least, enough = max(_LEAST_POINTS, _LEAST_SHARE * len(left)), _SHARE * len(left)
    straight = _straight(seen)[free]
    found: list[Wall] = []
    for _ in range(2 * _MOST):
        if len(left) < least or len(found) == _MOST:
            break
        plane = _plane(left, sigma_left, rng)
        if plane is None:
            break
        normal, offset = plane if seen.bend_share else _along_others(left, sigma_left, plane, found)
        near = np.abs(left[:, :2] @ normal - offset) < 0.05 + 3 * sigma_left
        if int(near.sum()) < least:
            break
        if seen.bend_share and seen.heading_rad is not None:
            normal, offset = _squared(left[near], (normal, offset), seen.heading_rad, straight[near])
        wall = _as_low_as_seen_over(_wall(left[near], normal, offset), seen)
        # A strip of a table's top is in a plane, too.
        is_upright = (left[near, 2] < wall.top_m - _STRIP_M).mean() > _LEAST_BELOW
        # Somebody may have left out a piece of furniture: its front is no wall.
        is_large = furnished and int(near.sum()) >= enough and _is_beyond_furniture(wall, seen, beside)
        ends_room = is_large or _ends_room(wall, points[seen.measured & (seen.z_m < _FARTHEST_M)])
        if (
            ends_room
            and is_upright
            and -wall.offset_m > (_BESIDE_CAMERA_M if is_large else _NEAREST_M)
            and _is_solid(wall, seen)
            and not (fitted is not None and _is_front(wall, seen, fitted))
            and all(_differs(wall, other) for other in found)
        ):
            found.append(_with_top(wall, seen))
        left, sigma_left, straight = left[~near], sigma_left[~near], straight[~near]
    return _ended_in_corners(found) if seen.bend_share else tuple(found)


def seen_anew(
    walls: Sequence[Wall], seen: Observation, things: Sequence[Sighting], fitted: NDArray[np.bool_]
) -> tuple[Wall, ...]:
    """Returns walls as they are seen when it is known which pixels are of furniture, and those that are not seen so.

    Args:
        walls: As they were found outside all boxes: one that is low, or right behind something, may be in a box.
        seen: The observation.
        things: Those that were not fitted.
        fitted: (H, W) pixels of those that were.
    """
    found = find_walls(seen, things, fitted)
    return (*found, *(wall for wall in walls if all(_differs(wall, other) for other in found)))


def depth_of_empty(seen: Observation, walls: Sequence[Wall]) -> tuple[Array, NDArray[np.int32]]:
    """Returns (H, W) depth of a room without things, and of which it is: 0 the floor, then the walls."""
    depth = np.stack([seen.floor_z_m, *(wall.depth(seen.eye_m, seen.rays) for wall in walls)])
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
    """A plane along or square to another wall where that goes through its points, too: few tell its turn."""
    normal, offset = plane
    for normal_of_other in (sign * way for wall in others for way in (wall.normal, wall.along) for sign in (1.0, -1.0)):
        if float(normal @ normal_of_other) < _AS_OTHERS:
            continue
        within_m = 0.05 + 3 * sigma
        near = np.abs(points[:, :2] @ normal - offset) < within_m
        across = points[:, :2] @ normal_of_other
        as_other = float(np.median(across[near]))
        if (np.abs(across - as_other) < within_m).sum() >= near.sum():
            return normal_of_other, as_other
    return plane


def _ended_in_corners(walls: Sequence[Wall]) -> tuple[Wall, ...]:
    """Walls that end where others begin, which bent depths have a little beyond."""
    found = []
    for wall in walls:
        low, high = wall.span_m
        for other in walls:
            across = float(other.normal @ wall.along)
            if abs(across) < _SQUARE:
                continue
            corner = other.offset_m / across
            low = corner if abs(low - corner) < _CORNER_M else low
            high = corner if abs(high - corner) < _CORNER_M else high
        found.append(replace(wall, span_m=(low, high)))
    return tuple(found)


def _straight(seen: Observation) -> Array:
    """(H, W) how much floor is seen near each pixel, by which depths that were bent have been straightened there."""
    on_floor = seen.measured & (np.abs(seen.z_m / seen.floor_z_m - 1.0) < _ON_FLOOR)
    return np.asarray(gaussian_filter(on_floor.astype(float), _BEND_PX)) + _FAR_FROM_FLOOR


def _squared(points: Array, plane: tuple[Array, float], heading_rad: float, straight: Array) -> tuple[Array, float]:
    """A wall of bent depth: along the lines of the room, and as far off as it is where floor is seen beside it."""
    normal, _ = plane
    found_rad = math.atan2(normal[1], normal[0])
    askew_rad = math.remainder(found_rad - heading_rad, math.pi / 2)
    if abs(askew_rad) > _ASKEW_RAD:
        return plane
    turn = found_rad - askew_rad
    along = np.array([math.cos(turn), math.sin(turn)])
    offsets = points[:, :2] @ along
    order = np.argsort(offsets)
    reached = np.cumsum(straight[order])
    return along, float(offsets[order][np.searchsorted(reached, reached[-1] / 2)])


def _wall(points: Array, normal: Array, offset: float) -> Wall:
    side = points[:, :2] @ np.array([-normal[1], normal[0]])
    low, high = np.percentile(side, [0.5, 99.5])
    off = np.abs(points[:, :2] @ normal - offset)
    top = float(np.percentile(points[:, 2], 99.5))
    return Wall(normal, offset, (float(low), float(high)), top, float(np.median(off)))


def _as_low_as_seen_over(wall: Wall, seen: Observation) -> Wall:
    """A wall that is looked over is as high as where that begins: another one may cross its plane higher up."""
    through, looked, heights_m = _seen_through(wall, seen)
    if through.sum() < _SEEN_THROUGH * looked.sum():
        return wall
    return replace(wall, top_m=float(np.percentile(heights_m[through], _BEGINS)))


def _is_solid(wall: Wall, seen: Observation) -> bool:
    """Whether it is large, and nothing is seen through it."""
    length_m = wall.span_m[1] - wall.span_m[0]
    if length_m < _LEAST_SEEN_M or wall.top_m < _LEAST_TOP_M:
        return False
    if length_m < _LEAST_LENGTH_M and not _has_no_end(wall, seen):
        return False
    through, looked, _ = _seen_through(wall, seen)
    return bool(through.sum() < _SEEN_THROUGH * max(1, looked.sum()))


def _seen_through(wall: Wall, seen: Observation) -> tuple[NDArray[np.bool_], NDArray[np.bool_], Array]:
    """(H, W) pixels in which something farther is seen, those that look at it, and how high these do, in metres."""
    depth = wall.depth(seen.eye_m, seen.rays)
    looked: NDArray[np.bool_] = np.isfinite(depth) & seen.measured
    through = looked & (seen.z_m > depth + 0.10 + 5 * seen.bent_m)
    heights_m = seen.eye_m[2] + seen.rays[..., 2] * np.where(looked, depth, 0.0)
    return through, looked, heights_m


def _is_beyond_furniture(wall: Wall, seen: Observation, beside: NDArray[np.bool_]) -> bool:
    """Whether it is longer than pieces of furniture, and higher or thinner than rows of them."""
    is_long = wall.span_m[1] - wall.span_m[0] > _LONG_M or _has_no_end(wall, seen)
    return is_long and (wall.top_m > _HIGH_M or _is_thin(wall, seen, beside))


def _is_front(wall: Wall, seen: Observation, fitted: NDArray[np.bool_]) -> bool:
    """Whether most of what is seen of it are fronts of furniture, which is known by now."""
    depth = wall.depth(seen.eye_m, seen.rays)
    looked = np.isfinite(depth) & seen.measured & (seen.z_m < depth + _FRONT_M)
    on_it = looked & fitted & (seen.z_m > depth - _FRONT_M)
    return bool(on_it.sum() > 0.5 * looked.sum())


def _has_no_end(wall: Wall, seen: Observation) -> bool:
    """Whether something is before either end, or the picture ends there: nobody knows how long it is."""
    (low, high), (least, most) = wall.span_m, _BEYOND_END_M
    ends = (low - most, low - least), (high + least, high + most)
    return all(_is_hidden(replace(wall, span_m=end), seen) for end in ends)


def _is_hidden(wall: Wall, seen: Observation) -> bool:
    """Whether what is nearer is seen nearly wherever it would be, or hardly a pixel looks at it."""
    depth = wall.depth(seen.eye_m, seen.rays)
    looked = np.isfinite(depth) & seen.measured
    farther = looked & (seen.z_m >= depth - _NEARER_M - 3 * seen.bent_m)
    return bool(farther.sum() < max(_LEAST_BEHIND_PX, (1.0 - _LOOKED_OVER) * looked.sum()))


def _is_thin(wall: Wall, seen: Observation, beside: NDArray[np.bool_]) -> bool:
    """Whether, outside all boxes, its top does not go on behind its face as that of furniture does.

    Looked at is what is seen just over it, and just below in case its top is lower: from afar one looks far over an
    edge before something clearly farther is seen.
    """
    below_m, above_m = _ABOUT_TOP_M
    depth = replace(wall, top_m=wall.top_m + above_m).depth(seen.eye_m, seen.rays)
    heights_m = seen.eye_m[2] + seen.rays[..., 2] * np.where(np.isfinite(depth), depth, 0.0)
    behind_m = wall.offset_m - seen.points_m[..., :2] @ wall.normal
    least_m, most_m = _TOP_M
    beyond = np.isfinite(depth) & beside & (heights_m > wall.top_m - below_m) & (behind_m > least_m)
    on_top = beyond & (behind_m < most_m) & (np.abs(seen.points_m[..., 2] - wall.top_m) < _AT_TOP_M)
    return bool(beyond.sum() >= _LEAST_BEHIND_PX and on_top.sum() < (1.0 - _LOOKED_OVER) * beyond.sum())


def _with_top(wall: Wall, seen: Observation) -> Wall:
    """A wall with as much of its top as is seen."""
    depth = wall.top_depth(seen.eye_m, seen.rays, (0.0, _TOP_M[0]))
    on_top = seen.measured & (np.abs(seen.z_m - depth) < 3 * seen.bent_m)
    if int(on_top.sum()) < _LEAST_BEHIND_PX:
        return wall
    thick_m = float(np.percentile(wall.offset_m - seen.points_m[on_top, :2] @ wall.normal, 98.0))
    return replace(wall, thick_m=thick_m) if thick_m > _LEAST_THICK_M else wall


def _ends_room(wall: Wall, points: Array) -> bool:
    """Whether hardly anything but floor is seen beyond its plane, to its sides and above it too: fronts have a room."""
    beyond = (points[:, :2] @ wall.normal < wall.offset_m - _BEYOND_M) & (points[:, 2] > _ABOVE_FLOOR_M)
    return float(beyond.mean()) < _BEYOND


def _differs(wall: Wall, other: Wall) -> bool:
    parallel = abs(float(wall.normal @ other.normal)) > math.cos(math.radians(10.0))
    return not parallel or abs(wall.offset_m - other.offset_m) > 0.25
