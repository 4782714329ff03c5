"""Detectors that are told by words what to look for: Grounding DINO and OWLv2, from a folder of weights.

Source: Liu et al. 2023 (Grounding DINO, which Digital Cousins asks), Minderer et al. 2023 (OWLv2).
"""

from __future__ import annotations

import bisect
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from executor.assets.library import LIBRARY
from executor.geometry import Array
from executor.photo.inputs.annotations import Detections, Detector
from executor.photo.inputs.picture import Photograph
from executor.photo.perception.candidates import FoundBox, sorted_out
from executor.photo.perception.networks import Network, loaded, network_config

LEAST_SCORE = {"grounding-dino": 0.25, "owlv2": 0.2}
"""From which a box counts: what Digital Cousins takes of Grounding DINO; OWLv2's scores are lower."""

_PROMPT = "a photo of a {}"  # As OWLv2 was trained.


def zero_shot(folder: Path, least_score: float | None = None) -> Detector:
    """Returns the detector in a folder of weights, which looks for every category of the library.

    Args:
        folder: Configuration, weights, tokenizer and preprocessing, as `save_pretrained` writes them.
        least_score: From which a box counts; by default LEAST_SCORE.

    Raises:
        PhotoRefused: The folder holds no such detector.
    """
    kind = network_config(folder, tuple(LEAST_SCORE))["model_type"]
    least = LEAST_SCORE[kind] if least_score is None else least_score
    names = sorted({entry.category.replace("_", " ") for entry in LIBRARY.values()})

    def detect(picture: Photograph) -> Detections:
        """Raises PhotoRefused or MissingExtra where the network cannot be loaded."""
        boxes, scores = (_grounded if kind == "grounding-dino" else _owl)(folder, picture, names)
        sure = np.flatnonzero(scores.max(axis=1) >= least)
        found = [
            FoundBox(names[int(scores[row].argmax())], _corners(boxes[row]), float(scores[row].max())) for row in sure
        ]
        return sorted_out(found, picture.size_px, f"{kind} in {folder.name}")

    return detect


def _grounded(folder: Path, picture: Photograph, names: Sequence[str]) -> tuple[Array, Array]:
    """Returns boxes (N, 4) as centre and size in pixels, and how well each fits each name (N, names)."""
    network = loaded(folder, "GroundingDinoForObjectDetection", "GroundingDinoImageProcessorPil")
    text = "".join(f"{name}. " for name in names)
    words = network.tokenizer()(text, return_offsets_mapping=True, return_tensors="pt")
    spans = words.pop("offset_mapping")[0].tolist()
    answer = _answer(network, **network.processor(images=picture.rgb, return_tensors="pt"), **words)
    share = answer.logits[0].sigmoid().numpy()
    begins = np.cumsum([0, *(len(name) + 2 for name in names[:-1])]).tolist()
    scores = np.zeros((len(share), len(names)))
    for token, (start, end) in enumerate(spans[: share.shape[1]]):
        # A name scores as its best word does; the dot between names is none.
        if end > start and text[start:end].strip(" ."):
            owner = bisect.bisect_right(begins, start) - 1
            scores[:, owner] = np.maximum(scores[:, owner], share[:, token])
    width, height = picture.size_px
    return answer.pred_boxes[0].numpy() * [width, height, width, height], scores


def _owl(folder: Path, picture: Photograph, names: Sequence[str]) -> tuple[Array, Array]:
    """Returns the same of OWLv2, which sees the picture in the upper left corner of a square."""
    network = loaded(folder, "Owlv2ForObjectDetection", "Owlv2ImageProcessorPil")
    words = network.tokenizer()(
        [_PROMPT.format(name) for name in names],
        padding="max_length",
        max_length=network.model.config.text_config.max_position_embeddings,
        truncation=True,
        return_tensors="pt",
    )
    pixels = network.processor(images=picture.rgb, return_tensors="pt")["pixel_values"]
    answer = _answer(network, pixel_values=pixels, input_ids=words["input_ids"], attention_mask=words["attention_mask"])
    return answer.pred_boxes[0].numpy() * max(picture.size_px), answer.logits[0].sigmoid().numpy()


def _answer(network: Network, **inputs: Any) -> Any:
    with network.torch.inference_mode():
        return network.model(**inputs)


def _corners(box: Array) -> tuple[float, float, float, float]:
    x, y, width, height = (float(value) for value in box)
    return x - width / 2, y - height / 2, x + width / 2, y + height / 2
