"""From tokens to readings: every way in which the grammar can take a query."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache
from importlib.resources import files
from typing import Any, Literal

from llm.offline.commands import Command, NounPhrase, Place, Reading
from llm.offline.words import Word

# An ambiguous grammar can take n prepositions in exponentially many ways; real wishes have fewer than these.
MAX_PREPOSITIONS = 6
MAX_JOINS = 8
MAX_WORDS = 60
_PREPOSITIONS = frozenset({"INTO", "IN", "ONTO", "ON", "TO", "BESIDE", "FROM"})
_JOINS = frozenset({"AND", "THEN", "COMMA", "STOP"})


def is_too_long(tokens: Sequence[Word]) -> bool:
    """Decides whether a query is beyond what `read` takes on."""
    prepositions = sum(token.terminal in _PREPOSITIONS for token in tokens)
    joins = sum(token.terminal in _JOINS for token in tokens)
    return prepositions > MAX_PREPOSITIONS or joins > MAX_JOINS or len(tokens) > MAX_WORDS


def read(tokens: Sequence[Word]) -> tuple[Reading, ...]:
    """Returns the distinct readings of a query, in the order of the grammar; none when it has another form."""
    from lark.exceptions import UnexpectedInput
    from lark.visitors import CollapseAmbiguities

    if not tokens:
        return ()
    try:
        tree = _parser()(tokens)
    except UnexpectedInput:
        return ()
    readings = (_reading(alternative) for alternative in CollapseAmbiguities().transform(tree))
    return tuple(dict.fromkeys(readings))


@cache
def _parser() -> Callable[[Sequence[Word]], Any]:
    """Returns the parser; lark is loaded with the first query, so that importing the package stays cheap."""
    from lark import Lark, Token
    from lark.lexer import Lexer

    class WordLexer(Lexer):
        """Hands over tokens that were made by `words.py`."""

        def __init__(self, lexer_conf: object) -> None:
            pass

        def lex(self, lexer_state: Any, parser_state: Any = None) -> Any:
            """Yields the words as tokens of their class."""
            return (Token(word.terminal, word.text) for word in lexer_state)

    grammar = files("llm.offline").joinpath("grammar.lark").read_text(encoding="utf-8")
    lark: Any = Lark(grammar, parser="earley", lexer=WordLexer, ambiguity="explicit")
    parse: Callable[[Sequence[Word]], Any] = lark.parse
    return parse


def _reading(tree: Any) -> Reading:
    """Returns the commands of an unambiguous tree."""
    return tuple(_command(child) for child in _subtrees(tree))


def _command(tree: Any) -> Command:
    """Returns one wish."""
    kind = str(tree.data)
    source = destination = None
    objects: tuple[NounPhrase, ...] = ()
    for child in _subtrees(tree):
        rule = str(child.data)
        if rule == "source":
            source = _place(child)
        elif rule == "destination":
            destination = _place(child)
        elif rule == "things":
            objects = tuple(_phrase(part) for part in _subtrees(child))
        else:
            objects = (_phrase(child),)
    return Command(kind, objects, source, destination)  # type: ignore[arg-type]


def _place(tree: Any) -> Place:
    """Returns a preposition with its noun phrase."""
    words = [child for child in tree.children if not _is_tree(child) and child.type in _PREPOSITIONS]
    return Place(words[-1].type, _phrase(_subtrees(tree)[-1]), " ".join(str(word) for word in words))


def _phrase(tree: Any) -> NounPhrase:
    """Returns a noun phrase."""
    rule = str(tree.data)
    if rule == "pronoun":
        return NounPhrase((str(tree.children[0]),), pronoun=True)
    parts = _subtrees(tree)
    nouns = [part for part in parts if part.data == "noun"]
    if rule == "several":
        words = tuple(str(word) for word in (nouns[0].children if nouns else tree.children))
        return NounPhrase(words, several=True)
    words, states, door = _noun(nouns[0])
    owner = next((_phrase(part) for part in parts if part.data in ("np", "part_of", "several", "pronoun")), None)
    location = next((_place(part) for part in parts if part.data == "location"), None)
    return NounPhrase(words, states, location, owner if rule == "part_of" else None, door)


def _noun(tree: Any) -> tuple[tuple[str, ...], tuple[Literal["open", "closed"], ...], bool]:
    """Returns the words of a name, the states said before it, and whether it ends in the name of a door."""
    children = tree.children
    states = {"OPEN": "open", "CLOSE": "closed"}
    said = tuple(states[word.type] for word in children if word.type in states)
    words = tuple(str(word) for word in children if word.type not in states)
    return words, said, children[-1].type == "DOOR"  # type: ignore[return-value]


def _subtrees(tree: Any) -> list[Any]:
    """Returns the children that are trees themselves."""
    return [child for child in tree.children if _is_tree(child)]


def _is_tree(node: Any) -> bool:
    return hasattr(node, "children")
