"""Floor and metric scale by the camera's height: of pictures without depth, and of depth that a network guesses."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from executor.geometry import Array
from executor.photo.errors import PhotoRefused
from executor.photo.geometry.lines import heading_of_lines
from executor.photo.geometry.observation import TYPICAL, FloorPlane, Observation, level_rotation, tilt_deg
from executor.photo.inputs.depth import Depth
from executor.photo.inputs.picture import Intrinsics, Photograph

_FACTORS = (0.2, 5.0)
_HELD_SHARE = 0.02  # How exactly people know how high they hold a camera.


def level_as_given(up: Array, height_m: float) -> FloorPlane:
    """Return the floor below a camera of known height and vertical (3,)."""
    return FloorPlane(up, height_m, 0.0, tilt_deg(up), 0.0, "tilt as given; the camera's height as given", _HELD_SHARE)


def flat_observation(picture: Photograph, camera: Intrinsics, floor: FloorPlane) -> Observation:
    """Return a picture without depth in the level frame."""
    R = level_rotation(floor.up)
    eye_m = np.array([0.0, 0.0, floor.height_m])
    nothing = np.zeros(picture.rgb.shape[:2])
    rays, heading_rad = camera.rays(picture.size_px) @ R.T, heading_of_lines(picture, camera, R)
    return Observation(picture.rgb, nothing, rays, eye_m, R.T, TYPICAL, camera, heading_rad)


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
    if not _FACTORS[0] <= factor <= _FACTORS[1]:
        problem = f"the camera's height would make it {factor:.3g} times as deep"
        hint = "is it the right height, and are the depths in the right unit (--depth-unit-m)?"
        raise PhotoRefused("scale", depth.source, problem, hint)
    description = f"{depth.source}, times {factor:.4f} (+- {100 * _HELD_SHARE:.1f} %) by the camera's height"
    return replace(depth, z_m=depth.z_m * factor, source=description), scaled
