"""From the text of a query to tokens of the grammar's word classes."""

from __future__ import annotations

import re
import unicodedata
from dataclasses import dataclass

from llm.offline.lexicon import Lexicon

_PUNCTUATION = {",": "COMMA", ".": "STOP", ";": "STOP", "!": "STOP", "?": "STOP", ":": "COMMA"}
# The mark of an entry in a list: "1. open it 2. ...", "step 1: ...", a bullet at the beginning of a line.
_ITEM = re.compile(r"(?:(?:^|(?<=\s))(?:step\s+)?\(?\d{1,2}[.):](?=\s)|(?m:^)[ \t]*[-*\u2022](?=\s))")
_PIECE = re.compile(
    r"(?P<possessive>'s\b)|(?P<word>[^\W_](?:\w|'(?!s\b)(?=\w))*)|(?P<mark>[,.;!?:])|(?P<and>&)|(?P<sign>\S)"
)
# Quotation marks, brackets, dashes and what cannot be seen say nothing; any other sign is a word that nobody knows.
_SILENT_MARKS = frozenset("\"'`*_")
_SILENT_CATEGORIES = frozenset({"Ps", "Pe", "Pi", "Pf", "Pd", "Pc", "Cc", "Cf", "Mn"})
_ENDS = frozenset({"COMMA", "STOP", "AND", "THEN"})


@dataclass(frozen=True, slots=True)
class TaggedWord:
    """A word or phrase of the query with the class that the grammar knows it by."""

    terminal: str
    text: str


@dataclass(frozen=True, slots=True)
class Words:
    """A query as the grammar reads it.

    Attributes:
        tokens: Its words in order.
        manner: Words that were left out because they change nothing in a plan.
    """

    tokens: tuple[TaggedWord, ...]
    manner: tuple[str, ...] = ()


def read_words(query: str, lexicon: Lexicon) -> Words:
    """Returns the query's words with their classes; words and signs that the lexicon lacks are of class WORD.

    Args:
        query: Any text; case, accents of punctuation and quotation marks do not matter.
        lexicon: The words to know. Longer phrases win over shorter ones.
    """
    pieces = _pieces(query)
    longest = max((phrase.count(" ") + 1 for phrase in (*lexicon.terminals, *lexicon.courtesy)), default=1)
    tokens: list[TaggedWord] = []
    manner: list[str] = []
    index = 0
    while index < len(pieces):
        for length in range(min(longest, len(pieces) - index), 0, -1):
            phrase = " ".join(pieces[index : index + length])
            if phrase in lexicon.terminals:
                terminal = lexicon.terminals[phrase]
                if terminal == "THEN" and phrase in lexicon.which and tokens and tokens[-1].terminal == "DETERMINER":
                    # "The first glass".
                    terminal = "WORD"
                tokens.append(TaggedWord(terminal, phrase))
            elif phrase in lexicon.manner:
                manner.append(phrase)
            elif length == 1 and phrase not in lexicon.courtesy:
                tokens.append(TaggedWord(_PUNCTUATION.get(phrase, "POSSESSIVE" if phrase == "'s" else "WORD"), phrase))
            elif phrase not in lexicon.courtesy:
                continue
            index += length
            break
    following = (*tokens[1:], TaggedWord("STOP", ""))
    pairs = zip(tokens, following, strict=False)
    kept = tuple(one for one, after in pairs if one.terminal != "TOO" or after.terminal in _ENDS)
    return Words(kept, tuple(manner))


def _pieces(query: str) -> list[str]:
    text = unicodedata.normalize("NFKC", query).replace("\u2019", "'").casefold()
    text = _ITEM.sub(" . ", text)
    # "that's" is a phrase of its own; elsewhere 's marks the owner of a part.
    pieces: list[str] = []
    for match in _PIECE.finditer(text):
        piece = match.group()
        if match.lastgroup == "sign" and (piece in _SILENT_MARKS or unicodedata.category(piece) in _SILENT_CATEGORIES):
            continue
        if piece == "'s" and pieces and pieces[-1] in ("that", "let"):
            pieces[-1] += piece
        else:
            pieces.append(piece)
    return pieces
