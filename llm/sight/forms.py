"""The ways in which models write a box: four numbers in one of three units and one of three orders.

Source: as the models' makers document them: Gemini has thousandths with y first, Qwen3-VL and GLM-V thousandths,
Qwen2.5-VL pixels; detectors write corner and size as often as two corners.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import get_args

from llm.wire.profiles import BoxForm

Box = tuple[float, float, float, float]
"""x0, y0, x1, y1 in pixels from the upper left corner of a picture."""

FORMS: tuple[BoxForm, ...] = get_args(BoxForm)
_UNITS = {
    "pixels": "in pixels of the picture",
    "thousandths": "as whole numbers from 0 to 1000, thousandths of the picture's width and height",
    "shares": "as decimals from 0 to 1, shares of the picture's width and height",
}
_ORDERS = {
    "xyxy": "[left, top, right, bottom]",
    "yxyx": "[top, left, bottom, right]",
    "xywh": "[left, top, width, height]",
}


def form_words(form: BoxForm) -> str:
    """Returns how a form is described to a model."""
    unit, order = form.split()
    return f"{_ORDERS[order]}, {_UNITS[unit]}"


def box_px(numbers: Sequence[float], form: BoxForm, size_px: tuple[int, int]) -> Box:
    """Returns the box that four numbers stand for, which may be anywhere.

    Args:
        numbers: As a model wrote them.
        form: How they are meant.
        size_px: Width and height of the picture.
    """
    unit, order = form.split()
    first, second, third, fourth = numbers
    if order == "yxyx":
        first, second, third, fourth = second, first, fourth, third
    elif order == "xywh":
        third, fourth = first + third, second + fourth
    if unit == "pixels":
        return first, second, third, fourth
    whole = 1000.0 if unit == "thousandths" else 1.0
    across, down = size_px[0] / whole, size_px[1] / whole
    return first * across, second * down, third * across, fourth * down


def overlap(first: Box, second: Box) -> float:
    """Returns the intersection of two boxes over their union, 0 to 1; one that is inside out has nothing in common."""
    across = min(first[2], second[2]) - max(first[0], second[0])
    down = min(first[3], second[3]) - max(first[1], second[1])
    if across <= 0.0 or down <= 0.0:
        return 0.0
    both = across * down
    return both / (_area(first) + _area(second) - both)


def _area(box: Box) -> float:
    return max(box[2] - box[0], 0.0) * max(box[3] - box[1], 0.0)
