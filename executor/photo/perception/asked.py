"""The detector behind which a vision-language model stands, asked over the same wire as models that plan."""

from __future__ import annotations

from io import BytesIO

import numpy as np
from numpy.typing import NDArray
from PIL import Image as Drawing

from executor.assets.library import LIBRARY
from executor.photo.inputs.annotations import Detections, Detector
from executor.photo.inputs.picture import Photograph
from executor.photo.perception.candidates import FoundBox, sorted_out, unlike
from llm.answers.conversation import Conversation
from llm.sight.things import spot
from llm.wire.budget import Metered
from llm.wire.transport import Image

MOST_SIDE_PX = 1568
"""Of the picture that is sent: services scale larger ones down, and boxes in pixels would be of that size."""

_PATCH_PX = 28  # Sides are multiples of it, since models that look at patches round them to that.
_QUALITY = 92  # Of the JPEG: what is written on a can stays legible.


def asks(model: Metered, conversation: Conversation) -> Detector:
    """Returns the detector that asks a model.

    Args:
        model: Who is asked; it keeps the budget, and what is said where it is recorded.
        conversation: Every round goes in here.
    """

    def detect(picture: Photograph) -> Detections:
        """Raises ModelError or AnswersRefused where the model gives no usable answer."""
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
        return sorted_out(candidates, picture.size_px, source)

    return detect


def sent_picture(rgb: NDArray[np.uint8]) -> tuple[Image, tuple[int, int]]:
    """Returns a picture (H, W, 3) as it is sent, in JPEG, with its width and height."""
    height, width = rgb.shape[:2]
    factor = min(1.0, MOST_SIDE_PX / max(width, height))
    size_px = tuple(max(1, round(side * factor / _PATCH_PX)) * _PATCH_PX for side in (width, height))
    scaled = Drawing.fromarray(rgb).resize((size_px[0], size_px[1]), Drawing.Resampling.LANCZOS)
    content = BytesIO()
    scaled.save(content, "JPEG", quality=_QUALITY)
    return Image(content.getvalue(), "image/jpeg"), (size_px[0], size_px[1])
