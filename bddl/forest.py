"""From text to nested parenthesised forms, by the Lark grammar that lies beside this file."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, TypeAlias

from bddl.syntax import Span

if TYPE_CHECKING:  # lark is imported when the first text is parsed, which keeps `import bddl` quick.
    from lark import Lark, Token


@dataclass(frozen=True, slots=True)
class Word:
    """A word of the text, or a parenthesis.

    Attributes:
        kind: Name of its terminal in the grammar.
        text: The word as written.
        span: Its place.
        invented: True for a parenthesis that the text lacks and that was put in to read on.
    """

    kind: str
    text: str
    span: Span
    invented: bool = False

    @property
    def key(self) -> str:
        """The word in the letter case in which the language's own words are compared."""
        return self.text.lower()


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Group:
    """A parenthesised form: what stands between the parentheses, and the place of all of it."""

    items: tuple[Item, ...]
    opened: Word
    closed: Word
    span: Span

    @property
    def head(self) -> Word | None:
        """The first item, when it is a word."""
        return self.items[0] if self.items and isinstance(self.items[0], Word) else None


Item: TypeAlias = Word | Group
Forest: TypeAlias = tuple[Item, ...]


def read_forest(text: str) -> Forest | None:
    """Returns the forms and words of a text, or None when its parentheses do not match."""
    from lark.exceptions import UnexpectedInput

    try:
        forest: Forest = _machine().parse(text)  # type: ignore[assignment]
    except UnexpectedInput:
        return None
    return forest


def read_words(text: str) -> list[Word]:
    """Returns every word and parenthesis of a text, in order."""
    return [_word(token) for token in _machine().lex(text)]


def regroup(words: Iterable[Word]) -> Forest:
    """Returns the forest of words whose parentheses match; their places stay as they are."""
    from lark import Token

    machine = _machine().parse_interactive()
    last = None
    for word in words:
        span = word.span
        last = Token(
            word.kind,
            word.text,
            start_pos=span.offset,
            line=span.line,
            column=span.column,
            end_pos=-1 if word.invented else span.offset + span.length,
        )
        machine.feed_token(last)
    forest: Forest = machine.feed_eof(last)  # type: ignore[no-untyped-call]
    return forest


@lru_cache(maxsize=1)
def _machine() -> Lark:
    """Returns the parser, built once; it makes groups while it parses, so no step depends on the depth of a text."""
    from lark import Lark

    return Lark.open("grammar.lark", rel_to=__file__, parser="lalr", lexer="basic", transformer=_Builder())


class _Builder:
    """What Lark calls for each rule of the grammar as soon as the rule is complete."""

    def start(self, children: list[Token | Group]) -> Forest:
        return tuple(child if isinstance(child, Group) else _word(child) for child in children)

    def group(self, children: list[Token | Group]) -> Group:
        items = self.start(children)
        opened, closed = items[0], items[-1]
        if not isinstance(opened, Word) or not isinstance(closed, Word):
            raise TypeError("The grammar's rule `group` begins with OPEN and ends with CLOSE.")
        start, end = opened.span, closed.span
        span = Span(start.line, start.column, start.offset, end.offset + end.length - start.offset)
        return Group(items[1:-1], opened, closed, span)


def _word(token: Token) -> Word:
    offset, end = token.start_pos or 0, token.end_pos or 0
    invented = end < 0
    span = Span(token.line or 1, token.column or 1, offset, 0 if invented else end - offset)
    return Word(token.type, str(token), span, invented)
