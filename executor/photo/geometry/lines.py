"""The vertical and the main level directions of a room, from the lines of its picture.

Edges of furniture, doors and room corners are vertical, so their lines in a picture meet in one point. That point is
straight above or below the camera (Caprile and Torre 1990). Level lines mostly go in two directions, square to it and
to each other.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from executor.geometry import Array
from executor.photo.errors import PhotoRefused
from executor.photo.geometry.observation import level_rotation
from executor.photo.inputs.picture import Intrinsics, Photograph
from executor.system.extras import require

_SIDE_PX = 640  # Longer side of the picture in which lines are detected.
_LEAST_LINE_SHARE = 0.04  # Of the picture's height, that a line has to be long.
_MOST_LINES = 90
_UPRIGHT_RAD = math.radians(35.0)  # Off the picture's own vertical: lines far from its middle lean.
_STEEPEST_RAD = math.radians(55.0)  # Largest pitch and roll of a camera.
_MEET_RAD = math.radians(1.2)  # Between a line and the point in which the others meet.
_LINE_RAD = 0.005  # Usual error of a line's direction.
_ON_RAD, _END_PX, _FLATTEST = tuple(map(math.radians, (2.0, 1.0, 0.5, 0.3, 0.2))), 0.12, 0.05
"""Decreasing tolerances of a line's direction; accuracy of its ends; a line along the view has hardly a direction in
the picture."""

_MOST_STRETCHED = 6.0  # Of a hue in CIELAB.

_ASKEW_RAD = math.radians(2.0)  # Error of an approximate vertical.
_LEAST_MEETING, _LEAST_LINES, _LEAST_ALIGNED_LENGTH = 5, 5, 0.45
"""Least level lines of a direction; least lines of a vertical, and their share of the length of all. In drawn rooms it
is 0.5 to 0.75; in real pictures with the wrong vertical up to 0.35, as with most right ones: those are refused."""

_MEETINGS, _TRIED = 40, 8  # Vanishing points that are rated, and candidates that are refined.
_DOWN_RAD = np.radians(np.arange(-10.0, 51.0, 2.0))  # Cameras are held about level.
_OFF_HORIZON_RAD = math.radians(4.0)  # Off the horizon: a line on it can go anywhere.
_LEAST_ALIGNED = 0.35  # Of the lines' lengths: where no two directions stand out, furniture is not known to have one.


@dataclass(frozen=True)
class VerticalDirection:
    """The vertical direction.

    Attributes:
        up: (3,) in the camera's frame.
        lines: Number of supporting lines.
        given: Whether people gave it.
    """

    up: Array
    lines: int
    given: bool = False

    @property
    def source(self) -> str:
        """Its origin, for people."""
        return "tilt as given" if self.given else f"{self.lines} lines"


@dataclass(frozen=True)
class _Lines:
    """The lines of a picture, the longest first.

    Attributes:
        normals: (N, 3) of their planes through the camera.
        middles: (N, 3) unit vectors to their middles.
        length: (N,) in pixels.
        may_be_upright: (N,) whether they lean no more than vertical ones do.
    """

    normals: Array
    middles: Array
    length: Array
    may_be_upright: NDArray[np.bool_]

    @classmethod
    def of(cls, picture: Photograph, camera: Intrinsics) -> _Lines:
        ends, length, camera = _line_ends(picture.rgb, camera)
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

    def aligned_px(self, directions: Array, spread_rad: float) -> float:
        """Return the total length of lines in some directions (N, 3), weighted by their angle."""
        off = np.abs(self.normals @ directions.T).min(axis=1)
        return float(self.length @ np.exp(-0.5 * (off / spread_rad) ** 2))

    def directions(self, up: Array) -> Array:
        """Return (1 or 3, 3) the vertical, and the two main level directions, if there are any."""
        R = level_rotation(up)
        heading_rad = self.heading_rad(R)
        quarters = [] if heading_rad is None else [heading_rad, heading_rad + math.pi / 2]
        return np.array([up, *(R.T @ [math.cos(turn), math.sin(turn), 0.0] for turn in quarters)])

    def heading_rad(self, R: Array) -> float | None:
        """Return one of two orthogonal main directions of level lines; None if none stands out."""
        normals = self.normals @ R.T
        # A level line is in its plane through the camera and in a level one.
        along = np.stack([normals[:, 1], -normals[:, 0]], axis=1)
        horizontal = np.linalg.norm(along, axis=1)
        good = (horizontal > math.sin(_OFF_HORIZON_RAD)) & (np.abs(normals[:, 2]) > math.sin(_MEET_RAD))
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


def find_upright(picture: Photograph, camera: Intrinsics) -> VerticalDirection:
    """Return the vertical by the picture's vertical and level lines.

    Candidates are the vanishing points of vertical lines, and verticals of a level camera. The one is chosen for which
    most lines are vertical or go in two orthogonal level directions.

    Args:
        picture: The picture.
        camera: Its camera.

    Raises:
        PhotoRefused: Too few lines go in such directions.
        MissingExtra: OpenCV is not installed.
    """
    lines = _Lines.of(picture, camera)
    squared = [_squared(lines, up) for up in _likely(lines)] if len(lines.length) else []
    rated = [(lines.aligned_px(directions, _LINE_RAD), found) for found, directions in squared]
    aligned_px, best = max(rated, key=lambda one: one[0], default=(0.0, None))
    if best is None or best.lines < _LEAST_LINES or aligned_px < _LEAST_ALIGNED_LENGTH * lines.length.sum():
        raise _unlevelled(picture, 0 if best is None else best.lines)
    return best


def _likely(lines: _Lines) -> list[Array]:
    """Return candidates (3,) of the vertical, the likeliest first."""
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
    return sorted([*apart, *held], key=lambda up: -lines.aligned_px(lines.directions(up), _MEET_RAD / 2))[:_TRIED]


def _apart(directions: Array, most: int) -> list[Array]:
    """Return the first of some directions (N, 3) that differ by more than the vanishing tolerance."""
    found: list[Array] = []
    while len(directions) and len(found) < most:
        found.append(directions[0])
        directions = directions[directions @ directions[0] < math.cos(_MEET_RAD)]
    return found


def _squared(lines: _Lines, up: Array) -> tuple[VerticalDirection, Array]:
    """Refine a vertical known within some degrees by all lines; return it with the directions (1 or 3, 3) of lines.

    Level lines mostly go in two directions. Vertical ones in the middle of a picture hardly tell how far a camera looks
    down; level ones do.
    """
    directions = lines.directions(up)
    turned = Rotation.identity()
    for most_rad in _ON_RAD:
        which, on = _nearest(lines, turned.apply(directions), most_rad)
        turned = _turned(lines, on, directions[which[on]], turned)
    found = turned.apply(directions)
    _, on = _nearest(lines, found, _MEET_RAD)
    return VerticalDirection(found[0], int(on.sum())), found


def _nearest(lines: _Lines, directions: Array, most_rad: float) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """Return (N,) the direction of each line, and whether it fits that one and no other."""
    off = np.abs(lines.normals @ directions.T)
    by_size = np.sort(off, axis=1)
    on = (by_size[:, 0] < math.sin(most_rad)) & (by_size[:, 1:] > math.sin(_OFF_HORIZON_RAD)).all(axis=1)
    return np.argmin(off, axis=1), on


def _turned(lines: _Lines, on: NDArray[np.bool_], directions: Array, first: Rotation) -> Rotation:
    """Return the rotation that best fits some lines (N,), M of them, to their directions (M, 3)."""
    normals, middles, half_px = lines.normals[on], lines.middles[on], lines.length[on] / 2

    def off(rotation: Array) -> Array:
        turned = Rotation.from_rotvec(rotation).apply(directions)
        # The angle in the picture between a line and where its direction has it.
        aside = np.linalg.norm(np.cross(middles, turned), axis=1)
        angle = (normals * turned).sum(axis=1) / np.maximum(aside, _FLATTEST)
        return np.concatenate([angle * half_px / _END_PX, rotation / _ASKEW_RAD])

    # Most lines are exact; some are of round or askew objects.
    return Rotation.from_rotvec(least_squares(off, first.as_rotvec(), loss="cauchy").x)


def heading_of_lines(picture: Photograph, camera: Intrinsics, R: Array) -> float | None:
    """Return one of two orthogonal main directions of level lines; None if none stands out."""
    return _Lines.of(picture, camera).heading_rad(R)


def _line_ends(rgb: NDArray[np.uint8], camera: Intrinsics) -> tuple[Array, Array, Intrinsics]:
    """Return (N, 2, 2) ends of the lines in a picture, (N,) their lengths, and the camera of their pixels.

    Lines are detected at one size of the picture, so that they do not depend on its resolution. Neighbouring surfaces
    of equal brightness may differ in hue: lines are detected in all channels of colour.
    """
    cv2 = require("cv2", "photo")
    height, width = rgb.shape[:2]
    by = _SIDE_PX / max(height, width)
    if by != 1.0:
        size = round(by * width), round(by * height)
        rgb = cv2.resize(rgb, size, interpolation=cv2.INTER_AREA if by < 1.0 else cv2.INTER_CUBIC)
        across, down = size[0] / width, size[1] / height
        camera = replace(camera, fx=camera.fx * across, fy=camera.fy * down, cx=camera.cx * across, cy=camera.cy * down)
    _, *hues = cv2.split(cv2.cvtColor(rgb.astype(np.float32) / np.float32(255.0), cv2.COLOR_RGB2LAB))
    grey = cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY)
    # Weak colours are not scaled to the full range: their quantization steps are no lines.
    scaled = ((hue - hue.min()) * min(_MOST_STRETCHED, 255.0 / max(float(np.ptp(hue)), 1.0)) for hue in hues)
    channels = [grey, *(one.astype(np.uint8) for one in scaled)]
    found = [cv2.createLineSegmentDetector().detect(channel)[0] for channel in channels]
    ends = np.concatenate([np.zeros((0, 2, 2)), *(np.reshape(one, (-1, 2, 2)) for one in found if one is not None)])
    ends += 0.5
    length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    good = length > _LEAST_LINE_SHARE * rgb.shape[0]
    return ends[good], length[good], camera


def _rays(ends: Array, camera: Intrinsics) -> Array:
    """(N, 2, 3) rays through the ends (N, 2, 2) of lines."""
    flat = (ends - [camera.cx, camera.cy]) / [camera.fx, camera.fy]
    return np.concatenate([flat, np.ones((len(ends), 2, 1))], axis=2)


def _unlevelled(picture: Photograph, lines: int) -> PhotoRefused:
    problem = f"{lines} lines of it are upright or go in two level directions, which does not tell what is level"
    hint = "give --tilt or depths"
    return PhotoRefused("floor", picture.source, problem, hint)
