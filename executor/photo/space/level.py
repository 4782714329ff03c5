"""The level frame of a picture without depth of its own: which way is up by its lines, and how high the camera is.

Edges of furniture, doors and corners of rooms are upright, so that their lines in a picture meet in one point, which is
straight above or below the camera (Caprile and Torre 1990); level ones mostly go in two directions, square to it and to
each other. A ChArUco board that lies on the floor tells both.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from executor.geometry import Array
from executor.machine.extras import require
from executor.photo.inputs.camera import Intrinsics
from executor.photo.inputs.picture import Photograph
from executor.photo.inputs.scale import CLICKED_PX, BoardSeen, KnownLength
from executor.photo.refusal import PhotoRefused
from executor.photo.space.floor import HEIGHTS_M, FloorSeen, level_rotation
from executor.photo.space.observation import TYPICAL, Observation

_LEAST_SHARE = 0.04  # Of the picture's height, that a line has to be long.
_MOST_LINES = 90
_UPRIGHT_RAD = math.radians(35.0)  # Off the picture's own upright, as lines far from its middle lean.
_STEEPEST_RAD = math.radians(55.0)  # That cameras look up or down, or are askew.
_MEET_RAD = math.radians(1.2)  # Between a line and the point in which the others meet.
_LINE_RAD = 0.005  # Off its direction, what a line mostly is.
_ON_RAD, _END_PX, _FLATTEST = tuple(map(math.radians, (2.0, 1.0, 0.5, 0.3, 0.2))), 0.12, 0.05
"""Off its direction, what a line may be, ever less; how exact its ends are; a line that goes away from the camera has
hardly a direction in the picture."""

_MOST_STRETCHED = 6.0  # Of a hue in CIELAB.

_ASKEW_RAD = math.radians(2.0)  # What is about known of which way is up is off by this much.
_LEAST_MEETING, _LEAST_LINES, _LEAST_TOLD = 5, 5, 0.25
"""Level lines that have a direction; lines that tell what is up, and their part of the length of all."""

_MEETINGS, _TRIED = 40, 8  # Directions in which lines meet that are looked at, and how many are followed.
_DOWN_RAD = np.radians(np.arange(-10.0, 51.0, 2.0))  # Whoever takes a picture holds his camera about level.
_TOLD_RAD = math.radians(4.0)  # Off the horizon: a line on it can go anywhere.
_LEAST_ALIGNED = 0.35  # Of the lines' lengths: where no two directions stand out, furniture is not known to have one.
_HELD_SHARE = 0.02  # How exactly people know how high they hold a camera.


@dataclass(frozen=True)
class UprightSeen:
    """Which way is up.

    Attributes:
        up: (3,) in the camera's frame.
        lines: How many lines say so.
    """

    up: Array
    lines: int


@dataclass(frozen=True)
class _Lines:
    """The lines of a picture, the longest first.

    Attributes:
        normals: (N, 3) of their planes through the camera.
        middles: (N, 3) unit vectors to their middles.
        length: (N,) in pixels.
        may_be_upright: (N,) whether they lean no more than upright ones do.
    """

    normals: Array
    middles: Array
    length: Array
    may_be_upright: NDArray[np.bool_]

    @classmethod
    def of(cls, picture: Photograph, camera: Intrinsics) -> _Lines:
        ends, length = _line_ends(picture)
        order = np.argsort(-length, kind="stable")
        ends, length = ends[order], length[order]
        along = ends[:, 1] - ends[:, 0]
        leans = np.abs(np.arctan2(along[:, 0], along[:, 1]))
        rays = _rays(ends, camera)
        normals, middles = np.cross(rays[:, 0], rays[:, 1]), rays.sum(axis=1)
        return cls(
            normals / np.linalg.norm(normals, axis=1, keepdims=True),
            middles / np.linalg.norm(middles, axis=1, keepdims=True),
            length,
            np.minimum(leans, math.pi - leans) < _UPRIGHT_RAD,
        )

    def aligned_px(self, ways: Array, spread_rad: float) -> float:
        """Returns how long all are together that go in one of some directions (N, 3), but for about some angle."""
        off = np.abs(self.normals @ ways.T).min(axis=1)
        return float(self.length @ np.exp(-0.5 * (off / spread_rad) ** 2))

    def ways(self, up: Array) -> Array:
        """Returns (1 or 3, 3) what is up, and the two level directions in which most lines go, if they do."""
        R = level_rotation(up)
        heading_rad = self.heading_rad(R)
        quarters = [] if heading_rad is None else [heading_rad, heading_rad + math.pi / 2]
        return np.array([up, *(R.T @ [math.cos(turn), math.sin(turn), 0.0] for turn in quarters)])

    def heading_rad(self, R: Array) -> float | None:
        """One of two directions, square to each other, in which most level lines go; None where none stands out."""
        normals = self.normals @ R.T
        # A level line is in its plane through the camera and in a level one.
        along = np.stack([normals[:, 1], -normals[:, 0]], axis=1)
        told = np.linalg.norm(along, axis=1)
        good = (told > math.sin(_TOLD_RAD)) & (np.abs(normals[:, 2]) > math.sin(_MEET_RAD))
        if int(good.sum()) < _LEAST_MEETING:
            return None
        turns = np.arctan2(along[good, 1], along[good, 0]) % (math.pi / 2)
        weight = self.length[good]
        tried = np.arange(0.0, math.pi / 2, _MEET_RAD / 2)
        off = np.abs((turns[None, :] - tried[:, None] + math.pi / 4) % (math.pi / 2) - math.pi / 4)
        with_it = (off < 2 * _MEET_RAD) @ weight
        best = int(np.argmax(with_it))
        if with_it[best] < _LEAST_ALIGNED * weight.sum():
            return None
        on = off[best] < 2 * _MEET_RAD
        return float(np.angle(np.sum(weight[on] * np.exp(4j * turns[on]))) / 4)


def find_upright(picture: Photograph, camera: Intrinsics, about: Array | None = None) -> UprightSeen:
    """Returns which way is up, by the picture's upright lines and its level ones.

    Of the directions in which upright lines meet, and those of a camera that is held level, it is that by which most
    lines go upright or in two level directions, square to each other.

    Args:
        picture: The picture.
        camera: Its camera.
        about: (3,) which way is up within some degrees, where depths tell it.

    Raises:
        PhotoRefused: Nothing else tells it, and too few lines go in such directions.
        MissingExtra: OpenCV is not installed.
    """
    lines = _Lines.of(picture, camera)
    if about is not None:
        return _squared(lines, about)[0]
    squared = [_squared(lines, up) for up in _likely(lines)] if len(lines.length) else []
    rated = [(lines.aligned_px(ways, _LINE_RAD), found) for found, ways in squared]
    aligned_px, best = max(rated, key=lambda one: one[0], default=(0.0, None))
    if best is None or best.lines < _LEAST_LINES or aligned_px < _LEAST_TOLD * lines.length.sum():
        raise _unlevelled(picture, 0 if best is None else best.lines)
    return best


def _likely(lines: _Lines) -> list[Array]:
    """Directions (3,) that may be up, the likeliest first."""
    normals, length = (one[lines.may_be_upright][:_MOST_LINES] for one in (lines.normals, lines.length))
    first, second = np.triu_indices(len(normals), 1)
    meetings = np.cross(normals[first], normals[second])
    size = np.linalg.norm(meetings, axis=1)
    meetings = meetings[size > 1e-3] / size[size > 1e-3, None]
    meetings = np.where(meetings[:, 1:2] > 0.0, -meetings, meetings)
    meetings = meetings[-meetings[:, 1] > math.cos(_STEEPEST_RAD)]
    near = np.abs(meetings @ normals.T) < math.sin(_MEET_RAD)
    by_meeting = meetings[np.argsort(-(near @ length), kind="stable")]
    held = [np.array([0.0, -math.cos(down), -math.sin(down)]) for down in _DOWN_RAD]
    apart = _apart(by_meeting, _MEETINGS)
    return sorted([*apart, *held], key=lambda up: -lines.aligned_px(lines.ways(up), _MEET_RAD / 2))[:_TRIED]


def _apart(ways: Array, most: int) -> list[Array]:
    """The first of some directions (N, 3) that are no nearer to each other than lines that meet."""
    found: list[Array] = []
    while len(ways) and len(found) < most:
        found.append(ways[0])
        ways = ways[ways @ ways[0] < math.cos(_MEET_RAD)]
    return found


def _squared(lines: _Lines, up: Array) -> tuple[UprightSeen, Array]:
    """Which way is up, of which some degrees are known, by all lines, and the directions (1 or 3, 3) that they go in.

    Level lines mostly go in two directions. Upright ones in the middle of a picture hardly tell how far a camera looks
    down; level ones do.
    """
    ways = lines.ways(up)
    if not len(lines.length):
        return UprightSeen(up, 0), ways
    turned = Rotation.identity()
    for most_rad in _ON_RAD:
        which, on = _nearest(lines, turned.apply(ways), most_rad)
        turned = _turned(lines, on, ways[which[on]], turned)
    found = turned.apply(ways)
    _, on = _nearest(lines, found, _MEET_RAD)
    return UprightSeen(found[0], int(on.sum())), found


def _nearest(lines: _Lines, ways: Array, most_rad: float) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """(N,) which of some directions each line goes in, and whether it does, and in no other."""
    off = np.abs(lines.normals @ ways.T)
    by_size = np.sort(off, axis=1)
    on = (by_size[:, 0] < math.sin(most_rad)) & (by_size[:, 1:] > math.sin(_TOLD_RAD)).all(axis=1)
    return np.argmin(off, axis=1), on


def _turned(lines: _Lines, on: NDArray[np.bool_], ways: Array, first: Rotation) -> Rotation:
    """The rotation by which some lines (N,), M of them, go best in their directions (M, 3)."""
    normals, middles, half_px = lines.normals[on], lines.middles[on], lines.length[on] / 2

    def off(rotation: Array) -> Array:
        turned = Rotation.from_rotvec(rotation).apply(ways)
        # The angle in the picture between a line and where its direction has it.
        aside = np.linalg.norm(np.cross(middles, turned), axis=1)
        angle = (normals * turned).sum(axis=1) / np.maximum(aside, _FLATTEST)
        return np.concatenate([angle * half_px / _END_PX, rotation / _ASKEW_RAD])

    # Most lines are exact, and some are of what is round or stands askew.
    return Rotation.from_rotvec(least_squares(off, first.as_rotvec(), loss="cauchy").x)


def levelled_by_height(upright: UprightSeen, height_m: float) -> FloorSeen:
    """Returns the floor under a camera of which somebody knows how high it was.

    Raises:
        PhotoRefused: Nobody holds a camera so high or low.
    """
    return _floor(upright.up, height_m, _HELD_SHARE, f"{upright.lines} lines; the camera's height as given")


def levelled_by_length(upright: UprightSeen, camera: Intrinsics, known: KnownLength) -> FloorSeen:
    """Returns the floor on which two points are as far apart as somebody has measured.

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
    return _floor(upright.up, height_m, spread, f"{upright.lines} lines; a known length on the floor")


