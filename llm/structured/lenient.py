"""Read JSON as models write it, where one reading is left: comments, other quotes, commas, missing braces, YAML.

`read_object` rewrites the tokens of a text to JSON and leaves the rest to the strict decoder: signs of structure come
and go, values stay. `read_yaml` takes the `yaml` library's loader that guesses no types. A key twice, a quotient or a
number that a cut may have shortened has no certain reading, and none is returned.

The libraries that repair JSON guess: they close a text that was cut off, and keep one of two equal keys. Those that
read JSON5 refuse line ends in texts and typographic quotes.
"""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from importlib import import_module
from typing import Any

from oag.model.codec import STRICT

# Longest text that is read so; answers have some thousand characters.
LONGEST_TEXT = 40_000
# Signs that are not visible, which copies of web pages leave in names: zero-width blanks and joiners, soft hyphens.
INVISIBLE = dict.fromkeys(map(ord, "\u200b\u200c\u200d\u2060\ufeff\u00ad"))
_DEEPEST = 40
_TOKEN = re.compile(
    r"""
    (?P<space>[\s\u00a0]++|//[^\n]*+|\#[^\n]*+|/\*.*?\*/)
    |(?P<text>"(?:[^"\\]|\\.)*+"|'(?:[^'\\]|\\.)*+'|[\u201c-\u201f](?:[^\u201c-\u201f\\]|\\.)*+[\u201c-\u201f]
        |\u2018(?:[^\u2018\u2019\\]|\\.)*+\u2019)
    |(?P<number>[+-]?(?:\d++\.?\d*+|\.\d++)(?:[eE][+-]?\d++)?+(?![\w./*]))
    |(?P<call>[A-Za-z_]\w*+[ ]?\([-+.,\s\d]*+\))
    |(?P<name>[A-Za-z_]\w*+)
    |(?P<sign>[{}\[\]:,])
    """,
    re.VERBOSE | re.DOTALL,
)
_FENCE = "```"
_GOES_ON = ('"', "'", ":", ",", "]", "}")
_WORDS = {"true": "true", "false": "false", "null": "null", "none": "null"}
_NO_VALUES = ("nan", "inf", "infinity", "undefined")
# A backslash with what follows it: what JSON has, and other signs.
_ESCAPE = re.compile(r'\\(?:(["\\/bfnrt]|u[0-9a-fA-F]{4})|(.))', re.DOTALL)
_BARE = re.compile(rf"""\s*(?:{_FENCE}\w*\s)?\s*(?=["'\u201c]?[A-Za-z_][\w -]{{0,60}}["'\u201c\u201d]?\s*:)""")
_FENCED = re.compile(rf"{_FENCE}[a-zA-Z]*\n(.*?)(?:{_FENCE}|\Z)", re.DOTALL)
# An anchor or an alias: copies of copies, which no answer needs.
_ALIAS = re.compile(r"(?m)(?:^|[\s\[{,:-])[&*][\w-]")


class _NoReading(ValueError):
    """A text has no reading that is certain."""


def read_object(text: str, start: int = 0, *, unclosed: bool = False) -> tuple[object, int] | None:
    """Return the object or list that begins at a position, and where it ends; None without a certain reading.

    Args:
        text: The text.
        start: Position of its opening bracket.
        unclosed: Whether the closing brace of the whole may be missing at the text's end.
    """
    try:
        tokens, length = _tokens(text[start : start + LONGEST_TEXT], unclosed)
        # What goes on like JSON was no end: a quotation mark is missing before.
        if text[start + length : start + length + 80].lstrip()[:1] in _GOES_ON:
            return None
        return STRICT.decode(_as_json(tokens)), start + length
    except (ValueError, RecursionError):
        return None


def read_bare(text: str) -> object | None:
    """Return the object of a text that consists of its members alone, without the outer braces; None for others."""
    begun = _BARE.match(text)
    if begun is None or len(text) > LONGEST_TEXT:
        return None
    found = read_object("{" + text[begun.end() :], unclosed=True)
    return None if found is None or text[begun.end() + found[1] - 1 :].strip(" \n\t`}") else found[0]


