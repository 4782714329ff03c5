"""Depth that a network guesses from the picture alone, from a folder of weights: Depth Anything, trained on metres.

Source: Yang et al. 2024, Depth Anything V2; its indoor weights are those that Digital Cousins takes.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from executor.photo.inputs.depth import BEND_SHARE, Depth, DepthSource, checked_depth
from executor.photo.inputs.picture import Photograph
from executor.photo.perception.networks import loaded, network_config
from executor.photo.refusal import PhotoRefused

_KIND = "depth_anything"


def guessed_depth(folder: Path) -> DepthSource:
    """Returns the source of depth behind which the network of a folder stands.

    Args:
        folder: Configuration, weights and preprocessing, as `save_pretrained` writes them.

    Raises:
        PhotoRefused: The folder holds no such network, or one whose depths have no unit.
    """
    config = network_config(folder, (_KIND,))
    if config.get("depth_estimation_type") != "metric":
        hint = "expected weights that were trained on metres, such as those for indoor scenes"
        raise PhotoRefused("weights", folder, "holds a network whose depths have no unit", hint)

    def depth(picture: Photograph) -> Depth:
        """Raises PhotoRefused or MissingExtra where the network cannot be loaded, or guesses what is no room."""
        network = loaded(folder, "DepthAnythingForDepthEstimation", "DPTImageProcessorPil")
        pixels = network.processor(images=picture.rgb, return_tensors="pt")
        with network.torch.inference_mode():
            answer = network.model(**pixels)
        guessed = network.processor.post_process_depth_estimation(answer, target_sizes=[picture.rgb.shape[:2]])
        z_m = guessed[0]["predicted_depth"].numpy().astype(np.float64)
        told = f"guessed from the picture by {folder.name}"
        return replace(checked_depth(folder, z_m, picture.size_px, 1.0, told), bend_share=BEND_SHARE)

    return depth
