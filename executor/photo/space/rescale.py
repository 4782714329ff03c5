"""Depths that a network guessed from one picture, put right by the floor: true scale, and straight where it is seen.

Such depths are right up to a factor and a shift, and bend slowly over the picture. Where the floor is, the camera's
height and the vertical say how far off it must be (as for metric depth from a ground plane: Xue et al. 2020).
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from executor.geometry import Array
from executor.photo.inputs.camera import Intrinsics
from executor.photo.inputs.depth import Depth
from executor.photo.inputs.picture import Photograph
from executor.photo.refusal import PhotoRefused
from executor.photo.space.floor import FloorSeen, observe
from executor.photo.space.level import UprightSeen, find_upright, heading_of_lines, levelled_by_height
from executor.photo.space.observation import Observation

_DOWN = 0.08  # Of a ray's length, which the floor's rays go down at least: nearer to the horizon nothing is known.
_FARTHEST_M = 8.0
_SAMPLES, _TRIALS = 6000, 500
_POINTS, _SHIFT_M = 20, 0.06  # How many straight points a bent floor is worth; how far depths are mostly shifted.
_APART_M = 0.4  # Between the two floor points of a trial.
_FACTORS, _MOST_SHIFT_M = (0.2, 5.0), 1.0
_ON, _BELOW, _BELOW_WEIGHT = 0.03, 0.08, 3.0  # Shares of the distance. Nothing is below a floor.
_STRAIGHT = 0.005  # Depths that are bent by less on the floor, noise apart, were measured: those have 0.002 at most.
_LEAST_SHARE = 0.03  # Of the pixels below the horizon, that are floor.
_SMOOTH_PX, _TRUST = (80.0, 40.0, 40.0, 20.0), 0.05
"""How slowly depths bend, first roughly; how much of what is around a pixel has to be known to tell it."""


def observe_by_height(
    picture: Photograph, depth: Depth, camera: Intrinsics, height_m: float
) -> tuple[Depth, Observation, FloorSeen]:
    """Returns depths put right, and the picture in the level frame, where somebody knows how high the camera was.

    Args:
        picture, camera: What is given.
        depth: Right up to a factor, a shift, and slow bends.
        height_m: Of the camera above the floor.

    Raises:
        PhotoRefused: Nothing tells what is level, or no floor is seen that would be so far below.
        MissingExtra: OpenCV is not installed.
    """
    upright = find_upright(picture, camera, _about(picture, depth, camera))
    depth = scaled_by_floor(depth, camera, upright, height_m)
    seen, floor = observe(picture, depth, camera, levelled_by_height(upright, height_m))
    return depth, replace(seen, heading_rad=heading_of_lines(picture, camera, seen.R_camera_level.T)), floor


def _about(picture: Photograph, depth: Depth, camera: Intrinsics) -> Array | None:
    """Which way is up by the depths' own floor, though it is bent; None where none is seen."""
    try:
        return observe(picture, depth, camera)[1].up
    except PhotoRefused:
        return None


def scaled_by_floor(depth: Depth, camera: Intrinsics, upright: UprightSeen, height_m: float, seed: int = 0) -> Depth:
    """Returns depths in which the floor is flat and as far below the camera as it is, with how they were bent.

    Args:
        depth: Right up to a factor, a shift, and slow bends.
        camera: The picture's.
        upright: Which way is up.
        height_m: Of the camera above the floor.
        seed: Of the random pairs of floor points that are tried.

    Raises:
        PhotoRefused: No floor is seen that would be so far below.
    """
    rows, columns = depth.z_m.shape
    down = -(camera.rays((columns, rows)) @ upright.up)
    floor_m = height_m / np.maximum(down, 1e-6)
    below = (down > _DOWN) & (floor_m < _FARTHEST_M) & (depth.z_m > 0.0)
    z, true = depth.z_m[below], floor_m[below]
    found = _line(z, true, np.random.default_rng(seed)) if len(z) > _SAMPLES // 10 else None
    on = np.zeros(0, dtype=bool) if found is None else _is_on(found, z, true)
    if found is None or on.sum() < _LEAST_SHARE * len(z):
        problem = f"no floor is seen in it that would be {height_m:.2f} m below the camera"
        raise PhotoRefused("scale", depth.source, problem, "is the camera's height right, and is enough floor seen?")
    factor, shift_m = found
    straight = np.maximum(factor * depth.z_m + shift_m, 0.0)
    floor = np.zeros(depth.z_m.shape, dtype=bool)
    floor[below] = on
    bent = _slowly(np.where(floor, floor_m / np.maximum(straight, 1e-6) - 1.0, 0.0), floor, _SMOOTH_PX[-1], 1e-6)
    bend_share = 1.4826 * float(np.median(np.abs(bent[floor])))
    z_m = straightened(straight, np.where(below, floor_m, np.inf), floor)
    told = f"{depth.source}, times {factor:.3f} and {shift_m:+.2f} m, and straightened, by the floor"
    return replace(
        depth,
        z_m=np.where(depth.z_m > 0.0, z_m, 0.0),
        source=told,
        bend_share=bend_share if bend_share > _STRAIGHT else 0.0,
    )


