"""A vision-language model of the tests: it knows where things are, and writes boxes in any form."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from io import BytesIO
from typing import Any

from PIL import Image

from llm.client.profiles import BoxForm
from llm.vision import RECTANGLES_PX, SIZE_PX, Box
from tests.llm.model_server import Act, Seen, replies


def written(box: Box, form: BoxForm, size_px: tuple[int, int]) -> list[float]:
    """Return the numbers by which a box in pixels is written in a form."""
    unit, order = form.split()
    whole = {"pixels": None, "thousandths": 1000.0, "shares": 1.0}[unit]
    across, down = (1.0, 1.0) if whole is None else (whole / size_px[0], whole / size_px[1])
    x0, y0, x1, y1 = box[0] * across, box[1] * down, box[2] * across, box[3] * down
    numbers = {"xyxy": [x0, y0, x1, y1], "yxyx": [y0, x0, y1, x1], "xywh": [x0, y0, x1 - x0, y1 - y0]}[order]
    return [round(number, 3) if unit == "shares" else round(number) for number in numbers]


def pattern_answer(form: BoxForm, off_px: float = 0.0) -> dict[str, Any]:
    """Return the answer to the pattern of a model whose boxes are some pixels off."""
    return {
        "things": [
            {
                "label": f"{colour} rectangle",
                "box": written((x0 + off_px, y0 - off_px, x1 + off_px, y1 - off_px), form, SIZE_PX),
            }
            for colour, (x0, y0, x1, y1) in RECTANGLES_PX.items()
        ]
    }


class Spotter:
    """What a server decides whose model sees some things.

    Attributes:
        things: Label, box in shares of the picture, and further fields of each.
        form: How it writes boxes.
    """

    def __init__(self, things: Sequence[tuple[str, Box, Mapping[str, object]]], form: BoxForm) -> None:
        self.things, self.form = things, form

    def __call__(self, seen: Seen) -> Act:
        """Return the answer to a request."""
        if "test pattern" in "".join(seen.texts):
            return replies(json.dumps(pattern_answer(self.form)))
        # In pixels, what counts is the picture as it was sent; the others need no size.
        size_px = _size(seen.images[-1]) if self.form.startswith("pixels") else (1000, 1000)
        listed = [
            {
                "number": number,
                "label": label,
                "box": written(tuple(share * size_px[axis % 2] for axis, share in enumerate(box)), self.form, size_px),
                **more,
            }
            for number, (label, box, more) in enumerate(self.things, start=1)
        ]
        return replies(json.dumps({"things": listed}))


def _size(picture: bytes) -> tuple[int, int]:
    with Image.open(BytesIO(picture)) as image:
        return image.size
