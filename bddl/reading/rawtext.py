"""Sections that hold free text: their words are hidden from the grammar, since they may hold parentheses of their own.

Such a section ends at a closing parenthesis behind which there are only blanks and comments until the next section
begins, or until the file's own closing parenthesis: at the first one that leaves the content balanced, else at the
last one. So an instruction may hold `(`, `)` and `;`, and only `(:` ends it.
"""

from __future__ import annotations

import re
from collections.abc import Iterable

_NEXT_SECTION = re.compile(r"\(\s*:")
_CLOSING = re.compile(r"\)(?=\s*(?:;|\Z))")
# What stands in for a hidden letter: a word to the grammar.
_FILLER = "_"


def hide_free_text(text: str, sections: Iterable[str]) -> str:
    """Returns the text with the content of some sections replaced, every other character in its place.

    Args:
        text: The text of a problem.
        sections: Names of the sections with free text, such as `:language`.

    Returns:
        A text of the same length and with the same line ends. A section that does not end is left as it is, so that
        the missing parenthesis is found as everywhere else.
    """
    for section in sections:
        opening = re.search(rf"\(\s*{re.escape(section)}(?=[\s()])", text, re.IGNORECASE)
        if opening is None or _commented(text, opening.start()):
            continue
        place = _content(text, opening.end())
        if place is not None:
            start, end = place
            text = text[:start] + re.sub(r"\S", _FILLER, text[start:end]) + text[end:]
    return text


def _content(text: str, start: int) -> tuple[int, int] | None:
    """Returns where the content of a section lies that begins at an offset, or None when the section does not end."""
    following = _NEXT_SECTION.search(text, start)
    # Without a further section, the last parenthesis of the text closes the problem.
    end = text.rfind(")", start) if following is None else following.start()
    while end > start:
        line_start = max(text.rfind("\n", start, end) + 1, start)
        line = text[line_start:end]
        places = [line_start + closing.start() for closing in _CLOSING.finditer(line)]
        if places:
            return start, _first_balanced(text, start, places)
        if line.strip() and not line.lstrip().startswith(";"):
            return None
        end = line_start - 1
    return None


def _first_balanced(text: str, start: int, places: list[int]) -> int:
    """Returns the first of some places before which as many parentheses close as open, else the last one."""
    surplus, counted = 0, start
    for place in places:
        surplus += text.count("(", counted, place) - text.count(")", counted, place)
        counted = place
        if surplus == 0:
            return place
    return places[-1]


def _commented(text: str, offset: int) -> bool:
    """Decides whether a place stands behind a `;` on its line."""
    return ";" in text[text.rfind("\n", 0, offset) + 1 : offset]
