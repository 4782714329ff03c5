"""What is in a picture, as a model sees it: boxes with names, numbers of doors and drawers, what stands on what."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Annotated, ClassVar

from pydantic import Field, WithJsonSchema

from llm.answers.ask import Log, ask
from llm.answers.base import Answer
from llm.answers.conversation import SPOTTER, Conversation, finding
from llm.answers.prompting import Prompt, fenced, render
from llm.errors import ReplayMissing
from llm.sight.forms import FORMS, Box, box_px, form_words
from llm.sight.pattern import ROUNDS, Boxed, asked_form
from llm.wire.budget import Metered
from llm.wire.profiles import BoxForm
from llm.wire.transport import Image
from oag import Diagnostic

MOST_THINGS = 80
"""More are no list of a room's things, but a model that has begun to repeat itself."""

FLOOR = 0
"""In place of the number of what a thing stands on."""

_MOST_PARTS = 20
_OVER = 0.05  # Of the picture's sides: so far a box may reach over its border, and is cut.
_LEAST_PX = 3.0

_Count = Annotated[Annotated[int, Field(ge=0, le=_MOST_PARTS)] | None, WithJsonSchema({"type": "integer"})]
_Support = Annotated[Annotated[int, Field(ge=FLOOR, le=MOST_THINGS)] | None, WithJsonSchema({"type": "integer"})]


class ThingAnswer(Boxed):
    """One thing of the picture."""

    number: int = Field(ge=1, le=MOST_THINGS, description="number of the thing, from 1")
    doors: _Count = Field(default=None, description="how many doors it has, open ones too")
    drawers: _Count = Field(default=None, description="how many drawers it has, open ones too")
    on: _Support = Field(default=None, description="number of the thing that it stands on or in; 0 for the floor")


class ThingsAnswer(Answer):
    """All things of the picture; none is an answer too."""

    list_name: ClassVar[str] = "things"
    things: list[ThingAnswer] = Field(max_length=MOST_THINGS)


@dataclass(frozen=True, slots=True)
class SpottedThing:
    """One thing that a model has seen.

    Attributes:
        label: As the model named it.
        box_px: In the picture that it was shown.
        doors, drawers: How many it has; None where the model does not say.
        on: Index, in the same tuple, of what it stands on or in; -1 for the floor, None where the model does not say.
    """

    label: str
    box_px: Box
    doors: int | None
    drawers: int | None
    on: int | None


@dataclass(frozen=True, slots=True)
class Spotted:
    """What a model has seen in a picture.

    Attributes:
        things: In the order of the answer.
        form: In which form it writes boxes, as the test pattern shows.
        agreement: How well its boxes lay on the pattern's rectangles, 0 to 1.
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
    """Returns what a model sees in a picture; a drawn pattern shows first in which form it writes boxes.

    Args:
        model: Who is asked; it also keeps the budget.
        image: The picture.
        size_px: Its width and height.
        names: What things may be called.
        unknown: Returns why a label is none of these and nothing like them, with near ones; None for a good label.
            Such a thing is asked about once, and stays as it is.
        conversation: Where all that is said is kept.

    Raises:
        AnswersRefused: None of the answers held.
        ModelError: The model did not reply, or the budget is spent.
    """
    log = Log(conversation)
    asked, (form, share) = _form(model, log)
    text = render(
        "sight/things",
        width=str(size_px[0]),
        height=str(size_px[1]),
        form=form_words(asked),
        names=fenced("names", ", ".join(names)),
    )
    prompt = Prompt(SPOTTER, render("sight/sight_system"), text, (image,))
    answer = ask(
        model, prompt, ThingsAnswer, lambda given: _wrong(given, form, size_px, unknown), rounds=ROUNDS, log=log
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
    """Returns the form that the model is asked for, and what the pattern shows.

    A recording does not know whose it is: it holds the one form that was asked for then.
    """
    if model.boxes is not None:
        return model.boxes, asked_form(model, model.boxes, log)
    missing: ReplayMissing | None = None
    for form in FORMS:
        try:
            return form, asked_form(model, form, log)
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


def _wrong(
    answer: ThingsAnswer, form: BoxForm, size_px: tuple[int, int], unknown: Callable[[str], str | None]
) -> Iterator[Diagnostic]:
    """Yields boxes that cannot be and numbers that are there twice; and, to be asked about once, what is doubtful."""
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
    """Returns what is wrong with where a box is, None for nothing."""
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
