"""Typed reading of JSON with the place of every mistake: `objects.glass_0.bbox_extent: expected 3 numbers`."""

from __future__ import annotations

import json
import math
import os
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import overload

import bddl
from bddl.files import read_bounded_text
from oag.model.errors import InputError

_LONGEST_SHOWN = 60
Source = str | os.PathLike[str] | Mapping[str, object]


class _Refused(ValueError):
    """A construct that JSON decoders accept and this project does not."""


def _unique(pairs: list[tuple[str, object]]) -> dict[str, object]:
    """Returns the mapping of a JSON object; a key that appears twice would silently lose one value."""
    result = dict(pairs)
    if len(result) != len(pairs):
        counts = Counter(key for key, _ in pairs)
        twice = next(key for key, count in counts.items() if count > 1)
        raise _Refused(f"the key {twice!r} appears twice in one object")
    return result


def _no_constant(name: str) -> object:
    raise _Refused(f"{name} is no JSON number")


# Refuses, by a ValueError, keys that appear twice and constants such as NaN.
STRICT = json.JSONDecoder(object_pairs_hook=_unique, parse_constant=_no_constant)


def as_number(value: object) -> float | None:
    """Returns a JSON number as a float, one beyond all floats as infinity; None for what is no number."""
    # JSON booleans are Python integers.
    if not isinstance(value, int | float) or isinstance(value, bool):
        return None
    try:
        return float(value)
    except OverflowError:
        return math.inf if value > 0 else -math.inf


def shown(value: object, write: Callable[[object], str] = repr) -> str:
    """Returns a value for a message, cut where it is long; an integer of thousands of digits cannot be written."""
    try:
        text = write(value)
    except ValueError:
        return "a number of thousands of digits"
    return text if len(text) <= _LONGEST_SHOWN else f"{text[: _LONGEST_SHOWN - 3]}..."


def load(source: Source, error: type[InputError]) -> JsonNode:
    """Returns the root of a JSON document from a file's path, or of a mapping that is one already.

    Raises:
        InputError: As `error`: the file cannot be read, is no regular file or too large, is no JSON (with line and
            column), or is no object.
    """
    if isinstance(source, Mapping):
        return JsonNode(source, "", "(mapping)", error)
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
    except (_Refused, RecursionError, ValueError) as problem:  # ValueError: an integer of thousands of digits
        raise error(f"is not valid JSON: {problem}", source=str(path)) from problem
    return JsonNode(data, "", path.name, error)


def did_you_mean(name: str, legal: Iterable[str], otherwise: str = "") -> str:
    """Returns the hint with the near names for a wrong one, or another hint where none is near."""
    near = bddl.near_names(name, tuple(legal))
    return f"did you mean {' or '.join(near)}?" if near else otherwise


