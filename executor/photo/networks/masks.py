"""Pixels of what has a box: SAM 2, and the part of SAM 3 that takes boxes.

Sources: Ravi et al. 2024 (SAM 2); Carion et al. 2025 (SAM 3).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from executor.photo.inputs.annotations import Detection, Detections
from executor.photo.inputs.picture import Photograph
from executor.photo.networks.folder import NetworkClass, loaded, network_config
from llm.vision import overlap

MASK_KINDS: Mapping[str, NetworkClass] = MappingProxyType(
    {
        "sam2": NetworkClass("Sam2Model"),
        "sam2_video": NetworkClass("Sam2Model"),  # The published weights are of the video model, which has this one.
        "sam3_tracker": NetworkClass("Sam3TrackerModel"),
        "sam3_video": NetworkClass("Sam3TrackerModel"),
    }
)

Masker: TypeAlias = Callable[[Photograph, Detections], Detections]
"""Adds masks to detections. Raises PhotoRefused where it cannot."""

LEAST_OVERLAP = 0.5
"""Of the box around a mask with the given box: below it, the mask is of something else, and is not used."""


def box_masks(folder: Path) -> Masker:
    """Return the masker that runs the network of a folder; a detection that has a mask keeps it.

    Args:
        folder: Configuration, weights and preprocessing, as `save_pretrained` writes them.

    Raises:
        PhotoRefused: The folder holds no such network.
    """
    kind = MASK_KINDS[network_config(folder, MASK_KINDS)["model_type"]]

    def mask(picture: Photograph, found: Detections) -> Detections:
        """Raise PhotoRefused or MissingExtra if the network cannot be loaded."""
        open_ones = [index for index, thing in enumerate(found.things) if thing.mask is None]
        if not open_ones:
            return found
        network = loaded(folder, kind)
        side_px = int(network.model.config.prompt_encoder_config.image_size)
        scale = side_px / np.array([*picture.size_px, *picture.size_px])
        boxes = np.array([found.things[index].box_px for index in open_ones]) * scale
        prompts = network.torch.tensor(boxes[None], dtype=network.torch.float32)
        answer = network.answer(
            pixel_values=network.pixels(picture.rgb, side_px), input_boxes=prompts, multimask_output=False
        )
        things, doubts = list(found.things), list(found.doubts)
        for place, index in enumerate(open_ones):
            logits = network.resized(answer.pred_masks[0, place, 0], picture.size_px)
            masked = _within(things[index], (logits > 0.0).numpy())
            if masked.mask is None:
                doubts.append(f"{folder.name} has no mask for {masked.label or 'thing'}: its box is used")
            things[index] = masked
        return replace(found, things=tuple(things), doubts=tuple(doubts))

    return mask


def _within(thing: Detection, mask: NDArray[np.bool_]) -> Detection:
    """Return a detection with the part of a mask (H, W) in its box, or as it is if that part does not fill the box."""
    own = mask & thing.pixels((mask.shape[1], mask.shape[0]))
    around = Image.fromarray(own).getbbox()
    is_its = around is not None and overlap(around, thing.box_px) >= LEAST_OVERLAP
    return replace(thing, mask=own) if is_its else thing
