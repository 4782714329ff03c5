"""Tracks of drawn rooms: sensor noise, a mocked detector, and what each track takes from the simulator.

Depth is noisy; boxes are inexact, missing or misnamed. The boxes stand for a detector that was not run: they are the
simulator's own, degraded. Tables say so.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation, gaussian_filter

from executor.assets.library import LIBRARY
from executor.bench.photo.truth import Shot
from executor.geometry import Array
from executor.photo.geometry.level import flat_observation, level_as_given
from executor.photo.geometry.observation import observe
from executor.photo.geometry.residuals import box_of
from executor.photo.inputs.annotations import Detection
from executor.photo.inputs.depth import Depth
from executor.photo.inputs.picture import Exif, Intrinsics, Photograph
from executor.photo.pipeline import PhotoInput

_NEAR_M, _BASE_M, _GROWTH = 0.4, 0.0012, 0.0019
"""Standard deviation 1.2 mm + 1.9 mm (z - 0.4)^2, as measured for the first Kinect (Nguyen et al. 2012)."""

_HOLES = 0.02
_JUMP_M, _AT_JUMPS = 0.08, 0.5  # Share of the pixels at depth jumps that are lost.
_STEP_M = 0.001
_SENSED_GROWTH = (0.003, 0.0075)
"""Standard deviation by the square of the depth [1/m]: 12 to 30 mm at 2 m, as on the floors of real pictures."""

_SHARED_PX, _PATCH_PX = 2.0, 8.0  # Widths of what neighbouring pixels share: an error, a hole.
_AROUND_JUMPS_PX, _SENSED_AT_JUMPS, _SENSED_HOLES = 3, 0.7, 0.05
_INVERSE_STEP, _NEAREST_M = (
    0.001,
    0.1,
)  # Of the inverse depth [1/m]: 4 mm at 2 m, a 1/30 of a pixel for 50 mm and 600 px.
_LEAST_PX = 3
MOCKED = "mocked detector (the simulator's boxes, spoilt)"


@dataclass(frozen=True)
class MockedDetector:
    """How good the mocked detector is.

    Attributes:
        jitter: Standard deviation of each edge of a box, in shares of the box's side.
        missed, misnamed: Shares of the things.
    """

    jitter: float = 0.03
    missed: float = 0.05
    misnamed: float = 0.05


def noisy(depth_m: Array, rng: np.random.Generator) -> Array:
    """Return a depth picture (H, W) in metres as a structured-light camera would measure it; 0 is a hole."""
    valid = depth_m > 0.0
    sigma = _BASE_M + _GROWTH * (depth_m - _NEAR_M) ** 2
    spoilt = depth_m + rng.normal(size=depth_m.shape) * sigma
    across = np.abs(np.diff(depth_m, axis=1, prepend=depth_m[:, :1])) > _JUMP_M
    down = np.abs(np.diff(depth_m, axis=0, prepend=depth_m[:1])) > _JUMP_M
    near_jumps = binary_dilation(across | down, iterations=1)
    valid &= ~(near_jumps & (rng.random(depth_m.shape) < _AT_JUMPS))
    valid &= rng.random(depth_m.shape) > _HOLES
    return np.where(valid, np.round(spoilt / _STEP_M) * _STEP_M, 0.0)


def sensed(depth_m: Array, rng: np.random.Generator) -> Array:
    """Return a depth picture (H, W) in metres as real sensors measured it; 0 is a hole.

    The standard deviation is drawn for the picture, and grows with the square of the depth. Neighbouring pixels share
    half of the variance. Holes are around edges and in patches. Equal steps are those of the inverse depth.
    """
    valid = depth_m > 0.0
    shared = gaussian_filter(rng.normal(size=depth_m.shape), _SHARED_PX)
    error = (rng.normal(size=depth_m.shape) + shared / shared.std()) / math.sqrt(2.0)
    spoilt = np.maximum(depth_m + rng.uniform(*_SENSED_GROWTH) * depth_m**2 * error, _NEAREST_M)
    across = np.abs(np.diff(depth_m, axis=1, prepend=depth_m[:, :1])) > _JUMP_M
    down = np.abs(np.diff(depth_m, axis=0, prepend=depth_m[:1])) > _JUMP_M
    near_jumps = binary_dilation(across | down, iterations=_AROUND_JUMPS_PX)
    valid &= ~(near_jumps & (rng.random(depth_m.shape) < _SENSED_AT_JUMPS))
    patches = gaussian_filter(rng.normal(size=depth_m.shape), _PATCH_PX)
    valid &= patches < np.quantile(patches, 1.0 - _SENSED_HOLES)
    return np.where(valid, 1.0 / (np.maximum(np.round(1.0 / spoilt / _INVERSE_STEP), 1.0) * _INVERSE_STEP), 0.0)


def mocked_boxes(
    masks: Mapping[str, NDArray[np.bool_]],
    categories: Mapping[str, str],
    detector: MockedDetector,
    rng: np.random.Generator,
) -> dict[str, Detection]:
    """Return object id -> its detection by a detector of this quality; missed objects are absent.

    Args:
        masks: id -> (H, W) its visible pixels.
        categories: id -> label; empty without one.
        detector: The quality.
        rng: Random numbers.
    """
    every = sorted({entry.category for entry in LIBRARY.values()})
    found = {}
    for name, mask in masks.items():
        height, width = mask.shape
        box = np.array(box_of(mask))
        sides = np.tile(box[2:] - box[:2], 2)
        box += rng.normal(size=4) * detector.jitter * sides
        chance, other = rng.random(), str(rng.choice([one for one in every if one != categories[name]]))
        if chance < detector.missed:
            continue
        category = other if chance < detector.missed + detector.misnamed else categories[name]
        x0, y0 = np.clip(box[:2], 0.0, [width - _LEAST_PX, height - _LEAST_PX])
        x1, y1 = np.clip(np.maximum(box[2:], [x0 + _LEAST_PX, y0 + _LEAST_PX]), 0.0, [width, height])
        found[name] = Detection(category, category or None, (x0, y0, x1, y1), 1.0, MOCKED, provenance="detector")
    return found


TrackName = Literal["B", "D", "S"]
TITLES: Mapping[TrackName, str] = MappingProxyType(
    {
        "B": "track B: noisy depth, and a mocked detector: the simulator's own boxes and names, spoilt",
        "D": "track D: no depth, height and tilt known, and a mocked detector: the simulator's own boxes, spoilt",
        "S": "track S: depth with the noise of real sensors, and a mocked detector: the simulator's own boxes, spoilt",
    }
)
"""Track -> title of its table."""

_NOISY = "drawn from the simulator, with the noise of a depth camera"
_SENSED = "drawn from the simulator, with the noise, holes and steps of real sensors"


@dataclass(frozen=True)
class TrackInput:
    """Input of a reconstruction for a shot.

    Attributes:
        given: The input.
        boxes: id -> its detection in the input.
    """

    given: PhotoInput
    boxes: Mapping[str, Detection]


def input_of(
    track: TrackName,
    name: str,
    shot: Shot,
    categories: Mapping[str, str],
    detector: MockedDetector,
    rng: np.random.Generator,
) -> TrackInput:
    """Return the input of a track for a shot.

    Args:
        track: The track.
        name: Name of the scene that is made.
        shot: The known room and its picture.
        categories: id -> category of every visible object.
        detector: The quality of the mocked detector.
        rng: Random numbers.

    Raises:
        PhotoRefused: The track has to level the picture by its floor, and cannot.
    """
    masks = shot.visible()
    found = mocked_boxes(masks, categories, detector, rng)
    # A correct label is the object's own name in its room, such as a dresser.
    words = {key: shot.scene.objects[key].category for key in masks}
    boxes = {
        key: replace(box, label=words[key]) if box.category == categories[key] else box for key, box in found.items()
    }
    camera = Intrinsics(shot.K[0, 0], shot.K[1, 1], shot.K[0, 2], shot.K[1, 2], "taken from the simulator")
    picture = Photograph(Path(name), shot.rgb, Exif(None, None, ""))
    depth: Depth | None = None
    if track == "D":
        floor = level_as_given(shot.T_world_camera[2, :3], float(shot.T_world_camera[2, 3]))
        observation = flat_observation(picture, camera, floor)
    else:
        spoil, source = (noisy, _NOISY) if track == "B" else (sensed, _SENSED)
        depth = Depth(spoil(shot.depth_m, rng), source)
        observation, floor = observe(picture, depth, camera)
    return TrackInput(PhotoInput(name, picture, depth, camera, tuple(boxes.values()), observation, floor), boxes)
