"""A drawn picture whose boxes are known: from a model's answer to it follows in which form it writes boxes.

Models keep to the form that they were trained on, whatever they are asked for; read in another one, boxes of a
photograph would be somewhere in it, and nobody would notice.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from io import BytesIO
from typing import ClassVar

from PIL import Image as Drawing
from PIL import ImageDraw
from pydantic import Field

from llm.answers.ask import Log, ask
from llm.answers.base import Answer, Line
from llm.answers.conversation import SPOTTER, finding
from llm.answers.prompting import Prompt, render
from llm.sight.forms import FORMS, Box, box_px, form_words, overlap
from llm.wire.profiles import BoxForm
from llm.wire.transport import Image, Transport
from oag import Diagnostic

SIZE_PX = (504, 392)
"""Multiples of 28: models that look at patches of 14 or 28 pixels need not scale it.

Far from a thousand, so that pixels are far from thousandths.
"""

RECTANGLES_PX: Mapping[str, Box] = {
    "red": (40.0, 230.0, 160.0, 350.0),
    "green": (200.0, 30.0, 320.0, 110.0),
    "blue": (380.0, 90.0, 470.0, 210.0),
    "black": (260.0, 250.0, 410.0, 350.0),
}
"""Colour -> box. Off the diagonal and far from the corner, so that no two forms have similar boxes."""

LEAST_OVERLAP, LEAST_AHEAD = 0.5, 0.15
"""Mean overlap with the rectangles that the best form needs, and how far ahead of the next one it has to be: boxes that
are off by a tenth of their sides overlap by two thirds, and those of a wrong form hardly at all."""

ROUNDS = 3
_GREY = (205, 205, 205)
_INKS = {"red": (200, 30, 30), "green": (30, 140, 50), "blue": (40, 70, 200), "black": (20, 20, 20)}
_ALSO_BOX = ("box_2d", "bbox_2d", "bbox")  # As models were trained to call it.


class Boxed(Answer):
    """Something with a box; its numbers are in the model's own form."""

    label: Line = Field(description="what it is")
    box: list[float] = Field(min_length=4, max_length=4, description="its box, four numbers")

    @classmethod
    def _as_asked(cls, data: Mapping[str, object]) -> dict[str, object]:
        plain = super()._as_asked(data)
        trained = next((name for name in _ALSO_BOX if name in plain), None)
        if "box" not in plain and trained is not None:
            plain["box"] = plain[trained]
        return plain


class Rectangles(Answer):
    """The rectangles of the pattern."""

    list_name: ClassVar[str] = "things"
    things: list[Boxed] = Field(min_length=1, max_length=20)


def drawn() -> Image:
    """Returns the pattern as a picture in PNG; the same bytes every time."""
    picture = Drawing.new("RGB", SIZE_PX, _GREY)
    pen = ImageDraw.Draw(picture)
    for colour, (x0, y0, x1, y1) in RECTANGLES_PX.items():
        pen.rectangle((x0, y0, x1 - 1, y1 - 1), fill=_INKS[colour])
    content = BytesIO()
    picture.save(content, "PNG")
    return Image(content.getvalue())


def agreement(answer: Rectangles) -> dict[BoxForm, float]:
    """Returns how well the answer's boxes lie on the rectangles in each form, 0 to 1, the best form first."""
    found: dict[str, list[float]] = {}
    for thing in answer.things:
        for colour in RECTANGLES_PX:
            if colour in thing.label.lower():
                found.setdefault(colour, thing.box)
    shares = {
        form: sum(overlap(box_px(numbers, form, SIZE_PX), RECTANGLES_PX[colour]) for colour, numbers in found.items())
        / len(RECTANGLES_PX)
        for form in FORMS
    }
    return dict(sorted(shares.items(), key=lambda one: -one[1]))


def asked_form(transport: Transport, form: BoxForm, log: Log) -> tuple[BoxForm, float]:
    """Returns the form in which a model writes boxes, and how well its boxes lie on the pattern's rectangles, 0 to 1.

    Args:
        transport: The model.
        form: The one that it is asked for.
        log: Where what is said is kept.

    Raises:
        AnswersRefused: In no form do its boxes lie on the rectangles.
        ModelError: The model did not reply.
    """
    width, height = SIZE_PX
    text = render(
        "sight/pattern", width=str(width), height=str(height), colours=", ".join(RECTANGLES_PX), form=form_words(form)
    )
    prompt = Prompt(SPOTTER, render("sight/sight_system"), text, (drawn(),))
    answer = ask(transport, prompt, Rectangles, _wrong, rounds=ROUNDS, log=log)
    return next(iter(agreement(answer).items()))


def _wrong(answer: Rectangles) -> Iterator[Diagnostic]:
    labels = [thing.label.lower() for thing in answer.things]
    missing = [colour for colour in RECTANGLES_PX if not any(colour in label for label in labels)]
    if missing:
        yield finding("answer/box", f"there is no box of the rectangle that is {' or '.join(missing)}", "things")
        return
    (best, share), (_, next_share), *_ = agreement(answer).items()
    if share < LEAST_OVERLAP:
        message = f"the boxes are not on the rectangles: read as {form_words(best)}, they overlap by {share:.0%}"
        yield finding("answer/box", message, "things")
    elif share - next_share < LEAST_AHEAD:
        yield finding("answer/box", "the boxes can be read in two ways that are as good", "things")
