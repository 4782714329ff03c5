"""A true picture spoilt as sensors and detectors spoil it: noisy depth; boxes that are off, missing, misnamed.

The boxes stand for a detector that nobody has run: they are the simulator's own, made worse. Tables say so.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation, gaussian_filter

from executor.assets.library import LIBRARY
from executor.geometry import Array
from executor.photo.inputs.annotations import Sighting
from executor.photo.space.standing_out import box_of

_NEAR_M, _BASE_M, _GROWTH = 0.4, 0.0012, 0.0019
"""Standard deviation 1.2 mm + 1.9 mm (z - 0.4)^2, as measured for the first Kinect (Nguyen et al. 2012)."""

_HOLES = 0.02
_JUMP_M, _AT_JUMPS = 0.08, 0.5  # Of the pixels beside a jump of depth, how many are lost.
_STEP_M = 0.001
_LEAST_PX = 3
MOCKED = "mocked detector (the simulator's boxes, spoilt)"
ORACLE = "oracle (the simulator's masks and names)"
_SCALE, _SHIFT_M, _BEND, _BEND_PX, _BLUR_PX = 0.05, 0.05, 0.02, 60.0, 1.5
"""How far off depths of a network are taken to be: standard deviations of scale, shift and a slow bend, which goes over
so many pixels; and how soft its edges are."""


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
    """Returns a depth picture (H, W) in metres as a structured-light camera would measure it; 0 is a hole."""
    valid = depth_m > 0.0
    sigma = _BASE_M + _GROWTH * (depth_m - _NEAR_M) ** 2
    spoilt = depth_m + rng.normal(size=depth_m.shape) * sigma
    across = np.abs(np.diff(depth_m, axis=1, prepend=depth_m[:, :1])) > _JUMP_M
    down = np.abs(np.diff(depth_m, axis=0, prepend=depth_m[:1])) > _JUMP_M
    beside = binary_dilation(across | down, iterations=1)
    valid &= ~(beside & (rng.random(depth_m.shape) < _AT_JUMPS))
    valid &= rng.random(depth_m.shape) > _HOLES
    return np.where(valid, np.round(spoilt / _STEP_M) * _STEP_M, 0.0)


def mono_like(depth_m: Array, rng: np.random.Generator) -> Array:
    """Returns a depth picture (H, W) in metres that is off as a network's guess from one picture is.

    A stand-in: no network was run. Wrong by a factor and a shift, bent slowly over the picture, soft at edges.
    """
    valid = depth_m > 0.0
    soft = gaussian_filter(np.where(valid, depth_m, np.median(depth_m[valid])), _BLUR_PX)
    bend = gaussian_filter(rng.normal(size=depth_m.shape), _BEND_PX)
    guessed = soft * (1.0 + rng.normal() * _SCALE) * (1.0 + _BEND * bend / bend.std()) + rng.normal() * _SHIFT_M
    return np.where(valid & (guessed > 0.0), guessed, 0.0)


def exact_boxes(masks: Mapping[str, NDArray[np.bool_]], categories: Mapping[str, str]) -> dict[str, Sighting]:
    """Returns object id -> its mask, the box around it, and its name, as the simulator has them."""
    return {
        name: Sighting(categories[name], categories[name], box_of(mask), 1.0, ORACLE, mask, provenance="detector")
        for name, mask in masks.items()
    }


def mocked_boxes(
    masks: Mapping[str, NDArray[np.bool_]],
    categories: Mapping[str, str],
    detector: MockedDetector,
    rng: np.random.Generator,
) -> dict[str, Sighting]:
    """Returns object id -> what a detector of this quality finds of it; who is missed is not in it.

    Args:
        masks: id -> (H, W) pixels in which it is seen.
        categories: id -> what it is called; empty where it has no name.
        detector: The quality.
        rng: What chance is drawn from.
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
        found[name] = Sighting(category, category or None, (x0, y0, x1, y1), 1.0, MOCKED, provenance="detector")
    return found