class JsonNode:
    """One value of a JSON document together with its place; its readers raise the document's error type."""

    __slots__ = ("_error", "place", "source", "value")

    def __init__(self, value: object, place: str, source: str, error: type[InputError]) -> None:
        self.value = value
        self.place = place
        self.source = source
        self._error = error

    def fail(self, problem: str, hint: str = "") -> InputError:
        """Returns the error for this place, to be raised."""
        return self._error(problem, source=self.source, place=self.place, hint=hint)

    def expected(self, what: str) -> InputError:
        """Returns the error for a value of another kind than what is expected here."""
        return self.fail(f"expected {what}, got {shown(self.value, partial(json.dumps, default=repr))}")

    def child(self, key: str, value: object) -> JsonNode:
        """Returns a member of this object with its place."""
        name = shown(key, str)
        return JsonNode(value, f"{self.place}.{name}" if self.place else name, self.source, self._error)

    def at(self, path: Iterable[str | int]) -> JsonNode:
        """Returns the value at a path of keys and indices, as far as the document goes."""
        node = self
        for step in path:
            value = node.value
            if isinstance(step, str) and isinstance(value, Mapping) and step in value:
                node = node.child(step, value[step])
            elif isinstance(step, int) and isinstance(value, list | tuple) and step < len(value):
                node = node.elements()[step]
            else:
                break
        return node

    def below(self, place: str) -> JsonNode:
        """Returns this value with a place that is further inside it, such as `[1]`."""
        return JsonNode(self.value, f"{self.place}{place}", self.source, self._error)

    def mapping(self) -> Mapping[str, object]:
        """Returns this value as an object with string keys."""
        if not isinstance(self.value, Mapping) or not all(isinstance(key, str) for key in self.value):
            raise self.expected("an object")
        return self.value

    def items(self) -> list[tuple[str, JsonNode]]:
        """Returns the members of this object."""
        return [(key, self.child(key, value)) for key, value in self.mapping().items()]

    def elements(self) -> list[JsonNode]:
        """Returns the elements of this list."""
        if not isinstance(self.value, list | tuple):
            raise self.expected("a list")
        return [
            JsonNode(value, f"{self.place}[{index}]", self.source, self._error)
            for index, value in enumerate(self.value)
        ]

    def get(self, key: str) -> JsonNode | None:
        """Returns a member, or None when it is absent or null."""
        value = self.mapping().get(key)
        return None if value is None else self.child(key, value)

    def optional(self, key: str, otherwise: object) -> JsonNode:
        """Returns a member; where it is absent or null, one of another value."""
        return self.get(key) or self.child(key, otherwise)

    def require(self, key: str) -> JsonNode:
        """Returns a member that must be there; the error names near keys that are."""
        members = self.mapping()
        if members.get(key) is None:
            raise self.missing(key)
        return self.child(key, members[key])

    def missing(self, key: str) -> InputError:
        """Returns the error for a member that must be there."""
        members = self.mapping()
        state = "is null" if key in members else "is missing"
        near = bddl.near_names(key, tuple(name for name in members if name != key))
        hint = f"did you mean {' or '.join(repr(name) for name in near)} to be it?" if near else ""
        return self.fail(f"the field {key!r} {state}", hint)

    def only(self, *known: str) -> None:
        """Refuses an object with a key that nobody reads: it may be a slip for another one."""
        for key in self.mapping():
            if key not in known:
                raise self.unread(key, known)

    def unread(self, key: str, known: Sequence[str]) -> InputError:
        """Returns the error for a key that nobody reads."""
        hint = did_you_mean(key, known, f"expected {', '.join(known)}")
        return self.fail(f"has a key {shown(key)} that nothing reads", hint)

    def string(self) -> str:
        """Returns this value as text."""
        if not isinstance(self.value, str):
            raise self.expected("a string")
        return self.value

    def number(self) -> float:
        """Returns this value as a finite number."""
        number = as_number(self.value)
        if number is None or not math.isfinite(number):
            raise self.expected("a number")
        return number

    def within(self, low: float, high: float) -> float:
        """Returns this value as a number from one limit to another."""
        value = self.number()
        if value <= 0.0 < low:
            raise self.expected("a number greater than 0")
        if not low <= value <= high:
            raise self.expected(f"a number from {low:g} to {high:g}")
        return value

    def numbers(self, count: int, what: str, low: float = -math.inf, high: float = math.inf) -> tuple[float, ...]:
        """Returns this value as `count` numbers between two limits; `what` says which they are, for the message."""
        if not isinstance(self.value, list | tuple) or len(self.value) != count:
            raise self.expected(f"{count} numbers ({what})")
        return tuple(node.within(low, high) for node in self.elements())

    @overload
    def text(self, key: str) -> str | None: ...
    @overload
    def text(self, key: str, default: str) -> str: ...
    def text(self, key: str, default: str | None = None) -> str | None:
        """Returns an optional string member, or the default."""
        node = self.get(key)
        return default if node is None else node.string()
