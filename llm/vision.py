"""Detect the objects of a picture with a vision-language model: boxes, names, doors and drawers, support.

Models write boxes as they were trained to: four numbers in one of three units and one of three orders. They do
so whatever they are asked for; read in another form, the boxes would be wrong and nobody would notice. A drawn
picture with known boxes is therefore sent first, and the form is inferred from the answer.

Source: the makers' documentation. Gemini has thousandths with y first, Qwen3-VL and GLM-V thousandths,
Qwen2.5-VL pixels; detectors write corner and size as often as two corners.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from io import BytesIO
from typing import Annotated, ClassVar, get_args

from PIL import Image as Drawing
from PIL import ImageDraw
from pydantic import Field, WithJsonSchema

from llm.client.budget import Metered
from llm.client.profiles import BoxForm
from llm.client.transport import Image, Transport
from llm.errors import ReplayMissing
from llm.structured.ask import Log, ask
from llm.structured.conversation import SPOTTER, Conversation, finding
from llm.structured.prompting import Prompt, fenced, render
from llm.structured.schema import Answer, Line
from oag import Diagnostic

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
    """Return the description of a box form for a model."""
    unit, order = form.split()
    return f"{_ORDERS[order]}, {_UNITS[unit]}"


def box_px(numbers: Sequence[float], form: BoxForm, size_px: tuple[int, int]) -> Box:
    """Convert four numbers to a box in pixels; it may lie outside the picture."""
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
    """Return the intersection over union of two boxes, 0 to 1; an inverted box has none."""
    across = min(first[2], second[2]) - max(first[0], second[0])
    down = min(first[3], second[3]) - max(first[1], second[1])
    if across <= 0.0 or down <= 0.0:
        return 0.0
    both = across * down
    return both / (_area(first) + _area(second) - both)


def _area(box: Box) -> float:
    return max(box[2] - box[0], 0.0) * max(box[3] - box[1], 0.0)


SIZE_PX = (504, 392)
"""Multiples of 28, so that models with patches of 14 or 28 pixels need not scale it.

Far from 1000, so that pixels differ clearly from thousandths.
"""

RECTANGLES_PX: Mapping[str, Box] = {
    "red": (40.0, 230.0, 160.0, 350.0),
    "green": (200.0, 30.0, 320.0, 110.0),
    "blue": (380.0, 90.0, 470.0, 210.0),
    "black": (260.0, 250.0, 410.0, 350.0),
}
"""Colour -> box. Off the diagonal and far from the corner, so that no two forms give similar boxes."""

LEAST_OVERLAP, LEAST_AHEAD = 0.5, 0.15
"""Mean overlap with the rectangles that the best form needs, and how far ahead of the next one it has to be: boxes that
are off by a tenth of their sides overlap by two thirds, and those of a wrong form hardly at all."""

ROUNDS = 3
_GREY = (205, 205, 205)
_INKS = {"red": (200, 30, 30), "green": (30, 140, 50), "blue": (40, 70, 200), "black": (20, 20, 20)}
_ALSO_BOX = ("box_2d", "bbox_2d", "bbox")  # Names from the models' training.


class Boxed(Answer):
    """An object with a box; its numbers are in the model's own form."""

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
    """Answer: the rectangles of the pattern."""

    list_name: ClassVar[str] = "things"
    things: list[Boxed] = Field(min_length=1, max_length=20)


def draw_pattern() -> Image:
    """Draw the pattern as a PNG; the bytes are the same every time."""
    picture = Drawing.new("RGB", SIZE_PX, _GREY)
    pen = ImageDraw.Draw(picture)
    for colour, (x0, y0, x1, y1) in RECTANGLES_PX.items():
        pen.rectangle((x0, y0, x1 - 1, y1 - 1), fill=_INKS[colour])
    content = BytesIO()
    picture.save(content, "PNG")
    return Image(content.getvalue())


def agreement(answer: Rectangles) -> dict[BoxForm, float]:
    """Return the overlap of the answer's boxes with the rectangles for each form, 0 to 1, the best form first."""
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


def infer_box_form(transport: Transport, form: BoxForm, log: Log) -> tuple[BoxForm, float]:
    """Infer the form of a model's boxes from the pattern; return it with the mean overlap, 0 to 1."""
    width, height = SIZE_PX
    text = render(
        "vision/pattern", width=str(width), height=str(height), colours=", ".join(RECTANGLES_PX), form=form_words(form)
    )
    prompt = Prompt(SPOTTER, render("vision/system"), text, (draw_pattern(),))
    answer = ask(transport, prompt, Rectangles, _pattern_findings, rounds=ROUNDS, log=log)
    return next(iter(agreement(answer).items()))


def _pattern_findings(answer: Rectangles) -> Iterator[Diagnostic]:
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


MOST_THINGS = 80
"""More entries mean that the model repeats itself."""

FLOOR = 0
"""Number of the support that stands for the floor."""

_MOST_PARTS = 20
_OVER = 0.05  # Share of the picture's sides by which a box may exceed its border; it is clipped there.
_LEAST_PX = 3.0

_Count = Annotated[Annotated[int, Field(ge=0, le=_MOST_PARTS)] | None, WithJsonSchema({"type": "integer"})]
_Support = Annotated[Annotated[int, Field(ge=FLOOR, le=MOST_THINGS)] | None, WithJsonSchema({"type": "integer"})]


class ThingAnswer(Boxed):
    """Answer: one object of the picture."""

    number: int = Field(ge=1, le=MOST_THINGS, description="number of the thing, from 1")
    doors: _Count = Field(default=None, description="how many doors it has, open ones too")
    drawers: _Count = Field(default=None, description="how many drawers it has, open ones too")
    on: _Support = Field(default=None, description="number of the thing that it stands on or in; 0 for the floor")