def levelled_by_board(board: BoardSeen) -> FloorSeen:
    """Returns the floor on which a board lies.

    Raises:
        PhotoRefused: The board stands, or the camera would be absurdly high or low above it.
    """
    if -board.normal[1] < math.cos(_STEEPEST_RAD):
        raise PhotoRefused("scale", "--board", "does not lie on the floor", "without depth it has to")
    heights = -(board.corners_m @ board.normal)
    height_m = float(np.mean(heights))
    spread = float(np.std(heights)) / max(height_m, 1e-6)
    return _floor(board.normal, height_m, max(spread, 0.005), "a ChArUco board that lies on the floor")


def flat_observation(picture: Photograph, camera: Intrinsics, floor: FloorSeen) -> Observation:
    """Returns a picture without depth in the level frame."""
    R = level_rotation(floor.up)
    eye_m = np.array([0.0, 0.0, floor.height_m])
    nothing = np.zeros(picture.rgb.shape[:2])
    rays, heading_rad = camera.rays(picture.size_px) @ R.T, heading_of_lines(picture, camera, R)
    return Observation(picture.rgb, nothing, rays, eye_m, R.T, TYPICAL, camera, heading_rad)


def _floor(up: Array, height_m: float, spread_share: float, source: str) -> FloorSeen:
    if not HEIGHTS_M[0] <= height_m <= HEIGHTS_M[1]:
        problem = f"the camera would be {height_m:.2f} m above the floor"
        raise PhotoRefused("scale", source, problem, f"expected {HEIGHTS_M[0]:g} to {HEIGHTS_M[1]:g} m")
    tilt = math.degrees(math.asin(float(np.clip(-up[2], -1.0, 1.0))))
    return FloorSeen(up, height_m, 0.0, tilt, 0.0, source, spread_share)


