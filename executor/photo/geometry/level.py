"""Floor and metric scale of pictures without metric depth.

A measured length, a board or the camera's height gives the scale. Depth that a network guesses is correct up to a
factor and a shift, and is distorted slowly over the picture. On the floor the camera's height and the vertical give the
true depth (metric depth from a ground plane: Xue et al. 2020).
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from executor.geometry import Array
from executor.photo.errors import PhotoRefused
from executor.photo.geometry.lines import VerticalDirection, find_upright, heading_of_lines
from executor.photo.geometry.observation import (
    TYPICAL,
    FloorPlane,
    Observation,
    level_rotation,
    levelled,
    tilt_deg,
)
from executor.photo.geometry.planes import STEEPEST_RAD, level_planes
from executor.photo.inputs.depth import Depth
from executor.photo.inputs.picture import HEIGHTS_M, Intrinsics, Photograph
from executor.system.extras import require

CLICKED_PX = 1.5
"""Accuracy of a pixel chosen by hand."""

_LENGTH = re.compile(r"([0-9.]+),([0-9.]+),([0-9.]+),([0-9.]+)=([0-9.]+)")
_BOARD = re.compile(r"(\d+)x(\d+),([0-9.]+),([0-9.]+)(?:,(\w+))?")
_LENGTH_FORM = "expected X0,Y0,X1,Y1=METRES: two pixels and how far apart they are in the room"
_BOARD_FORM = "expected COLUMNSxROWS,SQUARE_M,MARKER_M[,DICTIONARY], such as 7x5,0.04,0.03,4X4_50"
_USUAL_MARKERS = "4X4_50"
_LEAST_CORNERS = 6
_AROUND_PX = 2  # Depths are the middle one of a small window's.
_FACTORS = (0.2, 5.0)


@dataclass(frozen=True)
class KnownLength:
    """Two pixels whose distance in the room is known."""

    from_px: tuple[float, float]
    to_px: tuple[float, float]
    length_m: float


@dataclass(frozen=True)
class BoardPose:
    """A ChArUco board in the camera's frame.

    Attributes:
        corners_px: (N, 2) inner corners of its squares.
        corners_m: (N, 3) the same in the camera's frame, from the board's true size.
        normal: (3,) of its plane, towards the camera.
    """

    corners_px: Array
    corners_m: Array
    normal: Array


def read_length(text: str) -> KnownLength:
    """Parse `--length`.

    Raises:
        PhotoRefused: It is no length.
    """
    found = _LENGTH.fullmatch(text.replace(" ", ""))
    numbers = [_number(part) for part in found.groups()] if found else []
    if not numbers or not all(math.isfinite(value) for value in numbers) or not 0.01 <= numbers[4] <= 20.0:
        raise PhotoRefused(
            "scale", f"--length {text}", "is no length from 0.01 to 20 m between two pixels", _LENGTH_FORM
        )
    return KnownLength((numbers[0], numbers[1]), (numbers[2], numbers[3]), numbers[4])


def scale_by_length(depth: Depth, camera: Intrinsics, known: KnownLength) -> Depth:
    """Scale depth so that a known length is correct.

    Raises:
        PhotoRefused: An end is outside the picture, nothing is measured there, or the factor is absurd.
    """
    ends = [_point(depth, camera, end) for end in (known.from_px, known.to_px)]
    measured_m = float(np.linalg.norm(ends[1] - ends[0]))
    away_m = float(max(ends[0][2], ends[1][2]))
    spread = math.sqrt(2.0) * CLICKED_PX * away_m / camera.fx / max(measured_m, 1e-6)
    return _scaled(depth, known.length_m / max(measured_m, 1e-6), spread, "the known length")


def scale_by_board(depth: Depth, board: BoardPose) -> Depth:
    """Scale depth so that a board's distance agrees with its true size.

    Raises:
        PhotoRefused: Nothing is measured on it, or the factor is absurd.
    """
    height, width = depth.z_m.shape
    columns = np.clip(board.corners_px[:, 0].astype(int), 0, width - 1)
    rows = np.clip(board.corners_px[:, 1].astype(int), 0, height - 1)
    measured_m = depth.z_m[rows, columns]
    on = measured_m > 0.0
    if int(on.sum()) < _LEAST_CORNERS:
        raise PhotoRefused("scale", "--board", f"of its {len(on)} corners only {int(on.sum())} have a depth")
    ratios = board.corners_m[on, 2] / measured_m[on]
    factor = float(np.median(ratios))
    spread = 1.4826 * float(np.median(np.abs(ratios - factor))) / math.sqrt(len(ratios)) / factor
    return _scaled(depth, factor, spread, "the ChArUco board")


def find_board(text: str, picture: Photograph, camera: Intrinsics) -> BoardPose:
    """Find the ChArUco board of `--board` in a picture.

    Args:
        text: Columns and rows of squares, sides of squares and of markers in metres, and OpenCV's name of the markers.
        picture, camera: The picture and its intrinsics.

    Raises:
        PhotoRefused: The text is no board, or the picture shows none.
        MissingExtra: OpenCV is not installed.
    """
    cv2 = require("cv2", "photo")
    found = _BOARD.fullmatch(text.replace(" ", ""))
    markers = f"DICT_{(found[5] if found else None) or _USUAL_MARKERS}".upper()
    square_m, marker_m = (_number(found[3]), _number(found[4])) if found else (math.nan, math.nan)
    if found is None or not 0.0 < marker_m < square_m < 1.0 or not hasattr(cv2.aruco, markers):
        raise PhotoRefused("scale", f"--board {text}", "is no board", _BOARD_FORM)
    dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, markers))
    board = cv2.aruco.CharucoBoard((int(found[1]), int(found[2])), square_m, marker_m, dictionary)
    corners, ids, *_ = cv2.aruco.CharucoDetector(board).detectBoard(cv2.cvtColor(picture.rgb, cv2.COLOR_RGB2GRAY))
    count = 0 if ids is None else len(ids)
    if count < _LEAST_CORNERS:
        hint = "it has to be flat, sharp, and of the columns, rows and markers that were given"
        raise PhotoRefused("scale", f"--board {text}", f"{count} of its corners are seen in the picture", hint)
    on_board, in_picture = board.matchImagePoints(corners, ids)
    # OpenCV's first pixel has its centre at zero.
    K = np.array([[camera.fx, 0.0, camera.cx - 0.5], [0.0, camera.fy, camera.cy - 0.5], [0.0, 0.0, 1.0]])
    done, turn, shift = cv2.solvePnP(on_board, in_picture, K, None)
    if not done:
        raise PhotoRefused("scale", f"--board {text}", "its corners are seen where no flat board has them")
    R = np.asarray(cv2.Rodrigues(turn)[0])
    points = np.asarray(on_board).reshape(-1, 3) @ R.T + np.asarray(shift).reshape(3)
    normal = R[:, 2] if float(R[:, 2] @ points.mean(axis=0)) < 0.0 else -R[:, 2]
    return BoardPose(np.asarray(in_picture).reshape(-1, 2) + 0.5, points, normal)


def _point(depth: Depth, camera: Intrinsics, at_px: tuple[float, float]) -> Array:
    height, width = depth.z_m.shape
    column, row = int(at_px[0]), int(at_px[1])
    if not (0 <= column < width and 0 <= row < height):
        shown = f"{at_px[0]:g},{at_px[1]:g}"
        raise PhotoRefused("scale", "--length", f"{shown} is outside the picture of {width} x {height}", _LENGTH_FORM)
    rows = slice(max(0, row - _AROUND_PX), row + _AROUND_PX + 1)
    window = depth.z_m[rows, max(0, column - _AROUND_PX) : column + _AROUND_PX + 1]
    if not (window > 0.0).any():
        raise PhotoRefused("scale", "--length", f"nothing was measured at {at_px[0]:g},{at_px[1]:g}")
    z = float(np.median(window[window > 0.0]))
    return z * np.array([(at_px[0] - camera.cx) / camera.fx, (at_px[1] - camera.cy) / camera.fy, 1.0])


def _scaled(depth: Depth, factor: float, spread: float, by: str) -> Depth:
    if not _FACTORS[0] <= factor <= _FACTORS[1]:
        hint = "is it the right length, and are the depths in the right unit (--depth-unit-m)?"
        raise PhotoRefused("scale", depth.source, f"{by} would make it {factor:.3g} times as deep", hint)
    description = f"{depth.source}, times {factor:.4f} (+- {100 * spread:.1f} %) by {by}"
    return replace(depth, z_m=depth.z_m * factor, source=description)


def _number(text: str) -> float:
    return float(text) if text.count(".") < 2 and text != "." else math.nan


_HELD_SHARE = 0.02  # How exactly people know how high they hold a camera.


def level_by_height(upright: VerticalDirection, height_m: float) -> FloorPlane:
    """Return the floor below a camera of known height.

    Raises:
        PhotoRefused: The height is absurd.
    """
    return _floor(upright.up, height_m, _HELD_SHARE, f"{upright.source}; the camera's height as given")


def level_by_length(upright: VerticalDirection, camera: Intrinsics, known: KnownLength) -> FloorPlane:
    """Return the floor on which two points have a known distance.

    Raises:
        PhotoRefused: A point is not on the floor, or the camera would be absurdly high or low.
    """
    ends = []
    for u, v in (known.from_px, known.to_px):
        ray = np.array([(u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, 1.0])
        down = -float(ray @ upright.up)
        if down < 1e-3:
            raise PhotoRefused("scale", "--length", f"{u:g},{v:g} is above the horizon, and not on the floor")
        ends.append(ray / down)
    apart = float(np.linalg.norm(ends[1] - ends[0]))
    height_m = known.length_m / max(apart, 1e-9)
    away = max(float(end[2]) for end in ends)
    spread = math.sqrt(2.0) * CLICKED_PX * away / camera.fx / max(apart, 1e-9)
    return _floor(upright.up, height_m, spread, f"{upright.source}; a known length on the floor")


def level_by_board(board: BoardPose) -> FloorPlane:
    """Return the floor on which a board lies.

    Raises:
        PhotoRefused: The board stands, or the camera would be absurdly high or low above it.
    """
    if -board.normal[1] < math.cos(STEEPEST_RAD):
        raise PhotoRefused("scale", "--board", "does not lie on the floor", "without depth it has to")
    heights = -(board.corners_m @ board.normal)
    height_m = float(np.mean(heights))
    spread = float(np.std(heights)) / max(height_m, 1e-6)
    return _floor(board.normal, height_m, max(spread, 0.005), "a ChArUco board that lies on the floor")


def flat_observation(picture: Photograph, camera: Intrinsics, floor: FloorPlane) -> Observation:
    """Return a picture without depth in the level frame."""
    R = level_rotation(floor.up)
    eye_m = np.array([0.0, 0.0, floor.height_m])
    nothing = np.zeros(picture.rgb.shape[:2])
    rays, heading_rad = camera.rays(picture.size_px) @ R.T, heading_of_lines(picture, camera, R)
    return Observation(picture.rgb, nothing, rays, eye_m, R.T, TYPICAL, camera, heading_rad)


def _floor(up: Array, height_m: float, spread_share: float, source: str) -> FloorPlane:
    if not HEIGHTS_M[0] <= height_m <= HEIGHTS_M[1]:
        problem = f"the camera would be {height_m:.2f} m above the floor"
        raise PhotoRefused("scale", source, problem, f"expected {HEIGHTS_M[0]:g} to {HEIGHTS_M[1]:g} m")
    return FloorPlane(up, height_m, 0.0, tilt_deg(up), 0.0, source, spread_share)


_DOWN = 0.08  # Of a ray's length, which the floor's rays go down at least: nearer to the horizon nothing is known.
_FARTHEST_M = 8.0
_SAMPLES, _TRIALS = 6000, 500
_POINTS, _SHIFT_M = 20, 0.06  # Straight points that a distorted floor is worth; usual shift of depth.
_APART_M = 0.4  # Between the two floor points of a trial.
_FLOOR_FACTORS, _MOST_SHIFT_M = (0.2, 5.0), 1.0
_ON, _BELOW, _BELOW_WEIGHT = 0.03, 0.08, 3.0  # Shares of the distance. Nothing is below a floor.
_STRAIGHT = 0.005  # Depth with less distortion on the floor, without noise, was measured: that has 0.002 at most.
_LEAST_FLOOR_SHARE = 0.03  # Of the pixels below the horizon, that are floor.
_SMOOTH_PX, _TRUST = (80.0, 40.0, 40.0, 20.0), 0.05
"""Widths of the smoothing of distortion, decreasing; weight of unknown pixels in it."""


def observe_by_height(
    picture: Photograph, depth: Depth, camera: Intrinsics, height_m: float, up: Array | None = None
) -> tuple[Depth, Observation, FloorPlane]:
    """Return corrected depth, and the picture in the level frame, for a known camera height.

    Args:
        picture, camera: The input.
        depth: Correct up to a factor, a shift, and slow distortion.
        height_m: Of the camera above the floor.
        up: (3,) the vertical, if it is given.

    Raises:
        PhotoRefused: Nothing gives the vertical, or no floor is visible at that distance.
        MissingExtra: OpenCV is not installed.
    """
    upright = VerticalDirection(up, 0, given=True) if up is not None else _find_upright_about(picture, depth, camera)
    depth = scale_by_floor(depth, camera, upright, height_m)
    floor = level_by_height(upright, height_m)
    observation = levelled(picture, depth, camera, floor)
    heading_rad = heading_of_lines(picture, camera, observation.R_camera_level.T)
    return depth, replace(observation, heading_rad=heading_rad), floor


def _find_upright_about(picture: Photograph, depth: Depth, camera: Intrinsics) -> VerticalDirection:
    """Return the vertical by lines, near that of the depth, which is distorted."""
    planes = level_planes(depth, camera)
    return find_upright(picture, camera, None if planes is None else planes.up)


def scale_by_floor(
    depth: Depth, camera: Intrinsics, upright: VerticalDirection, height_m: float, seed: int = 0
) -> Depth:
    """Return depth in which the floor is flat and at its true distance, with its distortion.

    Args:
        depth: Correct up to a factor, a shift, and slow distortion.
        camera: The picture's.
        upright: The vertical.
        height_m: Of the camera above the floor.
        seed: Of the random pairs of floor points that are tried.

    Raises:
        PhotoRefused: No floor is visible at that distance.
    """
    rows, columns = depth.z_m.shape
    down = -(camera.rays((columns, rows)) @ upright.up)
    floor_m = height_m / np.maximum(down, 1e-6)
    below = (down > _DOWN) & (floor_m < _FARTHEST_M) & (depth.z_m > 0.0)
    z, true = depth.z_m[below], floor_m[below]
    found = _line(z, true, np.random.default_rng(seed)) if len(z) > _SAMPLES // 10 else None
    on = np.zeros(0, dtype=bool) if found is None else _is_on(found, z, true)
    if found is None or on.sum() < _LEAST_FLOOR_SHARE * len(z):
        problem = f"no floor is seen in it that would be {height_m:.2f} m below the camera"
        raise PhotoRefused("scale", depth.source, problem, "is the camera's height right, and is enough floor seen?")
    factor, shift_m = found
    straight = np.maximum(factor * depth.z_m + shift_m, 0.0)
    floor = np.zeros(depth.z_m.shape, dtype=bool)
    floor[below] = on
    bent = _slowly(np.where(floor, floor_m / np.maximum(straight, 1e-6) - 1.0, 0.0), floor, _SMOOTH_PX[-1], 1e-6)
    depth_distortion = 1.4826 * float(np.median(np.abs(bent[floor])))
    z_m = correct_depth(straight, np.where(below, floor_m, np.inf), floor)
    description = f"{depth.source}, times {factor:.3f} and {shift_m:+.2f} m, and straightened, by the floor"
    return replace(
        depth,
        z_m=np.where(depth.z_m > 0.0, z_m, 0.0),
        source=description,
        depth_distortion=depth_distortion if depth_distortion > _STRAIGHT else 0.0,
    )


def correct_depth(z_m: Array, known_m: Array, is_known: NDArray[np.bool_] | None = None) -> Array:
    """Correct depth (H, W) where it is known, blending into the uncorrected depth elsewhere.

    Args:
        z_m: Slowly distorted.
        known_m: True depth, infinite if unknown.
        is_known: Pixels to begin with; by default those near their known depth.
    """
    for round_px in _SMOOTH_PX:
        if is_known is None:
            is_known = np.isfinite(known_m) & (np.abs(z_m / known_m - 1.0) < _ON)
        bent = np.where(is_known, known_m / np.maximum(z_m, 1e-6) - 1.0, 0.0)
        z_m = z_m * (1.0 + _slowly(bent, is_known, round_px, _TRUST))
        is_known = None
    return z_m


def _slowly(bent: Array, is_known: NDArray[np.bool_], round_px: float, trust: float) -> Array:
    """Return (H, W) smoothed distortion, 0 where nothing is known; shrunk where little is known."""
    return np.asarray(gaussian_filter(bent, round_px) / (gaussian_filter(is_known.astype(float), round_px) + trust))


def _line(z: Array, true: Array, rng: np.random.Generator) -> tuple[float, float] | None:
    """Return factor and shift with most pixels on the floor and fewest below it."""
    some = rng.choice(len(z), min(_SAMPLES, len(z)), replace=False)
    z, true = z[some], true[some]
    best, most = None, 0.0
    for first, second in rng.integers(0, len(z), (_TRIALS, 2)):
        if abs(true[first] - true[second]) < _APART_M or abs(z[first] - z[second]) < 1e-6:
            continue
        factor = float((true[first] - true[second]) / (z[first] - z[second]))
        line = factor, float(true[first] - factor * z[first])
        if not _FLOOR_FACTORS[0] <= factor <= _FLOOR_FACTORS[1] or abs(line[1]) > _MOST_SHIFT_M:
            continue
        score = float(_is_on(line, z, true).sum() - _BELOW_WEIGHT * _is_below(line, z, true).sum())
        if score > most:
            best, most = line, score
    for _ in range(3 if best is not None else 0):
        on = _is_on(best, z, true)
        best = _likely_line(z[on], true[on])
    return best


def _likely_line(z: Array, true: Array) -> tuple[float, float]:
    """Return factor and shift of floor points; a distorted floor weighs no more than a few straight points.

    Without that, everything nearer than the visible floor would be far off.
    """
    # Errors of depth grow with the distance.
    sides = np.stack([z / true, 1.0 / true], axis=1) / _ON * math.sqrt(_POINTS / len(z))
    targets = np.full(len(z), 1.0 / _ON) * math.sqrt(_POINTS / len(z))
    factor, shift_m = np.linalg.solve(sides.T @ sides + np.diag([0.0, _SHIFT_M**-2]), sides.T @ targets)
    return float(factor), float(shift_m)


def _is_on(line: tuple[float, float] | None, z: Array, true: Array) -> NDArray[np.bool_]:
    factor, shift = line or (0.0, 0.0)
    return np.asarray(np.abs((factor * z + shift) / true - 1.0) < _ON)


def _is_below(line: tuple[float, float], z: Array, true: Array) -> NDArray[np.bool_]:
    return np.asarray((line[0] * z + line[1]) / true > 1.0 + _BELOW)
