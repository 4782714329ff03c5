"""Depth that a network guesses from the picture: Depth Anything, ZoeDepth, Depth Pro.

Sources: Yang et al. 2024 (Depth Anything V2, whose indoor weights Digital Cousins takes); Bhat et al. 2023 (ZoeDepth);
Bochkovskii et al. 2024 (Depth Pro, which guesses the opening angle as well).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import Any, TypeAlias

import numpy as np

from executor.photo.errors import PhotoRefused
from executor.photo.inputs.depth import DEFAULT_DEPTH_DISTORTION, Depth, DepthSource, checked_depth
from executor.photo.inputs.picture import Intrinsics, Photograph, read_camera
from executor.photo.networks.folder import Network, NetworkClass, loaded, network_config, unusable

DEPTH_KINDS: Mapping[str, NetworkClass] = MappingProxyType(
    {
        "depth_anything": NetworkClass("DepthAnythingForDepthEstimation", "DPTImageProcessorPil"),
        "zoedepth": NetworkClass("ZoeDepthForDepthEstimation", "ZoeDepthImageProcessorPil"),
        "depth_pro": NetworkClass("DepthProForDepthEstimation"),
    }
)

_Guess: TypeAlias = tuple[Any, Intrinsics | None]  # (H, W) depth [m], and the camera that it is for, if it matters.
_LEAST_INVERSE, _MOST_INVERSE = 1e-4, 1e4  # [1/m], as Depth Pro's authors bound it.


def guessed_depth(folder: Path) -> DepthSource:
    """Return the depth source that runs the network of a folder.

    Args:
        folder: Configuration, weights and preprocessing, as `save_pretrained` writes them.

    Raises:
        PhotoRefused: The folder holds no such network, or one whose depth has no unit.
    """
    config = network_config(folder, DEPTH_KINDS)
    kind = config["model_type"]
    if kind == "depth_anything" and config.get("depth_estimation_type") != "metric":
        hint = "expected weights that were trained on metres, such as those for indoor scenes"
        raise PhotoRefused("weights", folder, "holds a network whose depths have no unit", hint)

    def depth(picture: Photograph, camera: Intrinsics | None) -> Depth:
        """Raise PhotoRefused or MissingExtra if the network cannot be loaded, or its depth is no room's."""
        network = loaded(folder, DEPTH_KINDS[kind])
        values, its_camera = _GUESSES[kind](network, picture, camera)
        source = f"guessed from the picture by {folder.name}"
        read = checked_depth(folder, values.numpy().astype(np.float64), picture.size_px, 1.0, source)
        return replace(read, depth_distortion=DEFAULT_DEPTH_DISTORTION, camera=its_camera)

    return depth


def _depth_anything(network: Network, picture: Photograph, camera: Intrinsics | None) -> _Guess:
    answer = network.answer(pixel_values=network.pixels(picture.rgb))
    guessed = network.processor.post_process_depth_estimation(answer, target_sizes=[picture.rgb.shape[:2]])
    return guessed[0]["predicted_depth"], None


def _zoedepth(network: Network, picture: Photograph, camera: Intrinsics | None) -> _Guess:
    """Return the depth without the margin that preprocessing reflects around the picture."""
    answer = network.answer(pixel_values=network.pixels(picture.rgb))
    width, height = picture.size_px
    # As the library pads.
    beyond_x, beyond_y = (int(math.sqrt(side / 2) * 3) if network.processor.do_pad else 0 for side in (width, height))
    z_m = network.resized(answer.predicted_depth[0], (width + 2 * beyond_x, height + 2 * beyond_y), "bicubic")
    return z_m[beyond_y : beyond_y + height, beyond_x : beyond_x + width], None


def _depth_pro(network: Network, picture: Photograph, camera: Intrinsics | None) -> _Guess:
    """Return the depth for the known focal length, or for the guessed one."""
    answer = network.answer(pixel_values=network.pixels(picture.rgb))
    known = _guessed_camera(network, picture, answer.field_of_view) if camera is None else camera
    inverse = network.resized(answer.predicted_depth[0] * picture.size_px[0] / known.fx, picture.size_px)
    return 1.0 / inverse.clamp(_LEAST_INVERSE, _MOST_INVERSE), known


def _guessed_camera(network: Network, picture: Photograph, hfov_deg: Any) -> Intrinsics:
    if hfov_deg is None:
        problem = "its network guesses no opening angle, and the picture's is unknown"
        raise unusable(network.folder, problem, "give --camera")
    angle_deg = float(hfov_deg.flatten()[0])
    try:
        known = read_camera(f"hfov={angle_deg:.2f}", picture)
    except PhotoRefused as error:
        problem = f"guesses an opening angle of {angle_deg:.1f} degrees, which is no camera's"
        raise unusable(network.folder, problem, "give --camera") from error
    return replace(known, source=f"guessed from the picture by {network.folder.name}")


_GUESSES: Mapping[str, Callable[[Network, Photograph, Intrinsics | None], _Guess]] = MappingProxyType(
    {"depth_anything": _depth_anything, "zoedepth": _zoedepth, "depth_pro": _depth_pro}
)
