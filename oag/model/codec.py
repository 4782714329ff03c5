"""JSON: strict decoding of files, documents with the place of every mistake, and the writing of records.

`Document.read` checks a document by a form, which is a dataclass or a pydantic model (`oag.model.forms`). `Record` and
`as_json` write: pydantic would take longer to load than this package, and a serializer for nearly every field.
"""

from __future__ import annotations

import json
import math
import os
import re
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, fields
from enum import Enum
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any, TypeVar, cast

import bddl
from bddl.files import read_bounded_text
from oag.model.diagnostics import InputError, OagError
from oag.model.domain import BUILT_IN, Domain

_LONGEST_SHOWN = 60
Source = str | os.PathLike[str] | Mapping[str, object]
_Form = TypeVar("_Form")


class _Refused(ValueError):
    """A construct that JSON decoders accept and this project does not."""


def _unique(pairs: list[tuple[str, object]]) -> dict[str, object]:
    """Return the mapping of a JSON object; a key that appears twice would silently lose one value."""
    result = dict(pairs)
    if len(result) != len(pairs):
        counts = Counter(key for key, _ in pairs)
        twice = next(key for key, count in counts.items() if count > 1)
        raise _Refused(f"the key {twice!r} appears twice in one object")
    return result


class _NoNumber(_Refused):
    """A constant such as NaN; the decoder does not report its place."""


# A string, in which constants are words, or one of them.
_CONSTANT = re.compile(r'"(?:[^"\\]|\\.)*"|NaN|-?Infinity')


def _no_constant(name: str) -> object:
    raise _NoNumber(f"{name} is no JSON number")


def _first_constant(text: str) -> str:
    found = next(one for one in _CONSTANT.finditer(text) if not one[0].startswith('"'))
    before = text[: found.start()]
    return f"line {before.count(chr(10)) + 1}, column {found.start() - before.rfind(chr(10))}"


# Refuses, by a ValueError, keys that appear twice and constants such as NaN.
STRICT = json.JSONDecoder(object_pairs_hook=_unique, parse_constant=_no_constant)


@dataclass(frozen=True, slots=True)
class Document:
    """The content of a JSON file, or a mapping in its place.

    Attributes:
        source: The file's name, for messages.
    """

    data: object
    source: str
    error: type[InputError]

    def at(self, *path: str | int) -> Any:
        """Return the value at a path of keys and indices, which is there."""
        value: Any = self.data
        for step in path:
            value = value[step]
        return value

    def read(self, form: type[_Form], *path: str | int, domain: Domain = BUILT_IN) -> _Form:
        """Return the value at a path, read by a form in a domain; raises the first deviation from it as `error`."""
        # Loads pydantic, which takes as long as this package.
        examine = import_module("oag.model.forms").examine
        found, mistakes = cast("tuple[_Form | None, tuple[InputError, ...]]", examine(self, form, *path, domain=domain))
        if found is None:
            raise mistakes[0]
        return found

    def fail(self, path: Iterable[str | int], problem: str, hint: str = "") -> InputError:
        """Return the error for a place, to be raised."""
        return self.error(problem, source=self.source, place=place_of(path), hint=hint)


def load(source: Source, error: type[InputError]) -> Document:
    """Return a JSON document from a file's path, or of a mapping that is one already.

    Raises `error` when the file cannot be read, is no regular file or too large, or is no JSON (with line and column).
    """
    if isinstance(source, Mapping):
        return Document(dict(source), "(mapping)", error)
    path = Path(source)
    try:
        text = read_bounded_text(path)
    except OSError as problem:
        raise error(f"cannot be read: {problem.strerror or problem}", source=str(path)) from problem
    except UnicodeDecodeError as problem:
        raise error(f"is not UTF-8 text (byte {problem.start})", source=str(path)) from problem
    try:
        data = STRICT.decode(text)
    except json.JSONDecodeError as problem:
        place = f"line {problem.lineno}, column {problem.colno}"
        raise error(f"is not valid JSON: {problem.msg} at {place}", source=str(path)) from problem
    except _NoNumber as problem:
        raise error(f"is not valid JSON: {problem} at {_first_constant(text)}", source=str(path)) from problem
    except (_Refused, RecursionError, ValueError) as problem:  # ValueError: an integer of thousands of digits
        raise error(f"is not valid JSON: {problem}", source=str(path)) from problem
    return Document(data, path.name, error)


def place_of(path: Iterable[str | int]) -> str:
    """Return a path in words, such as `sub_tasks[1].flow`."""
    parts = (f"[{step}]" if isinstance(step, int) else f".{shown(step, str)}" for step in path)
    return "".join(parts).removeprefix(".")


