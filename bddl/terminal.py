"""Text for terminals: escape control characters, measure display widths, pluralize."""

from __future__ import annotations

import re
from unicodedata import category, east_asian_width

# Control characters, direction marks, line ends other than a line feed, and halves of characters (surrogates).
_CONTROL = re.compile(
    "[\x00-\x08\x0b-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028\u2029\u202a-\u202e\u2066-\u2069\ud800-\udfff]"
)
_SYMBOLS = 0x2400
_SYMBOL_OF_DELETE = "\u2421"
_UNKNOWN = "\ufffd"


def escape_control(text: str) -> str:
    """Return the text with a visible symbol, or a replacement mark, for each control character.

    The result has as many characters as the text, so that columns stay. Tabs and line feeds are kept.

    Example:
        >>> escape_control("cup\\x1b[31m")
        'cup␛[31m'
    """
    return text if text.isprintable() else _CONTROL.sub(_symbol, text)


def escape_json(text: str) -> str:
    """Return the text of a JSON document with JSON's own escape for each character that `escape_control` replaces.

    The document means the same: outside of strings JSON has none of them.

    Example:
        >>> print(escape_json('"\\x9b31m"'))
        "\\u009b31m"
    """
    return _CONTROL.sub(lambda found: f"\\u{ord(found.group()):04x}", text)


def display_width(character: str) -> int:
    """Return the columns of a character on a terminal with a fixed-width font: none, one or two.

    Source: Unicode Standard Annex 11 (East Asian Width); marks that combine with a character before take none.
    """
    if character.isascii():
        return 1
    if category(character) in ("Mn", "Me", "Cf"):
        return 0
    return 2 if east_asian_width(character) in "WF" else 1


def pluralize(count: int, noun: str) -> str:
    """Return a number with its noun, such as "1 subtask" or "2 subtasks"."""
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"


def _symbol(found: re.Match[str]) -> str:
    number = ord(found.group())
    if number < 0x20:
        return chr(_SYMBOLS + number)
    return _SYMBOL_OF_DELETE if number == 0x7F else _UNKNOWN
