"""Lexer: words, parentheses and nested forms of a text.

It decides one thing: where every form begins and ends. What a form must contain is in the tables of the dialects, and
checked by the readers of formulas and sections: a malformed form must not hide the mistakes in its neighbours.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TypeAlias

from bddl.ast import Span
from bddl.diagnostics import Source

# Whatever none of these matches is a blank. There are no strings in BDDL, so `;` always begins a comment.
_WORDS = re.compile(
    r"(?P<COMMENT>;[^\n]*)|(?P<OPEN>\()|(?P<CLOSE>\))|(?P<HYPHEN>-(?=[\s();\ufeff]|$))"
    r"|(?P<SECTION>:[^\s();\ufeff]*)|(?P<VARIABLE>\?[^\s();\ufeff]*)|(?P<NAME>[^\s();\ufeff]+)"
)


@dataclass(slots=True, eq=False)
class Word:
    """A word of the text, or a parenthesis.

    Attributes:
        kind: Name of its group in the pattern of words.
        offset: Where it begins in the text.
        invented: True for a parenthesis that the text lacks and that was put in to read on.
    """

    kind: str
    text: str
    offset: int
    source: Source
    invented: bool = False

    @property
    def key(self) -> str:
        """The word in the letter case in which the language's own words are compared."""
        return self.text.lower()

    @property
    def end(self) -> int:
        """The offset behind its last letter."""
        return self.offset if self.invented else self.offset + len(self.text)

    @property
    def span(self) -> Span:
        return self.source.span(self.offset, 0 if self.invented else len(self.text))


@dataclass(slots=True, eq=False, repr=False)
class Group:
    """A parenthesised form: what stands between the parentheses, and the parentheses."""

    items: Sequence[Item]
    opened: Word
    closed: Word

    @property
    def head(self) -> Word | None:
        """The first item, when it is a word."""
        return self.items[0] if self.items and isinstance(self.items[0], Word) else None

    @property
    def is_flat(self) -> bool:
        return all(isinstance(item, Word) for item in self.items)

    @property
    def offset(self) -> int:
        """Where it begins in the text."""
        return self.opened.offset

    @property
    def end(self) -> int:
        """The offset behind its closing parenthesis."""
        return self.closed.end

    @property
    def span(self) -> Span:
        opened = self.opened
        return opened.source.span(opened.offset, self.closed.end - opened.offset)


Item: TypeAlias = Word | Group
Forest: TypeAlias = Sequence[Item]


def read_words(source: Source) -> list[Word]:
    """Return every word and parenthesis of a text, in order."""
    return [
        Word(found.lastgroup or "", found.group(), found.start(), source)
        for found in _WORDS.finditer(source.text)
        if found.lastgroup != "COMMENT"
    ]


def group_words(words: Iterable[Word]) -> Forest | None:
    """Return the forms and loose words of a text, or None when its parentheses do not match."""
    items: list[Item] = []
    # The opening parentheses so far, each with the items before it.
    opened: list[tuple[Word, list[Item]]] = []
    for word in words:
        if word.kind == "OPEN":
            opened.append((word, items))
            items = []
        elif word.kind != "CLOSE":
            items.append(word)
        elif not opened:
            return None
        else:
            first, around = opened.pop()
            around.append(Group(items, first, word))
            items = around
    return None if opened else items


def is_call(items: Sequence[Item]) -> bool:
    """Decide whether the first item is a word that touches the parenthesis of the second, as in `open(x)`."""
    if len(items) < 2:
        return False
    word, group = items[0], items[1]
    if not isinstance(word, Word) or word.kind != "NAME" or not isinstance(group, Group):
        return False
    return word.end == group.offset and "<" not in word.text


def to_prefix(words: Sequence[Word]) -> list[Word]:
    """Return words in which each call `name(a, b)` is turned into `(name a b)`; every word keeps its place.

    Source: the paper writes its example predicates as calls (appendix on subtask instantiation).
    """
    converted: list[Word] = []
    position = 0
    while position < len(words):
        word = words[position]
        following = words[position + 1] if position + 1 < len(words) else None
        touches = following is not None and following.kind == "OPEN" and word.end == following.offset
        if following is not None and touches and word.kind == "NAME" and "," not in word.text:
            converted += [following, word]
            position += 2
        else:
            converted += _without_commas(word)
            position += 1
    return converted


def form_text(item: Item) -> str:
    """Return a form as BDDL on one line, without its comments, however long it is."""
    words = " ".join(word.text for word in words_of([item]))
    return words.replace("( ", "(").replace(" )", ")")


def _without_commas(word: Word) -> list[Word]:
    if "," not in word.text:
        return [word]
    pieces: list[Word] = []
    start = 0
    for piece in word.text.split(","):
        pieces += [Word(word.kind, piece, word.offset + start, word.source)] if piece else []
        start += len(piece) + 1
    return pieces


def words_in(items: Iterable[Item]) -> list[Word]:
    """Return the words among some items, without those inside forms."""
    return [item for item in items if isinstance(item, Word)]


def words_of(items: Sequence[Item]) -> list[Word]:
    """Return the words and parentheses of some forms, in order."""
    found: list[Word] = []
    pending: list[Item] = list(reversed(items))
    while pending:
        item = pending.pop()
        if isinstance(item, Word):
            found.append(item)
        else:
            found.append(item.opened)
            pending.append(item.closed)
            pending.extend(reversed(item.items))
    return found


_NEXT_SECTION = re.compile(r"\(\s*:")
_CLOSING = re.compile(r"\)(?=\s*(?:;|\Z))")
# Replacement of a hidden letter; the grammar takes it for a word.
_FILLER = "_"


def hide_free_text(text: str, sections: Iterable[str]) -> str:
    """Return the text with the content of some sections replaced, every other character in its place.

    Returns:
        A text of the same length and with the same line ends. Of a section that does not end, the first line is
        taken for its content; the missing parenthesis is found as everywhere else.
    """
    for section in sections:
        # The opening parenthesis may be the one that is missing.
        opening = re.search(rf"(?:\(\s*|(?<=\s)){re.escape(section)}(?=[\s()])", text, re.IGNORECASE)
        if opening is None or _is_commented(text, opening.start()):
            continue
        place = _find_content(text, opening.end()) or _find_first_line(text, opening.end())
        if place is not None:
            start, end = place
            text = text[:start] + re.sub(r"\S", _FILLER, text[start:end]) + text[end:]
    return text


def _find_content(text: str, start: int) -> tuple[int, int] | None:
    """Return where the content of a section lies that begins at an offset, or None when the section does not end."""
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


def _find_first_line(text: str, start: int) -> tuple[int, int] | None:
    following = _NEXT_SECTION.search(text, start)
    if following is None:
        return None
    end = min(following.start(), text.find("\n", start) % (len(text) + 1))
    places = [start + closing.start() for closing in _CLOSING.finditer(text[start:end])]
    return start, _first_balanced(text, start, places) if places else end


def _first_balanced(text: str, start: int, places: list[int]) -> int:
    """Return the first of some places before which as many parentheses close as open, else the last one."""
    surplus, counted = 0, start
    for place in places:
        surplus += text.count("(", counted, place) - text.count(")", counted, place)
        counted = place
        if surplus == 0:
            return place
    return places[-1]


def _is_commented(text: str, offset: int) -> bool:
    return ";" in text[text.rfind("\n", 0, offset) + 1 : offset]