def shown(value: object, write: Callable[[object], str] = repr) -> str:
    """Return a value for a message, cut where it is long; an integer of thousands of digits cannot be printed."""
    try:
        text = write(value)
    except (ValueError, TypeError, RecursionError):  # TypeError: a key that JSON has not
        return "a number of thousands of digits" if isinstance(value, int) else f"a {type(value).__name__}"
    return text if len(text) <= _LONGEST_SHOWN else f"{text[: _LONGEST_SHOWN - 3]}..."


def brief(text: str, most: int = 200) -> str:
    """Return a text on one line of at most so many characters, as `repr` shows a record; its end is kept."""
    line = " ".join(text.split())
    return line if len(line) <= most else f"{line[: most - 4]}...{line[-1]}"


def short_repr(record: type[_Form]) -> type[_Form]:
    """Let a record's `repr` have at most 200 characters; for classes whose fields may be long."""
    whole = record.__repr__
    record.__repr__ = lambda self: brief(whole(self))  # type: ignore[method-assign]
    return record


def expected(what: str, value: object) -> str:
    """Return the message for a value of another kind than expected."""
    return f"expected {what}, got {shown(value, partial(json.dumps, default=repr))}"


def missing(key: str, members: Iterable[object]) -> tuple[str, str]:
    """Return the message for a missing member, and the hint with near names."""
    near = bddl.near_names(key, tuple(name for name in members if isinstance(name, str)))
    hint = f"did you mean {' or '.join(repr(name) for name in near)} to be it?" if near else ""
    return f"the field {key!r} is missing", hint


def did_you_mean(name: str, legal: Iterable[str], otherwise: str = "") -> str:
    """Return the hint with near names for a wrong one, or another hint where none is near."""
    near = bddl.near_names(name, tuple(legal))
    return f"did you mean {' or '.join(near)}?" if near else otherwise


def as_number(value: object) -> float | None:
    """Return a JSON number as a float, one beyond all floats as infinity; None for what is no number."""
    # JSON booleans are Python integers.
    if not isinstance(value, int | float) or isinstance(value, bool):
        return None
    try:
        return float(value)
    except OverflowError:
        return math.inf if value > 0 else -math.inf


def number(value: object, low: float = -math.inf, high: float = math.inf) -> float:
    """Return a finite number between two limits; raises a ValueError with what was expected."""
    found = as_number(value)
    if found is None or not math.isfinite(found):
        raise ValueError(expected("a number", value))
    if found <= 0.0 < low:
        raise ValueError(expected("a number greater than 0", value))
    if not low <= found <= high:
        raise ValueError(expected(f"a number from {low:g} to {high:g}", value))
    return found


def index(value: object) -> int:
    """Return a whole number from 0 up; raises a ValueError with what was expected."""
    found = as_number(value)
    if found is None or not math.isfinite(found) or found < 0 or found != int(found):
        raise ValueError(expected("a whole number from 0 up", value))
    return int(found)


def members(value: object) -> Mapping[str, object]:
    """Return an object; raises a ValueError with what was expected."""
    if not isinstance(value, Mapping) or not all(isinstance(key, str) for key in value):
        raise ValueError(expected("an object", value))
    return value


@dataclass(frozen=True, slots=True)
class ReadBy:
    """Annotation of a dataclass field: the function that reads its value. Its ValueError or OagError is a mistake.

    Pydantic uses it, and is not loaded where it is written.

    Attributes:
        in_domain: Whether the function takes the domain of `Document.read` as well.
    """

    reader: Callable[..., object]
    in_domain: bool = False

    def __get_pydantic_core_schema__(self, _source: object, _handler: object) -> Any:
        from pydantic_core import core_schema

        return core_schema.with_info_plain_validator_function(self._read)

    def _read(self, value: object, info: Any) -> object:
        try:
            return self.reader(value, domain=info.context or BUILT_IN) if self.in_domain else self.reader(value)
        except OagError as problem:
            raise ValueError(str(problem)) from problem


@dataclass(frozen=True, slots=True)
class Record:
    """Base of records that are written as an object with their fields as keys, in their order."""

    def to_json(self) -> dict[str, object]:
        """Return the record as JSON values."""
        return fields_json(self)


def fields_json(record: Any) -> dict[str, object]:
    """Return the fields of a dataclass as JSON values."""
    return {field.name: as_json(getattr(record, field.name)) for field in fields(record)}


def as_json(value: Any) -> Any:
    """Return a value as JSON has it: formulas as texts, enumerations by name, no number for one that is not finite."""
    if hasattr(value, "to_json"):
        return value.to_json()
    if isinstance(value, bddl.Formula):
        return bddl.format(value)
    if isinstance(value, Enum):
        return value.name
    if isinstance(value, tuple | list):
        return [as_json(entry) for entry in value]
    if isinstance(value, Mapping):
        return {key: as_json(entry) for key, entry in value.items()}
    return None if isinstance(value, float) and not math.isfinite(value) else value
