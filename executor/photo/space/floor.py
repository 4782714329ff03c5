"""The floor: the lowest large plane under the camera; from it come the vertical, the camera's height, and the noise."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from executor.geometry import Array
from executor.photo.inputs.camera import Intrinsics
from executor.photo.inputs.depth import Depth
from executor.photo.inputs.picture import Photograph
from executor.photo.refusal import PhotoRefused
from executor.photo.space.observation import TYPICAL, Noise, Observation

_SAMPLES = 8000
_LEAST_SLOPE = 0.02  # Of rays that meet the floor: lower ones tell nothing.
_TOLERANCES_M, _SIGMAS = (0.08, 0.04, 0.02, 0.01, 0.005, 0.0, 0.0, 0.0, 0.0), 1.5
"""How near the floor its points are taken to be, ever nearer, beside noise: feet of walls and legs are above it."""
_TRIALS = 600
_FARTHEST_M = 7.0  # Beyond that, noise makes every plane as good.
_STEEPEST_RAD = math.radians(70.0)  # Between the floor's normal and the picture's upward direction.
HEIGHTS_M = (0.4, 3.0)
"""Of a camera above a floor; lower planes are tables."""

_NEIGHBOUR_PX = 60
_SPREAD_M2 = 0.35
"""Of floor that is seen, in cells of 10 cm: a smaller patch can be anything."""

_AT_M, _NOISIEST_M = 2.0, 0.05  # Cameras for rooms have 1 cm there; what has more is no plane, or another one.
_BELOW_WEIGHT = 3.0  # A floor has nothing below it; each point there counts against this many on it.
_LEVELS = 8  # Bins of depth in which noise is measured.
_REFINED, _ALIKE_M, _ALIKE = 12, 0.10, math.cos(math.radians(3.0))

_SHOW_IT = (
    f"expected {_SPREAD_M2} m2 of floor, {HEIGHTS_M[0]:g} to {HEIGHTS_M[1]:g} m below the camera: take the picture so "
    "that it shows some, and see that its depths are in the right unit (--depth-unit-m)"
)


@dataclass(frozen=True)
class FloorSeen:
    """The floor as the camera sees it.

    Attributes:
        up: (3,) unit normal in the camera's frame.
        height_m: Of the camera above it.
        seen_m2: How much of it is seen.
        tilt_deg: How far the camera looks down.
        residual_m: Median distance of its points from the plane.
        source: What it is known by, for people.
        spread_share: How exactly its distance is known, as a share of it: the scale of all that stands on it.
    """

    up: Array
    height_m: float
    seen_m2: float
    tilt_deg: float
    residual_m: float
    source: str = "plane fitted to the depth"
    spread_share: float = 0.0

    def to_json(self) -> dict[str, object]:
        """Returns it as plain data."""
        return {
            "camera_height_m": self.height_m,
            "camera_looks_down_deg": self.tilt_deg,
            "floor_seen_m2": self.seen_m2,
            "floor_residual_m": self.residual_m,
            "source": self.source,
            "spread_share": self.spread_share,
        }


def observe(
    picture: Photograph, depth: Depth, camera: Intrinsics, under: FloorSeen | None = None, seed: int = 0
) -> tuple[Observation, FloorSeen]:
    """Returns the picture in the level frame, and the floor that levels it.

    Args:
        picture, depth, camera: What is given.
        under: The floor, where it is known without the depth; else it is looked for.
        seed: Of the random planes that are tried.

    Raises:
        PhotoRefused: No floor is seen.
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
    if floor.seen_m2 < _SPREAD_M2 or not HEIGHTS_M[0] <= floor.height_m <= HEIGHTS_M[1]:
        problem = f"no floor is seen in it: the best plane has {floor.seen_m2:.2f} m2, {floor.height_m:.2f} m below"
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
        bend_share=depth.bend_share,
    )
    return level, floor


def _sample(rays: Array, z_m: Array, near: NDArray[np.bool_], rng: np.random.Generator) -> Array:
    rows, columns = np.nonzero(near)
    chosen = rng.choice(len(rows), min(_SAMPLES, len(rows)), replace=False)
    return np.asarray(rays[rows[chosen], columns[chosen]] * z_m[rows[chosen], columns[chosen], None])


def _candidates(
    rays: Array, z_m: Array, near: NDArray[np.bool_], rng: np.random.Generator
) -> list[tuple[Array, float]]:
    """Planes through three pixels near each other, as (normal, height) with the camera above them."""
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
    """The plane with the most points on it and the fewest below, None where there is none."""
    planes = list(zip(*_refined(candidates, points), strict=True)) if len(points) >= 500 else []
    return max(planes, key=lambda plane: _score(points, *plane)) if planes else None


def _refined(candidates: list[tuple[Array, float]], points: Array) -> tuple[list[Array], list[float]]:
    """The best candidates, each fitted to the points near it, ever nearer."""
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
        # What leans over when it is fitted better is a wall.
        if -normal[1] >= math.cos(_STEEPEST_RAD):
            normals.append(normal)
            heights.append(height)
    return normals, heights


def _fitted(points: Array, normal: Array, height: float, tolerance_m: float) -> tuple[Array, float]:
    """A plane fitted to the points near it: depth errs along rays, whose inverses are linear in them on a plane."""
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


def _described(points: Array, normal: Array, height: float) -> FloorSeen:
    off = points @ normal + height
    on = np.abs(off) < 0.015 + 2 * TYPICAL.sigma_m(points[:, 2])
    R = level_rotation(normal)
    cells = np.unique(np.round((points[on] @ R.T)[:, :2] / 0.1).astype(int), axis=0)
    tilt = math.degrees(math.asin(float(np.clip(-normal[2], -1.0, 1.0))))
    residual = float(np.median(np.abs(off[on]))) if on.any() else math.inf
    return FloorSeen(normal, float(height), 0.01 * len(cells), tilt, residual)


def level_rotation(up: Array) -> Array:
    """Returns (3, 3) camera to level: z up, x where the camera looks."""
    ahead = np.array([0.0, 0.0, 1.0]) - up[2] * up
    ahead /= np.linalg.norm(ahead)
    return np.stack([ahead, np.cross(up, ahead), up])


def _noise(points: Array, floor: FloorSeen) -> Noise:
    """What the floor's points say of the noise: the spread along their rays, by depth."""
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
    # A millimetre is what files round to.
    return Noise(max(float(base), 0.001), min(max(float(growth), 0.0), 0.01))