class ThingsAnswer(Answer):
    """Answer: all objects of the picture; an empty list is valid."""

    list_name: ClassVar[str] = "things"
    things: list[ThingAnswer] = Field(max_length=MOST_THINGS)


@dataclass(frozen=True, slots=True)
class SpottedThing:
    """One detected object.

    Attributes:
        label: Name given by the model.
        box_px: Box in the picture [px].
        doors, drawers: Their numbers; None if not given.
        on: Index of the support in the same tuple; -1 for the floor, None if not given.
    """

    label: str
    box_px: Box
    doors: int | None
    drawers: int | None
    on: int | None


@dataclass(frozen=True, slots=True)
class Spotted:
    """Detected objects of a picture.

    Attributes:
        things: In the order of the answer.
        form: Form of the model's boxes, as inferred from the pattern.
        agreement: Mean overlap of its boxes with the pattern's rectangles, 0 to 1.
    """

    things: tuple[SpottedThing, ...]
    form: BoxForm
    agreement: float


def spot(
    model: Metered,
    image: Image,
    size_px: tuple[int, int],
    names: Sequence[str],
    unknown: Callable[[str], str | None],
    conversation: Conversation,
) -> Spotted:
    """Detect the objects of a picture with a model; a drawn pattern first shows the form of its boxes.

    Args:
        model: The model; it also keeps the budget.
        image: The picture.
        size_px: Width and height [px].
        names: Allowed labels.
        unknown: Returns why a label resembles none of them, with near ones; None for a good label. An unknown label
            is asked about once, and then kept.
        conversation: Record of the rounds.

    Raises:
        AnswersRefused: No answer was valid.
        ModelError: The model did not reply, or the budget is spent.
    """
    log = Log(conversation)
    asked, (form, share) = _form(model, log)
    text = render(
        "vision/things",
        width=str(size_px[0]),
        height=str(size_px[1]),
        form=form_words(asked),
        names=fenced("names", ", ".join(names)),
    )
    prompt = Prompt(SPOTTER, render("vision/system"), text, (image,))
    answer = ask(
        model,
        prompt,
        ThingsAnswer,
        lambda given: _detection_findings(given, form, size_px, unknown),
        rounds=ROUNDS,
        log=log,
    )
    places = {thing.number: index for index, thing in enumerate(answer.things)}
    things = tuple(
        SpottedThing(
            thing.label,
            _cut(box_px(thing.box, form, size_px), size_px),
            thing.doors,
            thing.drawers,
            _support(thing, places),
        )
        for thing in answer.things
    )
    return Spotted(things, form, share)


def _form(model: Metered, log: Log) -> tuple[BoxForm, tuple[BoxForm, float]]:
    """Return the requested form, and the inferred form with its overlap.

    A recording does not know its model: it contains the one form that was requested then.
    """
    if model.boxes is not None:
        return model.boxes, infer_box_form(model, model.boxes, log)
    missing: ReplayMissing | None = None
    for form in FORMS:
        try:
            return form, infer_box_form(model, form, log)
        except ReplayMissing as problem:
            missing = missing or problem
    raise missing or ValueError("there is no form to ask for")


def _support(thing: ThingAnswer, places: dict[int, int]) -> int | None:
    if thing.on is None or thing.on == thing.number:
        return None
    return -1 if thing.on == FLOOR else places.get(thing.on)


def _cut(box: Box, size_px: tuple[int, int]) -> Box:
    width, height = size_px
    return max(0.0, box[0]), max(0.0, box[1]), min(float(width), box[2]), min(float(height), box[3])


def _detection_findings(
    answer: ThingsAnswer, form: BoxForm, size_px: tuple[int, int], unknown: Callable[[str], str | None]
) -> Iterator[Diagnostic]:
    if not answer.things:
        hint = "answer with an empty list again if there is none of them"
        yield finding("answer/nothing", "no thing is listed", "things", hint=hint, severity="warning")
    numbers = [thing.number for thing in answer.things]
    for number in sorted({number for number in numbers if numbers.count(number) > 1}):
        yield finding("answer/numbering", f"two things have the number {number}", "things")
    for thing in answer.things:
        place = f"thing {thing.number}, {thing.label}"
        problem = _misplaced(box_px(thing.box, form, size_px), size_px)
        if problem is not None:
            hint = f"a box is {form_words(form)}"
            yield finding("answer/box", f"{_plain(thing.box)} {problem}", f"{place}, box", hint=hint)
        reason = unknown(thing.label)
        if reason is not None:
            hint = "use the nearest name that is listed, or leave the thing out"
            yield finding("answer/label", reason, f"{place}, label", hint=hint, severity="warning")
        if thing.on is not None and (thing.on == thing.number or thing.on not in (FLOOR, *numbers)):
            message = f"it stands on {thing.on}, which is {'itself' if thing.on == thing.number else 'no thing listed'}"
            yield finding("answer/support", message, f"{place}, on", severity="warning")


def _misplaced(box: Box, size_px: tuple[int, int]) -> str | None:
    width, height = size_px
    x0, y0, x1, y1 = box
    if x1 - x0 < _LEAST_PX or y1 - y0 < _LEAST_PX:
        return "has no width or no height"
    over_x, over_y = _OVER * width, _OVER * height
    inside = -over_x <= x0 and -over_y <= y0 and x1 <= width + over_x and y1 <= height + over_y
    cut = _cut(box, size_px)
    if not inside or cut[2] - cut[0] < _LEAST_PX or cut[3] - cut[1] < _LEAST_PX:
        return "is not in the picture"
    return None


def _plain(numbers: Sequence[float]) -> str:
    return f"[{', '.join(f'{number:g}' for number in numbers)}]"