def straightened(z_m: Array, known_m: Array, is_known: NDArray[np.bool_] | None = None) -> Array:
    """Returns depths (H, W) that are right where something is known of them, and go over into what they were.

    Args:
        z_m: Slowly bent.
        known_m: What they are, infinite where nobody knows.
        is_known: Where to begin with, if not where they are nearly as they are known to be.
    """
    for round_px in _SMOOTH_PX:
        if is_known is None:
            is_known = np.isfinite(known_m) & (np.abs(z_m / known_m - 1.0) < _ON)
        bent = np.where(is_known, known_m / np.maximum(z_m, 1e-6) - 1.0, 0.0)
        z_m = z_m * (1.0 + _slowly(bent, is_known, round_px, _TRUST))
        is_known = None
    return z_m


def _slowly(bent: Array, is_known: NDArray[np.bool_], round_px: float, trust: float) -> Array:
    """(H, W) means of bends, 0 where nothing is known, over so many pixels around; the less the fewer are known."""
    return np.asarray(gaussian_filter(bent, round_px) / (gaussian_filter(is_known.astype(float), round_px) + trust))


def _line(z: Array, true: Array, rng: np.random.Generator) -> tuple[float, float] | None:
    """Factor and shift with which most pixels are on the floor and fewest below it."""
    some = rng.choice(len(z), min(_SAMPLES, len(z)), replace=False)
    z, true = z[some], true[some]
    best, most = None, 0.0
    for first, second in rng.integers(0, len(z), (_TRIALS, 2)):
        if abs(true[first] - true[second]) < _APART_M or abs(z[first] - z[second]) < 1e-6:
            continue
        factor = float((true[first] - true[second]) / (z[first] - z[second]))
        line = factor, float(true[first] - factor * z[first])
        if not _FACTORS[0] <= factor <= _FACTORS[1] or abs(line[1]) > _MOST_SHIFT_M:
            continue
        score = float(_is_on(line, z, true).sum() - _BELOW_WEIGHT * _is_below(line, z, true).sum())
        if score > most:
            best, most = line, score
    for _ in range(3 if best is not None else 0):
        on = _is_on(best, z, true)
        best = _likely_line(z[on], true[on])
    return best


def _likely_line(z: Array, true: Array) -> tuple[float, float]:
    """Factor and shift of floor points; a floor that is bent tells them no better than a few straight points would.

    Without that, what is nearer than all of the floor that is seen would be off by much.
    """
    # Errors of depth grow with the distance.
    sides = np.stack([z / true, 1.0 / true], axis=1) / _ON * math.sqrt(_POINTS / len(z))
    told = np.full(len(z), 1.0 / _ON) * math.sqrt(_POINTS / len(z))
    factor, shift_m = np.linalg.solve(sides.T @ sides + np.diag([0.0, _SHIFT_M**-2]), sides.T @ told)
    return float(factor), float(shift_m)


def _is_on(line: tuple[float, float] | None, z: Array, true: Array) -> NDArray[np.bool_]:
    factor, shift = line or (0.0, 0.0)
    return np.asarray(np.abs((factor * z + shift) / true - 1.0) < _ON)


def _is_below(line: tuple[float, float], z: Array, true: Array) -> NDArray[np.bool_]:
    return np.asarray((line[0] * z + line[1]) / true > 1.0 + _BELOW)