def read_yaml(text: str) -> object | None:
    """Return the mapping or list of a text in YAML, or of its last fenced part; None for others. Leaves are texts."""
    if "\n" not in text.strip():
        return None
    fenced = _FENCED.findall(text)
    text = fenced[-1] if fenced else text
    if len(text) > LONGEST_TEXT or _ALIAS.search(text):
        return None
    try:
        yaml = import_module("yaml")
    except ImportError:
        return None
    try:
        found = yaml.load(text, _loader(yaml))
    except Exception:
        # The library raises any kind of error on texts from outside, such as an OverflowError for \UFFFFFFFF.
        return None
    return found if isinstance(found, dict | list) else None


def visible(value: object) -> object:
    """Return a JSON value without the signs that are not visible, in keys as well."""
    if isinstance(value, str):
        return value.translate(INVISIBLE)
    if isinstance(value, list):
        return [visible(item) for item in value]
    if isinstance(value, dict):
        return {str(visible(key)): visible(item) for key, item in value.items()}
    return value


def _tokens(text: str, unclosed: bool) -> tuple[list[tuple[str, str]], int]:
    """Return kind and text of the tokens of the value at the beginning of a text, and the value's length there."""
    tokens: list[tuple[str, str]] = []
    opened: list[str] = []
    position = 0
    while position < len(text) and not text.startswith(_FENCE, position):
        found = _TOKEN.match(text, position)
        if found is None:
            raise _NoReading
        position, kind, token = found.end(), str(found.lastgroup), found[0]
        if kind == "space":
            continue
        if token in ("{", "["):
            opened.append(token)
        elif token in ("}", "]"):
            _drop_comma(tokens)
            if not opened or opened.pop() + token not in ("{}", "[]"):
                raise _NoReading
        if len(opened) > _DEEPEST:
            raise _NoReading
        tokens.append((kind, token))
        if not opened:
            return tokens, position
    if not unclosed or opened != ["{"]:
        raise _NoReading
    _drop_comma(tokens)
    # A number may have lost digits.
    if tokens[-1][0] != "text" and tokens[-1][1] not in ("}", "]"):
        raise _NoReading
    return [*tokens, ("sign", "}")], position


def _drop_comma(tokens: list[tuple[str, str]]) -> None:
    if tokens and tokens[-1] == ("sign", ","):
        tokens.pop()


def _as_json(tokens: Sequence[tuple[str, str]]) -> str:
    following = [*tokens[1:], ("", "")]
    return "".join(
        json.dumps(token) if kind in ("name", "number") and after == ("sign", ":") else _value(kind, token)
        for (kind, token), after in zip(tokens, following, strict=True)
    )


def _value(kind: str, token: str) -> str:
    """Return a token as JSON has it."""
    if kind == "text":
        return _quoted(token[1:-1])
    if kind == "call":
        return json.dumps(token)
    if kind == "name":
        if token.lower() in _NO_VALUES:
            raise _NoReading
        return _WORDS.get(token.lower()) or json.dumps(token)
    if kind == "number":
        # JSON has digits on both sides of a point.
        return re.sub(r"\.(?!\d)", ".0", re.sub(r"^(-?)\.", r"\g<1>0.", token.removeprefix("+")))
    return token


def _quoted(inside: str) -> str:
    """Return a text as JSON has it: line ends are written as escapes, and signs that need none lose theirs."""
    parts, end = [], 0
    for found in _ESCAPE.finditer(inside):
        if found[2] is not None and (found[2].isalnum() or found[2].isspace()):
            raise _NoReading
        parts += [json.dumps(inside[end : found.start()])[1:-1], found[0] if found[1] else json.dumps(found[2])[1:-1]]
        end = found.end()
    return "".join(('"', *parts, json.dumps(inside[end:])[1:-1], '"'))


def _loader(yaml: Any) -> Any:
    """Return the library's loader without types, which refuses a key that appears twice."""

    def mapping(loader: Any, node: Any) -> dict[str, object]:
        pairs = [(loader.construct_object(k, deep=True), loader.construct_object(v, deep=True)) for k, v in node.value]
        if len({key for key, _ in pairs}) != len(pairs):
            raise _NoReading
        return dict(pairs)

    loader: Any = type("Loader", (yaml.BaseLoader,), {})
    loader.add_constructor("tag:yaml.org,2002:map", mapping)
    return loader
