"""Detectors that look for names: Grounding DINO, OWLv2, and SAM 3, which gives masks as well.

Sources: Liu et al. 2023 (Grounding DINO, the detector of Digital Cousins); Zhao et al. 2024 (MM-Grounding-DINO);
Minderer et al. 2023 (OWLv2); Carion et al. 2025 (SAM 3).
"""

from __future__ import annotations

import bisect
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import TypeAlias

import numpy as np

from executor.geometry import Array
from executor.photo.errors import PhotoRefused
from executor.photo.inputs.annotations import Detections, Detector
from executor.photo.inputs.picture import Photograph
from executor.photo.networks.folder import CONFIG, Network, NetworkClass, loaded, network_config
from executor.photo.perception import FoundBox, library_names, packaged, to_detections

DETECTOR_KINDS: Mapping[str, NetworkClass] = MappingProxyType(
    {
        "grounding-dino": NetworkClass(
            "GroundingDinoForObjectDetection", "GroundingDinoImageProcessorPil", reads_words=True
        ),
        "mm-grounding-dino": NetworkClass(
            "MMGroundingDinoForObjectDetection", "GroundingDinoImageProcessorPil", reads_words=True
        ),
        "owlv2": NetworkClass("Owlv2ForObjectDetection", "Owlv2ImageProcessorPil", reads_words=True),
        "sam3": NetworkClass("Sam3Model", reads_words=True),
        "sam3_video": NetworkClass("Sam3Model", reads_words=True),  # The published weights, which have this network.
    }
)
ZERO_SHOT_LEAST_SCORE = {
    "grounding-dino": 0.25,
    "mm-grounding-dino": 0.25,
    "owlv2": 0.2,
    "sam3": 0.5,
    "sam3_video": 0.5,
}
"""Smallest score of a box: that of Digital Cousins for Grounding DINO, of its authors for SAM 3; OWLv2's are lower."""

_PROMPT = "a photo of a {}"  # As OWLv2 was trained.

_Find: TypeAlias = Callable[[Network, Photograph, Sequence[str], float], Iterator[FoundBox]]


def detector_in(folder: Path, least_score: float | None = None, names: Sequence[str] | None = None) -> Detector:
    """Return the detector in a folder.

    Args:
        folder: With `config.json` it is one for `transformers` (`zero_shot`), with a graph of TensorFlow that of a
            package (`packaged`).
        least_score: Smallest score of a box, 0 to 1; by default the detector's usual one.
        names: What is looked for; by default every category of the library.

    Raises:
        PhotoRefused: It holds neither, or its content cannot be read.
        MissingExtra: A library that runs it is not installed.
    """
    if any(folder.glob("*.pb")):
        return packaged(folder, least_score, names)
    if folder.is_dir() and not ((folder / CONFIG).exists() or any(folder.glob("*.safetensors"))):
        hint = f"expected one with {CONFIG} and model.safetensors, or with a graph (.pb) and its text (.pbtxt)"
        raise PhotoRefused("weights", folder, "has no detector in it", hint)
    return zero_shot(folder, least_score, names)


def zero_shot(folder: Path, least_score: float | None = None, names: Sequence[str] | None = None) -> Detector:
    """Return the open-vocabulary detector of a folder of weights.

    Args:
        folder: Configuration, weights, tokenizer and preprocessing, as `save_pretrained` writes them.
        least_score: Smallest score of a box; by default ZERO_SHOT_LEAST_SCORE.
        names: What is looked for; by default every category of the library.

    Raises:
        PhotoRefused: The folder holds no such detector.
    """
    kind = network_config(folder, DETECTOR_KINDS)["model_type"]
    least = ZERO_SHOT_LEAST_SCORE[kind] if least_score is None else least_score
    wanted = library_names() if names is None else list(names)

    def detect(picture: Photograph) -> Detections:
        """Raise PhotoRefused or MissingExtra if the network cannot be loaded."""
        network = loaded(folder, DETECTOR_KINDS[kind])
        found = list(_FINDS[kind](network, picture, wanted, least))
        return to_detections(found, picture.size_px, f"{kind} in {folder.name}")

    return detect


