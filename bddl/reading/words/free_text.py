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
        A text of the same length and with the same line ends. Of a section that does not end, the first line is
        taken for its content; the missing parenthesis is found as everywhere else.
    """
    for section in sections:
        # The opening parenthesis may be the one that is missing.
        opening = re.search(rf"(?:\(\s*|(?<=\s)){re.escape(section)}(?=[\s()])", text, re.IGNORECASE)
        if opening is None or _commented(text, opening.start()):
            continue
        place = _content(text, opening.end()) or _first_line(text, opening.end())
        if place is not None:
            start, end = place
            text = text[:start] + re.sub(r"\S", _FILLER, text[start:end]) + text[end:]
    return text


def _content(text: str, start: int) -> tuple[int, int] | None:
    """Returns where the content of a section lies that begins at an offset, or None when the section does not end."""
    following = _NEXT_SECTION.search(text, start)
    # Without a further section, the last parenthesis of the text closes the problem.
    end = text.rfind(")", start) if following is None else following.start()
    alone: tuple[int, int] | None = None
    while end > start:
        line_start = max(text.rfind("\n", start, end) + 1, start)
        line = text[line_start:end]
        places = [line_start + closing.start() for closing in _CLOSING.finditer(line)]
        if places:
            place = _first_balanced(text, start, places)
            if line.strip() != ")" or text.count("(", start, place) == text.count(")", start, place):
                return start, place
            # A parenthesis on a line of its own is one too many when the line before it ends the section.
            alone = alone or (start, place)
        elif line.strip() and not line.lstrip().startswith(";"):
            return alone
        end = line_start - 1
    return alone


def _first_line(text: str, start: int) -> tuple[int, int] | None:
    """Returns where the content lies on the first line of a section that does not end before another one begins."""
    following = _NEXT_SECTION.search(text, start)
    if following is None:
        return None
    end = min(following.start(), text.find("\n", start) % (len(text) + 1))
    places = [start + closing.start() for closing in _CLOSING.finditer(text[start:end])]
    return start, _first_balanced(text, start, places) if places else end


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
