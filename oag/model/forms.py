"""Forms of files as pydantic models, and what pydantic finds in this project's words.

Importing pydantic takes as long as this package, so this module is imported when a file is read.
"""

from __future__ import annotations

import math
from collections.abc import Hashable, Iterator, Mapping
from functools import cache
from typing import Any, TypeVar, cast, get_args

from pydantic import BaseModel, BeforeValidator, ConfigDict, TypeAdapter, ValidationError
from pydantic_core import ErrorDetails, PydanticCustomError

from oag.model.errors import InputError
from oag.model.jsonfile import Document, did_you_mean, expected, missing, number, place_of, shown

_UNFIT = "unfit"  # The type of mistakes with a hint, or inside the value that was read.
_Form = TypeVar("_Form")
_WANTED: Mapping[str, str] = {
    "string_type": "a string",
    "string_unicode": "text",
    "string_too_long": "a text of at most {max_length} characters",
    "list_type": "a list",
    "tuple_type": "a list",
    "dict_type": "an object",
    "mapping_type": "an object",
    "model_type": "an object",
    "model_attributes_type": "an object",
    "dataclass_type": "an object",
    "named_tuple_type": "an object",
    "invalid_key": "an object with names as keys",
    "bool_type": "true or false",
    "int_type": "a whole number",
    "int_from_float": "a whole number",
    "float_type": "a number",
    "finite_number": "a number",
    "literal_error": "{expected}",
    "greater_than": "a number greater than {gt}",
    "greater_than_equal": "a number from {ge} up",
    "less_than": "a number less than {lt}",
    "less_than_equal": "a number of at most {le}",
}


class Form(BaseModel):
    """An object in a file of which every key is known."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class OpenForm(Form):
    """An object in a file of which some keys are read."""

    model_config = ConfigDict(extra="ignore", frozen=True)


def unfit(problem: str, hint: str = "", *at: str | int) -> PydanticCustomError:
    """Returns the error of a validator; `at` is the place inside the value that it was given."""
    return PydanticCustomError(_UNFIT, "{problem}", {"problem": problem, "hint": hint, "at": at})


def within(low: float, high: float) -> BeforeValidator:
    """Returns the validator of a number between two limits."""
    return BeforeValidator(lambda value: number(value, low, high))


def numbers(
    value: object,
    count: int,
    what: str,
    low: float = -math.inf,
    high: float = math.inf,
    at: tuple[str | int, ...] = (),
) -> tuple[float, ...]:
    """Returns so many numbers between two limits; `what` says which they are and `at` where, for the message."""
    if not isinstance(value, list | tuple) or len(value) != count:
        raise unfit(expected(f"{count} numbers ({what})", value), "", *at)
    found = []
    for position, entry in enumerate(value):
        try:
            found.append(number(entry, low, high))
        except ValueError as problem:
            raise unfit(str(problem), "", *at, position) from None
    return tuple(found)


def vector(count: int, what: str, low: float = -math.inf, high: float = math.inf) -> BeforeValidator:
    """Returns the validator of so many numbers between two limits."""
    return BeforeValidator(lambda value: numbers(value, count, what, low, high))


def adapter(form: type[_Form]) -> TypeAdapter[_Form]:
    """Returns what reads plain data as a form; making one takes milliseconds, so each is made once."""
    return _adapter(cast("Hashable", form))


@cache
def _adapter(form: Any) -> TypeAdapter[Any]:
    return TypeAdapter(form)


def examine(
    document: Document, form: type[_Form], *path: str | int
) -> tuple[_Form, tuple[()]] | tuple[None, tuple[InputError, ...]]:
    """Returns what stands at a path of a document, or everything in it that is not of the form."""
    try:
        return adapter(form).validate_python(document.at(*path)), ()
    except ValidationError as problem:
        found = (_words(error, form) for error in problem.errors(include_url=False))
        return None, tuple(document.fail((*path, *place), said, hint) for place, said, hint in found)


def first_mistake(problem: ValidationError, form: object = None) -> str:
    """Returns the first thing that is not of a form: where, what was expected, and the nearest legal names."""
    place, said, hint = _words(problem.errors(include_url=False)[0], form)
    return f"{place_of(place)}: {said}".removeprefix(": ") + (f" ({hint})" if hint else "")


def _words(error: ErrorDetails, form: object) -> tuple[tuple[str | int, ...], str, str]:
    """Returns the place of a finding of pydantic, the problem, and a hint, which may be empty."""
    place, kind, value, context = error["loc"], error["type"], error["input"], error.get("ctx", {})
    if kind == _UNFIT:
        return (*place, *context["at"]), context["problem"], context["hint"]
    if kind == "missing":
        if isinstance(place[-1], int):
            return place[:-1], f"entry {place[-1] + 1} is missing", ""
        return place[:-1], *missing(place[-1], value if isinstance(value, Mapping) else ())
    if kind == "extra_forbidden":
        known = _keys_at(form, place[:-1])
        hint = did_you_mean(str(place[-1]), known, f"expected {', '.join(known)}" if known else "")
        return place[:-1], f"has a key {shown(place[-1])} that nothing reads", hint
    if kind == "value_error":
        return place, str(context["error"]), ""
    wanted = _WANTED.get(kind)
    return place, error["msg"] if wanted is None else expected(wanted.format(**context), value), ""


def _keys_at(form: object, path: tuple[str | int, ...]) -> list[str]:
    """Returns the keys that the model at a path of a form has; none where it is no model."""
    at = next(_models(form), None)
    for step in path:
        field = next((f for n, f in (at.model_fields if at else {}).items() if (f.alias or n) == step), None)
        at = at if field is None else next(_models(field.annotation), at)
    return [] if at is None else [field.alias or name for name, field in at.model_fields.items()]


def _models(annotation: object) -> Iterator[type[BaseModel]]:
    """Yields the models in an annotation, such as the one of `dict[str, ObjectForm] | None`."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for part in get_args(annotation):
        yield from _models(part)