def _grounded(network: Network, picture: Photograph, names: Sequence[str], least: float) -> Iterator[FoundBox]:
    text = "".join(f"{name}. " for name in names)
    words = network.tokenizer()(text, return_offsets_mapping=True, return_tensors="pt")
    spans = words.pop("offset_mapping")[0].tolist()
    most = int(network.model.config.max_text_len)
    if len(spans) > most:
        problem = f"reads at most {most} pieces of words, and the names are {len(spans)}"
        raise PhotoRefused("weights", network.folder, problem, "give fewer by --names")
    prepared = network.processor(images=picture.rgb, return_tensors="pt")
    answer = network.answer(**prepared, **words)
    share = answer.logits[0].sigmoid().numpy()
    begins = np.cumsum([0, *(len(name) + 2 for name in names[:-1])]).tolist()
    scores = np.zeros((len(share), len(names)))
    for token, (start, end) in enumerate(spans):
        # A name scores as its best word does; the dot between names is none.
        if end > start and text[start:end].strip(" ."):
            owner = bisect.bisect_right(begins, start) - 1
            scores[:, owner] = np.maximum(scores[:, owner], share[:, token])
    width, height = picture.size_px
    return _best(answer.pred_boxes[0].numpy() * [width, height, width, height], scores, names, least)


def _owl(network: Network, picture: Photograph, names: Sequence[str], least: float) -> Iterator[FoundBox]:
    """Yield OWLv2's boxes; it places the picture in the upper left corner of a square."""
    words = network.tokenizer()(
        [_PROMPT.format(name) for name in names],
        padding="max_length",
        max_length=network.model.config.text_config.max_position_embeddings,
        truncation=True,
        return_tensors="pt",
    )
    answer = network.answer(
        pixel_values=network.pixels(picture.rgb), input_ids=words["input_ids"], attention_mask=words["attention_mask"]
    )
    boxes = answer.pred_boxes[0].numpy() * max(picture.size_px)
    return _best(boxes, answer.logits[0].sigmoid().numpy(), names, least)


def _best(boxes: Array, scores: Array, names: Sequence[str], least: float) -> Iterator[FoundBox]:
    """Yield boxes (N, 4), centre and size in pixels, that score enough for a name; scores are (N, names)."""
    for row in np.flatnonzero(scores.max(axis=1) >= least):
        x, y, width, height = (float(value) for value in boxes[row])
        box = (x - width / 2, y - height / 2, x + width / 2, y + height / 2)
        yield FoundBox(names[int(scores[row].argmax())], box, float(scores[row].max()))


def _concepts(network: Network, picture: Photograph, names: Sequence[str], least: float) -> Iterator[FoundBox]:
    """Yield boxes and masks of SAM 3, which is asked for one name after the other."""
    width, height = picture.size_px
    tokenizer = network.tokenizer()
    config = network.model.config
    with network.torch.inference_mode():
        features = network.model.get_vision_features(network.pixels(picture.rgb, int(config.vision_config.image_size)))
    for name in names:
        words = tokenizer(
            name,
            padding="max_length",
            max_length=config.text_config.max_position_embeddings,
            truncation=True,
            return_tensors="pt",
        )
        answer = network.answer(
            vision_embeds=features, input_ids=words["input_ids"], attention_mask=words["attention_mask"]
        )
        scores = (answer.pred_logits[0].sigmoid() * answer.presence_logits[0].sigmoid()).numpy()
        for row in np.flatnonzero(scores >= least):
            x0, y0, x1, y1 = (answer.pred_boxes[0, row].numpy() * [width, height, width, height]).tolist()
            logits = network.resized(answer.pred_masks[0, row], picture.size_px)
            yield FoundBox(name, (x0, y0, x1, y1), float(scores[row]), mask=(logits > 0.0).numpy())


_FINDS: Mapping[str, _Find] = MappingProxyType(
    {
        "grounding-dino": _grounded,
        "mm-grounding-dino": _grounded,
        "owlv2": _owl,
        "sam3": _concepts,
        "sam3_video": _concepts,
    }
)
