"""What is shown on a terminal: nothing in a file's text steers it, widths are known, and numbers have their nouns."""

from __future__ import annotations

import re
from unicodedata import category, east_asian_width

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


def json_escaped(text: str) -> str:
    """Returns the text of a JSON document with JSON's own escape for each character that `visible` replaces.

    The document means the same: outside of strings JSON has none of them.

    Example:
        >>> print(json_escaped('"\\x9b31m"'))
        "\\u009b31m"
    """
    return _STEERING.sub(lambda found: f"\\u{ord(found.group()):04x}", text)


def columns(character: str) -> int:
    """Returns how many columns a terminal with a fixed-width font gives a character: none, one or two.

    Source: Unicode Standard Annex 11 (East Asian Width); marks that combine with a character before take none.
    """
    if character.isascii():
        return 1
    if category(character) in ("Mn", "Me", "Cf"):
        return 0
    return 2 if east_asian_width(character) in "WF" else 1


def counted(count: int, noun: str) -> str:
    """Returns a number with its noun, such as "1 subtask" or "2 subtasks"."""
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"


def _picture(found: re.Match[str]) -> str:
    number = ord(found.group())
    if number < 0x20:
        return chr(_PICTURES + number)
    return _PICTURE_OF_DELETE if number == 0x7F else _UNKNOWN