def heading_of_lines(picture: Photograph, camera: Intrinsics, R: Array) -> float | None:
    """One of two directions, square to each other, in which most level lines go; None where none stands out."""
    return _Lines.of(picture, camera).heading_rad(R)


def _line_ends(picture: Photograph) -> tuple[Array, Array]:
    """(N, 2, 2) ends of the lines in a picture, and (N,) how long they are; in pixels.

    What is as bright as what is beside it may be of another hue: lines are looked for in all that tells colours apart.
    """
    cv2 = require("cv2", "photo")
    _, *hues = cv2.split(cv2.cvtColor(picture.rgb.astype(np.float32) / np.float32(255.0), cv2.COLOR_RGB2LAB))
    grey = cv2.cvtColor(picture.rgb, cv2.COLOR_RGB2GRAY)
    # What is hardly coloured is not stretched to the full range: steps of its colours are no lines.
    scaled = ((hue - hue.min()) * min(_MOST_STRETCHED, 255.0 / max(float(np.ptp(hue)), 1.0)) for hue in hues)
    channels = [grey, *(one.astype(np.uint8) for one in scaled)]
    found = [cv2.createLineSegmentDetector().detect(channel)[0] for channel in channels]
    ends = np.concatenate([np.zeros((0, 2, 2)), *(np.reshape(one, (-1, 2, 2)) for one in found if one is not None)])
    ends += 0.5
    length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    good = length > _LEAST_SHARE * picture.size_px[1]
    return ends[good], length[good]


def _rays(ends: Array, camera: Intrinsics) -> Array:
    """(N, 2, 3) rays through the ends (N, 2, 2) of lines."""
    flat = (ends - [camera.cx, camera.cy]) / [camera.fx, camera.fy]
    return np.concatenate([flat, np.ones((len(ends), 2, 1))], axis=2)


def _unlevelled(picture: Photograph, lines: int) -> PhotoRefused:
    problem = f"{lines} lines of it are upright or go in two level directions, which does not tell what is level"
    return PhotoRefused("floor", picture.source, problem, "give depths, or lay a ChArUco board on the floor (--board)")
