"""The picture in the level frame: a ray, a depth and its noise for every pixel.

The floor defines the level frame: it is the lowest large plane below the camera. It gives the vertical, the camera's
height and the noise of the depth.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from executor.geometry import Array
from executor.photo.errors import PhotoRefused
from executor.photo.inputs.depth import Depth
from executor.photo.inputs.picture import Intrinsics, Photograph
from executor.system.extras import require


@dataclass(frozen=True)
class Noise:
    """Standard deviation of depth: `base_m` close by, growing by `growth_per_m` times the square of the depth."""

    base_m: float
    growth_per_m: float

    def sigma_m(self, z_m: Array) -> Array:
        """Return the standard deviation at some depths."""
        return np.asarray(self.base_m + self.growth_per_m * z_m**2)

    def to_json(self) -> dict[str, object]:
        """Return it as plain data."""
        return {"base_m": self.base_m, "growth_per_m": self.growth_per_m}


TYPICAL = Noise(0.002, 0.0018)
"""Of structured-light and stereo cameras for rooms; assumed until the floor has been measured."""

_NEARER_M = 0.08
_NEAREST_M = 0.05  # Before the camera.


@dataclass(frozen=True)
class Observation:
    """A picture in the level frame, with or without depth.

    Attributes:
        rgb: (H, W, 3) uint8.
        z_m: (H, W) depth along the camera's axis, 0 where nothing was measured.
        rays: (H, W, 3) in the level frame; a point is the eye plus depth times ray.
        eye_m: (3,) the camera: on the z axis of the level frame.
        R_camera_level: (3, 3) level to camera.
        noise: Of the depth.
        K: The camera's intrinsics.
        depth_distortion: Relative depth error that varies slowly over the picture, see `Depth`.
        heading_rad: Without depth, or if it is distorted, one of the main directions of the room's lines, up to quarter
            turns.
    """

    rgb: NDArray[np.uint8]
    z_m: Array
    rays: Array
    eye_m: Array
    R_camera_level: Array
    noise: Noise
    K: Intrinsics
    heading_rad: float | None = None
    depth_distortion: float = 0.0

    @property
    def size_px(self) -> tuple[int, int]:
        """Width and height."""
        return self.z_m.shape[1], self.z_m.shape[0]

    @cached_property
    def has_depth(self) -> bool:
        """Whether anything was measured; else the picture is the only evidence."""
        return bool(self.z_m.any())

    @cached_property
    def measured(self) -> NDArray[np.bool_]:
        """(H, W) where there is a depth."""
        return self.z_m > 0.0

    @cached_property
    def points_m(self) -> Array:
        """(H, W, 3) in the level frame; the eye where nothing was measured."""
        return np.asarray(self.eye_m + self.rays * self.z_m[..., None])

    @cached_property
    def sigma_m(self) -> Array:
        """(H, W) standard deviation of each depth."""
        return self.noise.sigma_m(self.z_m)

    @property
    def depth_distortion_m(self) -> Array:
        """(H, W) standard deviation of each depth including its distortion."""
        return np.hypot(self.sigma_m, self.depth_distortion * self.z_m)

    @property
    def floor_z_m(self) -> Array:
        """(H, W) depth of the floor, infinite above the horizon."""
        down = -self.rays[..., 2]
        return np.where(down > 1e-6, self.eye_m[2] / np.maximum(down, 1e-6), np.inf)

    def pixels(self, points_m: Array) -> Array:
        """Return (N, 2) the pixels of points (N, 3) of the level frame; nan behind the camera."""
        in_camera = (np.atleast_2d(points_m) - self.eye_m) @ self.R_camera_level.T
        depth = np.where(in_camera[:, 2] > 1e-6, in_camera[:, 2], np.nan)
        u = self.K.fx * in_camera[:, 0] / depth + self.K.cx
        v = self.K.fy * in_camera[:, 1] / depth + self.K.cy
        return np.stack([u, v], axis=1)

    def bounds_px(self, points_m: Array) -> tuple[Array, Array]:
        """Return the least and the largest u and v of the visible part of the hull of points (N, 3).

        They are those of the points themselves if none of it is in the picture, nan if all of it is behind the camera.
        """
        pixels = self.pixels(points_m)
        if np.isnan(pixels).any():
            pixels = self.pixels(self._before(points_m))
        if not len(pixels):
            return np.full(2, np.nan), np.full(2, np.nan)
        low, high = pixels.min(axis=0), pixels.max(axis=0)
        if (low >= 0.0).all() and (high <= self.size_px).all():
            return low, high
        geometry = require("shapely.geometry", "photo")
        shown = geometry.MultiPoint(pixels).convex_hull.intersection(geometry.box(0.0, 0.0, *self.size_px))
        return (low, high) if shown.is_empty else (np.array(shown.bounds[:2]), np.array(shown.bounds[2:]))

    def _before(self, points_m: Array) -> Array:
        """Return points (N, 3) whose hull is the part before the camera of the hull of some points (M, 3)."""
        depth = (points_m - self.eye_m) @ self.R_camera_level.T[:, 2] - _NEAREST_M
        before, behind = points_m[depth > 0.0], points_m[depth <= 0.0]
        near, far = depth[depth > 0.0][:, None], depth[depth <= 0.0][None, :]
        share = (near / np.maximum(near - far, 1e-9))[..., None]
        crossing = before[:, None] + share * (behind[None, :] - before[:, None])
        return np.concatenate([before, crossing.reshape(-1, 3)])

    @cached_property
    def edges(self) -> NDArray[np.bool_]:
        """(H, W) where depth jumps to a neighbour by more than noise does, or was not measured."""
        jump = 0.04 + 4.0 * self.noise.sigma_m(self.z_m)
        across = np.abs(np.diff(self.z_m, axis=1, append=self.z_m[:, -1:])) > jump
        down = np.abs(np.diff(self.z_m, axis=0, append=self.z_m[-1:])) > jump
        return np.asarray(across | down)


def is_hidden(observation: Observation, depth_m: Array) -> NDArray[np.bool_]:
    """Return (H, W) where something clearly nearer than a depth picture (H, W) was measured."""
    return np.asarray(
        observation.measured & (observation.z_m < depth_m - _NEARER_M - 4.0 * observation.depth_distortion_m)
    )


_SAMPLES = 8000
_LEAST_SLOPE = 0.02  # Of rays that meet the floor: lower ones carry no information.
_TOLERANCES_M, _SIGMAS = (0.08, 0.04, 0.02, 0.01, 0.005, 0.0, 0.0, 0.0, 0.0), 1.5
"""Decreasing tolerances of floor points, in addition to noise: feet of walls and legs are above the floor."""
_TRIALS = 600
_FARTHEST_M = 7.0  # Beyond that, noise makes every plane as good.
_STEEPEST_RAD = math.radians(70.0)  # Between the floor's normal and the picture's upward direction.
HEIGHTS_M = (0.4, 3.0)
"""Of a camera above a floor; lower planes are tables."""

_NEIGHBOUR_PX = 60
_SPREAD_M2 = 0.35
"""Least visible floor, in cells of 10 cm: a smaller area can be anything."""

_AT_M, _NOISIEST_M = 2.0, 0.05  # Cameras for rooms have 1 cm there; more means no plane, or another one.
_BELOW_WEIGHT = 3.0  # A floor has nothing below it; each point there counts against this many on it.
_LEVELS = 8  # Bins of depth in which noise is measured.
_REFINED, _ALIKE_M, _ALIKE = 12, 0.10, math.cos(math.radians(3.0))

_SHOW_IT = (
    f"expected {_SPREAD_M2} m2 of floor, {HEIGHTS_M[0]:g} to {HEIGHTS_M[1]:g} m below the camera: take the picture so "
    "that it shows some, and see that its depths are in the right unit (--depth-unit-m)"
)


@dataclass(frozen=True)
class FloorPlane:
    """The floor in the camera's frame.

    Attributes:
        up: (3,) unit normal in the camera's frame.
        height_m: Of the camera above it.
        visible_m2: Visible area.
        tilt_deg: How far the camera looks down.
        residual_m: Median distance of its points from the plane.
        source: Its origin, for people.
        spread_share: Relative uncertainty of its distance: the scale of everything on it.
    """

    up: Array
    height_m: float
    visible_m2: float
    tilt_deg: float
    residual_m: float
    source: str = "plane fitted to the depth"
    spread_share: float = 0.0

    def to_json(self) -> dict[str, object]:
        """Return it as plain data."""
        return {
            "camera_height_m": self.height_m,
            "camera_looks_down_deg": self.tilt_deg,
            "floor_seen_m2": self.visible_m2,
            "floor_residual_m": self.residual_m,
            "source": self.source,
            "spread_share": self.spread_share,
        }


def observe(
    picture: Photograph, depth: Depth, camera: Intrinsics, under: FloorPlane | None = None, seed: int = 0
) -> tuple[Observation, FloorPlane]:
    """Return the picture in the level frame, and the floor that levels it.

    Args:
        picture, depth, camera: The input.
        under: The floor, if it is known without the depth; else it is searched for.
        seed: Of the random planes that are tried.

    Raises:
        PhotoRefused: No floor is visible.
    """
    rays = camera.rays(picture.size_px)
    near = (depth.z_m > 0.0) & (depth.z_m < _FARTHEST_M)
    rng = np.random.default_rng(seed)
    candidates = _candidates(rays, depth.z_m, near, rng) if under is None else []
    points = _sample(rays, depth.z_m, near, rng)
    plane = _best(candidates, points) if under is None else (under.up, under.height_m)
    if plane is None:
        problem = "no floor is seen in it: nothing level is below the camera"
        raise PhotoRefused("floor", picture.source, problem, _SHOW_IT)
    floor = _described(points, *plane)
    if under is not None:
        floor = replace(floor, source=under.source, spread_share=under.spread_share)
    if floor.visible_m2 < _SPREAD_M2 or not HEIGHTS_M[0] <= floor.height_m <= HEIGHTS_M[1]:
        problem = f"no floor is seen in it: the best plane has {floor.visible_m2:.2f} m2, {floor.height_m:.2f} m below"
        raise PhotoRefused("floor", picture.source, problem, _SHOW_IT)
    noise = _noise(points, floor)
    if float(noise.sigma_m(np.array(_AT_M))) > _NOISIEST_M:
        problem = f"what looks like its floor is uneven by {100 * noise.sigma_m(np.array(_AT_M)):.0f} cm"
        raise PhotoRefused("floor", picture.source, problem, "expected a flat floor, seen near the camera")
    R = level_rotation(floor.up)
    level = Observation(
        picture.rgb,
        depth.z_m,
        rays @ R.T,
        np.array([0.0, 0.0, floor.height_m]),
        R.T,
        noise,
        camera,
        depth_distortion=depth.depth_distortion,
    )
    return level, floor


def _sample(rays: Array, z_m: Array, near: NDArray[np.bool_], rng: np.random.Generator) -> Array:
    rows, columns = np.nonzero(near)
    chosen = rng.choice(len(rows), min(_SAMPLES, len(rows)), replace=False)
    return np.asarray(rays[rows[chosen], columns[chosen]] * z_m[rows[chosen], columns[chosen], None])


def _candidates(
    rays: Array, z_m: Array, near: NDArray[np.bool_], rng: np.random.Generator
) -> list[tuple[Array, float]]:
    """Return planes through three neighbouring pixels, as (normal, height) with the camera above them."""
    rows, columns = np.nonzero(near)
    if len(rows) < 500:
        return []
    found = []
    first = rng.choice(len(rows), _TRIALS)
    for index in first:
        offsets = rng.integers(-_NEIGHBOUR_PX, _NEIGHBOUR_PX + 1, (2, 2))
        at = np.clip(
            np.array([rows[index], columns[index]]) + np.vstack([[0, 0], offsets]), 0, np.array(near.shape) - 1
        )
        if not near[at[:, 0], at[:, 1]].all():
            continue
        a, b, c = rays[at[:, 0], at[:, 1]] * z_m[at[:, 0], at[:, 1], None]
        normal = np.cross(b - a, c - a)
        length = float(np.linalg.norm(normal))
        if length < 1e-4:
            continue
        normal = normal / length
        normal = normal if -normal[1] > 0 else -normal
        height = -float(normal @ a)
        # Neighbours are noisy, so that limits are wide here and narrow for the plane that is found.
        if -normal[1] >= math.cos(_STEEPEST_RAD) and 0.7 * HEIGHTS_M[0] <= height <= 1.3 * HEIGHTS_M[1]:
            found.append((normal, height))
    return found


def _best(candidates: list[tuple[Array, float]], points: Array) -> tuple[Array, float] | None:
    """Return the plane with the most points on it and the fewest below, None if there is none."""
    planes = list(zip(*_refined(candidates, points), strict=True)) if len(points) >= 500 else []
    return max(planes, key=lambda plane: _score(points, *plane)) if planes else None


def _refined(candidates: list[tuple[Array, float]], points: Array) -> tuple[list[Array], list[float]]:
    """Fit the best candidates to the points near them, with decreasing tolerance."""
    rough = [(_score(points, normal, height, slack_m=0.05), normal, height) for normal, height in candidates]
    rough.sort(key=lambda one: -one[0])
    normals, heights = [], []
    kept: list[tuple[Array, float]] = []
    for _, normal, height in rough:
        # Of planes that are nearly the same the first one is enough.
        if any(abs(height - other) < _ALIKE_M and normal @ near > _ALIKE for near, other in kept):
            continue
        kept.append((normal, height))
        if len(kept) == _REFINED:
            break
    for normal, height in kept:
        for tolerance_m in _TOLERANCES_M:
            normal, height = _fitted(points, normal, height, tolerance_m)
        # A plane that leans after refinement is a wall.
        if -normal[1] >= math.cos(_STEEPEST_RAD):
            normals.append(normal)
            heights.append(height)
    return normals, heights


def _fitted(points: Array, normal: Array, height: float, tolerance_m: float) -> tuple[Array, float]:
    """Fit a plane to the points near it: depth errs along rays, whose inverses are linear in them on a plane."""
    rays = points / points[:, 2:]
    slope = -(rays @ normal)
    depth = height / np.maximum(slope, 1e-6)
    sigma = TYPICAL.sigma_m(depth)
    on = (slope > _LEAST_SLOPE) & (np.abs(points[:, 2] - depth) * slope < tolerance_m + _SIGMAS * sigma * slope)
    if int(on.sum()) < 50:
        return normal, height
    weight = depth[on] ** 2 / sigma[on]
    inverse, *_ = np.linalg.lstsq(rays[on] * weight[:, None], weight / points[on, 2], rcond=None)
    fitted_m = 1.0 / float(np.linalg.norm(inverse))
    return np.asarray(-fitted_m * inverse), fitted_m


def _score(points: Array, normal: Array, height: float, slack_m: float = 0.01) -> float:
    sigma = TYPICAL.sigma_m(points[:, 2])
    off = points @ normal + height
    on = (np.abs(off) < slack_m + sigma).sum()
    below = (off < -0.05 - slack_m - 4 * sigma).sum()
    return float(on - _BELOW_WEIGHT * below)


def _described(points: Array, normal: Array, height: float) -> FloorPlane:
    off = points @ normal + height
    on = np.abs(off) < 0.015 + 2 * TYPICAL.sigma_m(points[:, 2])
    R = level_rotation(normal)
    cells = np.unique(np.round((points[on] @ R.T)[:, :2] / 0.1).astype(int), axis=0)
    tilt = math.degrees(math.asin(float(np.clip(-normal[2], -1.0, 1.0))))
    residual = float(np.median(np.abs(off[on]))) if on.any() else math.inf
    return FloorPlane(normal, float(height), 0.01 * len(cells), tilt, residual)


def level_rotation(up: Array) -> Array:
    """Return (3, 3) camera to level: z up, x where the camera looks."""
    ahead = np.array([0.0, 0.0, 1.0]) - up[2] * up
    ahead /= np.linalg.norm(ahead)
    return np.stack([ahead, np.cross(up, ahead), up])


def _noise(points: Array, floor: FloorPlane) -> Noise:
    """Estimate the depth noise from the floor's points: their spread along the rays, by depth."""
    off = points @ floor.up + floor.height_m
    # Depth errs along the ray, which meets the floor at a low angle: the foot of a wall is farther off than noise.
    slope = np.abs(points @ floor.up) / points[:, 2]
    on = np.abs(off) < 0.005 + 3 * TYPICAL.sigma_m(points[:, 2]) * slope
    along = np.abs(off[on]) / np.maximum(slope[on], 1e-6)
    z = points[on, 2]
    edges = np.quantile(z, np.linspace(0, 1, _LEVELS + 1))
    bins = [(z >= low) & (z <= high) for low, high in itertools.pairwise(edges)]
    spread = np.array([1.4826 * np.median(along[one]) for one in bins])
    middle = np.array([np.median(z[one]) for one in bins])
    (base, growth), *_ = np.linalg.lstsq(np.stack([np.ones_like(middle), middle**2], axis=1), spread, rcond=None)
    # Files round to a millimetre.
    return Noise(max(float(base), 0.001), min(max(float(growth), 0.0), 0.01))
