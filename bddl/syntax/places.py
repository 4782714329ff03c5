"""Texts shown to a person: lines and columns, one line for a hint, and nothing that steers a terminal."""

from __future__ import annotations

import re
from bisect import bisect_left
from unicodedata import category, east_asian_width

from bddl.syntax.tree import Span

_BREAK = re.compile("\n")
# A longer piece of text is not repeated in a hint.
_QUOTE_LIMIT = 400


class Source:
    """A text whose places can be told as line and column.

    Args:
        text: The text.
    """

    __slots__ = ("_breaks", "text")

    def __init__(self, text: str) -> None:
        self.text = text
        # The place before the text counts as a break, so that the first line needs no case of its own.
        self._breaks = [-1, *(found.start() for found in _BREAK.finditer(text))]

    def span(self, offset: int, length: int = 0) -> Span:
        """Returns the place that begins at an offset."""
        line = bisect_left(self._breaks, offset)
        return Span(line, offset - self._breaks[line - 1], offset, length)

    def offset(self, line: int, column: int) -> int:
        """Returns the offset of a column, from 1, in a line, from 1; a line past the end counts as the last."""
        return self._breaks[min(line, len(self._breaks)) - 1] + column


# Control characters, those that turn the direction of a line, line ends that are none here, and halves of characters.
_STEERING = re.compile(
    "[\x00-\x08\x0b-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028\u2029\u202a-\u202e\u2066-\u2069\ud800-\udfff]"
)
_PICTURES = 0x2400
_PICTURE_OF_DELETE = "\u2421"
_UNKNOWN = "\ufffd"


def visible(text: str) -> str:
    """Returns the text with a picture, or a replacement mark, for each character that would do something instead.

    The result has as many characters as the text, so that columns stay. Tabs and line feeds are kept.

    Example:
        >>> visible("cup\\x1b[31m")
        'cup␛[31m'
    """
    return text if text.isprintable() else _STEERING.sub(_picture, text)


def columns(character: str) -> int:
    """Returns how many columns a terminal with a fixed-width font gives a character: none, one or two.

    Source: Unicode Standard Annex 11 (East Asian Width); marks that combine with a character before take none.
    """
    if character.isascii():
        return 1
    if category(character) in ("Mn", "Me", "Cf"):
        return 0
    return 2 if east_asian_width(character) in "WF" else 1


def _picture(found: re.Match[str]) -> str:
    number = ord(found.group())
    if number < 0x20:
        return chr(_PICTURES + number)
    return _PICTURE_OF_DELETE if number == 0x7F else _UNKNOWN


def one_line(text: str) -> str:
    """Returns the text without comments, on one line; empty when it is too long to be repeated in a hint."""
    if len(text) > 4 * _QUOTE_LIMIT:
        return ""
    joined = " ".join(" ".join(line.partition(";")[0] for line in text.split("\n")).split())
    joined = joined.replace("( ", "(").replace(" )", ")")
    return joined if len(joined) <= _QUOTE_LIMIT else ""
