"""Texts with their places: line and column of an offset, and pieces on one line for a hint."""

from __future__ import annotations

import re
from bisect import bisect_left

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


def one_line(text: str) -> str:
    """Returns the text without comments, on one line; empty when it is too long to be repeated in a hint."""
    if len(text) > 4 * _QUOTE_LIMIT:
        return ""
    joined = " ".join(" ".join(line.partition(";")[0] for line in text.split("\n")).split())
    joined = joined.replace("( ", "(").replace(" )", ")")
    return joined if len(joined) <= _QUOTE_LIMIT else ""
