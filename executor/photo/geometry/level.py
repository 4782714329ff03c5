"""Floor and metric scale of pictures without metric depth.

A measured length, a board or the camera's height gives the scale, also of depth that a network guesses.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, replace

import numpy as np

from executor.geometry import Array
from executor.photo.errors import PhotoRefused
from executor.photo.geometry.lines import VerticalDirection, heading_of_lines
from executor.photo.geometry.observation import (
    TYPICAL,
    FloorPlane,
    Observation,
    level_rotation,
    tilt_deg,
)
from executor.photo.geometry.planes import STEEPEST_RAD
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


def scale_by_height(depth: Depth, floor: FloorPlane, height_m: float) -> tuple[Depth, FloorPlane]:
    """Scale depth, and the floor that was found in it, so that the camera's height is correct.

    Args:
        depth: Correct up to a factor, as networks guess it.
        floor: The floor by its level planes. Below a top it is assumed, and that part is not scaled.
        height_m: Of the camera above the floor.

    Raises:
        PhotoRefused: The factor is absurd.
    """
    assumed_m = 0.0 if floor.above_top_m is None else floor.height_m - floor.above_top_m
    factor = (height_m - assumed_m) / (floor.height_m - assumed_m)
    above_top_m = None if floor.above_top_m is None else floor.above_top_m * factor
    scaled = replace(
        floor,
        height_m=height_m,
        visible_m2=floor.visible_m2 * factor**2,
        residual_m=floor.residual_m * factor,
        source=f"{floor.source}; the camera's height as given",
        spread_share=_HELD_SHARE,
        above_top_m=above_top_m,
    )
    return _scaled(depth, factor, _HELD_SHARE, "the camera's height"), scaled
