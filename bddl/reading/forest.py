"""From text to nested parenthesised forms, by the Lark grammar that lies beside this file."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, TypeAlias

from bddl.reading.source import Source
from bddl.syntax import Span

if TYPE_CHECKING:  # lark is imported when the first text is parsed, which keeps `import bddl` quick.
    from lark import Lark


@dataclass(slots=True, eq=False)
class Word:
    """A word of the text, or a parenthesis.

    Attributes:
        kind: Name of its terminal in the grammar.
        text: The word as written.
        offset: Where it begins in the text.
        source: The text that it stands in.
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
        """Its place."""
        return self.source.span(self.offset, 0 if self.invented else len(self.text))

    @property
    def type(self) -> str:
        """The name under which the grammar's machine knows a token."""
        return self.kind


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
    def offset(self) -> int:
        """Where it begins in the text."""
        return self.opened.offset

    @property
    def end(self) -> int:
        """The offset behind its closing parenthesis."""
        return self.closed.end

    @property
    def span(self) -> Span:
        """Its place."""
        opened = self.opened
        return opened.source.span(opened.offset, self.closed.end - opened.offset)

    @property
    def type(self) -> str:
        """The name under which the grammar's machine knows a form that was read in one piece."""
        return "FLAT"


Item: TypeAlias = Word | Group
Forest: TypeAlias = Sequence[Item]


def read_forest(source: Source) -> Forest | None:
    """Returns the forms and words of a text, or None when its parentheses do not match."""
    from lark.exceptions import UnexpectedInput

    try:
        return _grown(_tokens(source))
    except UnexpectedInput:
        return None


def read_words(source: Source) -> list[Word]:
    """Returns every word and parenthesis of a text, in order."""
    return [
        Word(found.lastgroup or "", found.group(), found.start(), source)
        for found in _machine().words.finditer(source.text)
        if found.lastgroup != "COMMENT"
    ]


def regroup(words: Iterable[Word]) -> Forest:
    """Returns the forest of words whose parentheses match; their places stay as they are."""
    return _grown(words)


def _tokens(source: Source) -> Iterator[Item]:
    """Yields the tokens of a text, forms that hold nothing but words in one piece."""
    machine, text = _machine(), source.text
    for found in machine.tokens.finditer(text):
        kind = found.lastgroup or ""
        if kind == "FLAT":
            start, end = found.span()
            inside = [
                Word(word.lastgroup or "", word.group(), word.start(), source)
                for word in machine.words.finditer(text, start + 1, end - 1)
            ]
            yield Group(inside, Word("OPEN", "(", start, source), Word("CLOSE", ")", end - 1, source))
        elif kind != "COMMENT":
            yield Word(kind, found.group(), found.start(), source)


def _grown(tokens: Iterable[Item]) -> Forest:
    """Returns the forest of some tokens.

    Raises:
        UnexpectedInput: Their parentheses do not match.
    """
    from lark import Token

    feed = _machine().lark.parse_interactive().parser_state.feed_token
    for token in tokens:
        feed(token)  # type: ignore[arg-type]
    forest: Forest = feed(Token("$END", ""), is_end=True)
    return forest


@dataclass(frozen=True, slots=True)
class _Machine:
    """The grammar's parser, and its terminals as two patterns: with and without forms read in one piece.

    Blanks are in neither pattern: whatever no other terminal matches is a blank.
    """

    lark: Lark
    tokens: re.Pattern[str]
    words: re.Pattern[str]


@lru_cache(maxsize=1)
def _machine() -> _Machine:
    """Returns the parser, built once; it makes groups while it parses, so no step depends on the depth of a text."""
    from lark import Lark

    lark = Lark.open("grammar.lark", rel_to=__file__, parser="lalr", lexer="basic", transformer=_Builder())
    terminals = sorted(lark.terminals, key=lambda terminal: -terminal.priority)
    named = {terminal.name: f"(?P<{terminal.name}>{terminal.pattern.to_regexp()})" for terminal in terminals}
    del named["SPACE"]
    tokens = re.compile("|".join(named.values()))
    del named["FLAT"]
    return _Machine(lark, tokens, re.compile("|".join(named.values())))


class _Builder:
    """What Lark calls for each rule of the grammar as soon as the rule is complete."""

    def start(self, children: list[Item]) -> Forest:
        return children

    def group(self, children: list[Item]) -> Group:
        opened, closed = children[0], children[-1]
        if not isinstance(opened, Word) or not isinstance(closed, Word):
            raise TypeError("The grammar's rule `group` begins with OPEN and ends with CLOSE.")
        return Group(children[1:-1], opened, closed)
