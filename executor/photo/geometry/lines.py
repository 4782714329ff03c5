"""The main level directions of a room, from the lines of its picture, where the vertical is known.

Level lines mostly go in two directions, square to each other.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from executor.geometry import Array
from executor.photo.inputs.picture import Intrinsics, Photograph
from executor.system.extras import require

_SIDE_PX = 640  # Longer side of the picture in which lines are detected.
_LEAST_LINE_SHARE = 0.04  # Of the picture's height, that a line has to be long.
_MEET_RAD = math.radians(1.2)  # Between lines of one direction.
_MOST_STRETCHED = 6.0  # Of a hue in CIELAB.
_LEAST_MEETING = 5  # Level lines of a direction.
_OFF_HORIZON_RAD = math.radians(4.0)  # Off the horizon: a line on it can go anywhere.
_LEAST_ALIGNED = 0.35  # Of the lines' lengths: where no two directions stand out, furniture is not known to have one.


def heading_of_lines(picture: Photograph, camera: Intrinsics, R: Array) -> float | None:
    """Return one of two orthogonal main directions of level lines; None if none stands out.

    Args:
        picture: The picture.
        camera: Its camera.
        R: (3, 3) camera to level.

    Raises:
        MissingExtra: OpenCV is not installed.
    """
    ends, length, camera = _line_ends(picture.rgb, camera)
    rays = _rays(ends, camera)
    normals = np.cross(rays[:, 0], rays[:, 1])
    normals = normals / np.linalg.norm(normals, axis=1, keepdims=True) @ R.T
    # A level line is in its plane through the camera and in a level one.
    along = np.stack([normals[:, 1], -normals[:, 0]], axis=1)
    horizontal = np.linalg.norm(along, axis=1)
    good = (horizontal > math.sin(_OFF_HORIZON_RAD)) & (np.abs(normals[:, 2]) > math.sin(_MEET_RAD))
    if int(good.sum()) < _LEAST_MEETING:
        return None
    turns = np.arctan2(along[good, 1], along[good, 0]) % (math.pi / 2)
    weight = length[good]
    tried = np.arange(0.0, math.pi / 2, _MEET_RAD / 2)
    off = np.abs((turns[None, :] - tried[:, None] + math.pi / 4) % (math.pi / 2) - math.pi / 4)
    with_it = (off < 2 * _MEET_RAD) @ weight
    best = int(np.argmax(with_it))
    if with_it[best] < _LEAST_ALIGNED * weight.sum():
        return None
    on = off[best] < 2 * _MEET_RAD
    return float(np.angle(np.sum(weight[on] * np.exp(4j * turns[on]))) / 4)


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
