"""Split a query into words of known classes, the terminals of the grammar."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal, get_args

from llm.offline.lexicon import Lexicon

# Terminal of the preposition: TO and FROM do not distinguish inside and on top; OUTOF does where there is an interior.
# Those of the second line distinguish objects, but no plan can achieve them.
Direction = Literal[
    "INTO", "IN", "ONTO", "ON", "TO", "FROM", "OUTOF",
    "NEXT", "CLOSEST", "LEFTOF", "RIGHTOF", "BETWEEN", "UNDER", "ABOVE", "BEHIND", "INFRONT", "AGAINST",
]  # fmt: skip
PREPOSITIONS = frozenset(get_args(Direction))
# After a verb of moving without a thing.
_WAYS = PREPOSITIONS - {"IN", "FROM", "OUTOF"} | {"THERE"}
_PUNCTUATION = {",": "COMMA", ".": "STOP", ";": "STOP", "!": "STOP", "?": "STOP", ":": "COMMA"}
# The mark of an entry in a list: "1. open it 2. ...", "step 1: ...", a bullet at the beginning of a line.
_ITEM = re.compile(r"(?:(?:^|(?<=\s))(?:step\s+)?\(?\d{1,2}[.):](?=\s)|(?m:^)[ \t]*[-*\u2022](?=\s))")
# "The t.v. stand", "a c.d".
_INITIALS = re.compile(r"(?<![^\W_])(?:[^\W\d_]\.)+[^\W\d_](?!\w)(?:\.(?=\s*\w))?")
_PIECE = re.compile(
    r"(?P<possessive>'s\b)|(?P<word>[^\W_](?:\w|'(?!s\b)(?=\w))*)|(?P<mark>[,.;!?:])|(?P<and>&)|(?P<sign>\S)"
)
# Quotation marks, brackets, dashes and invisible characters are ignored; any other sign is an unknown word.
_SILENT_MARKS = frozenset("\"'`*_")
_SILENT_CATEGORIES = frozenset({"Ps", "Pe", "Pi", "Pf", "Pd", "Pc", "Cc", "Cf", "Mn"})
_ARTICLES = ("DETERMINER", "A")
_TWICE = (("DETERMINER", "A"), ("A", "DETERMINER"), ("A", "TWO"))
_ONWARD = frozenset({"TO", "INTO", "ONTO"})
ENDS = frozenset({"COMMA", "STOP", "AND", "THEN"})


@dataclass(frozen=True, slots=True)
class TaggedWord:
    """A word or phrase of the query with its terminal of the grammar."""

    terminal: str
    text: str


def read_words(query: str, lexicon: Lexicon) -> tuple[tuple[TaggedWord, ...], tuple[str, ...]]:
    """Tokenize a query; return its tagged words, and the phrases dropped because they change nothing in a plan.

    Words and signs that are not in the lexicon have the class WORD.

    Args:
        query: Any text; case, accents of punctuation and quotation marks do not matter.
        lexicon: Known words. Longer phrases win over shorter ones.
    """
    pieces = _pieces(query)
    longest = max((phrase.count(" ") + 1 for phrase in (*lexicon.terminals, *lexicon.courtesy)), default=1)
    tokens: list[TaggedWord] = []
    manner: list[str] = []
    index = 0
    while index < len(pieces):
        for length in range(min(longest, len(pieces) - index), 0, -1):
            phrase = " ".join(pieces[index : index + length])
            following = pieces[index + length] if index + length < len(pieces) else ""
            if " " in phrase and _begins_a_name(phrase, following, lexicon):
                continue
            if lexicon.terminals.get(phrase) == "PARTOF" and (not tokens or tokens[-1].terminal not in PREPOSITIONS):
                # "The head of lettuce".
                continue
            if phrase == "'s" and tokens and tokens[-1].terminal == "WORD" and not _is_named(following, lexicon):
                # "Two cd's".
                tokens[-1] = TaggedWord("WORD", f"{tokens[-1].text}s")
            elif phrase in lexicon.terminals:
                terminal = lexicon.terminals[phrase]
                if terminal in _VERBS_AS_NOUNS and tokens and _is_noun(phrase, tokens[-1], following, lexicon):
                    terminal = "WORD"
                if terminal == "PARTOF":
                    manner.append(f"{tokens[-1].text} {phrase}" if tokens else phrase)
                if terminal == "FIRST":
                    terminal = _as_first(phrase, tokens, following, lexicon)
                tokens.append(TaggedWord(terminal, phrase))
            elif phrase in lexicon.manner or phrase in lexicon.rooms:
                manner.append(phrase)
            elif length == 1 and phrase not in lexicon.courtesy:
                tokens.append(TaggedWord(_PUNCTUATION.get(phrase, "POSSESSIVE" if phrase == "'s" else "WORD"), phrase))
            elif phrase not in lexicon.courtesy:
                continue
            index += length
            break
    return _in_context(tokens, lexicon), tuple(manner)


def _in_context(words: Sequence[TaggedWord], lexicon: Lexicon) -> tuple[TaggedWord, ...]:
    """Return words with those left out or read otherwise whose neighbours decide what they are."""
    tokens = list(words)
    if len(tokens) > 1 and tokens[0].text == "to" and tokens[1].terminal not in ("DETERMINER", "A", "WORD"):
        # "To put the glass on the table".
        del tokens[0]
    for index in range(len(tokens) - 2, -1, -1):
        one, after = tokens[index : index + 2]
        # "On the the desk", "on the a chair", "a two vases", "out of of the tub".
        twice = one.text == after.text and one.terminal in (*PREPOSITIONS, *_ARTICLES)
        if twice or (one.terminal, after.terminal) in _TWICE:
            del tokens[index]
        elif (one.terminal, after.terminal) == ("OUTOF", "OF"):
            del tokens[index + 1]
    for index in range(len(tokens) - 3):
        # "Move to cups onto the tray".
        verb, count, noun = tokens[index : index + 3]
        stop = next((i for i in range(index + 2, len(tokens)) if tokens[i].terminal != "WORD"), 0)
        spelled = (verb.terminal, count.text, noun.terminal) == ("PUT", "to", "WORD")
        if spelled and tokens[stop].terminal in _ONWARD and tokens[stop - 1].text.endswith("s"):
            tokens[index + 1] = TaggedWord("TWO", "two")
    apart: list[int] = []
    for index, (one, after) in enumerate(pairwise(tokens)):
        opens = index == 0 or tokens[index - 1].terminal in ENDS
        if one.terminal in ("WORD", "DOOR") and after.terminal == "PUT":
            following = tokens[index + 2].terminal if index + 2 < len(tokens) else ""
            if following in ("PRONOUN", "THEM"):
                # "Take the mug set it on the table".
                apart.append(index + 1)
        if opens and one.text in lexicon.stands and after.terminal in (*_BEFORE_NOUNS, "PRONOUN"):
            tokens[index] = TaggedWord("PUT", one.text)
        elif index and one.text == "to" and after.terminal == "PUT":
            # "Take the mug to put it on the table".
            tokens[index] = TaggedWord("THEN", "to")
        elif one.terminal in ("PUT", "TAKE") and one.text in lexicon.goes and after.terminal in _WAYS:
            # "Move to the table".
            tokens[index] = TaggedWord("DRIVE", one.text)
    for index in reversed(apart):
        tokens.insert(index, TaggedWord("THEN", "then"))
    later = (*tokens[1:], TaggedWord("STOP", ""))
    pairs = zip(tokens, later, strict=False)
    # Without "one at a time", two commas stand side by side.
    repeated = ("COMMA", "COMMA")
    return tuple(
        one
        for one, after in pairs
        if (one.terminal != "TOO" or after.terminal in ENDS) and (one.terminal, after.terminal) != repeated
    )


# Verbs that are nouns after an article and before "of".
_VERBS_AS_NOUNS = frozenset({"PUT", "TAKE", "PICK", "STACK", "TOSS", "PULL", "FORCE", "PUSH", "DRIVE"})
_FAR_OR_NEAR = ("ONFRONT", "ONBACK")
_IN_NAMES = frozenset({"WORD", "DOOR", "LEFT", "RIGHT", "NEAREST", "FARTHEST"})
_BEFORE_NOUNS = frozenset({"DETERMINER", "A", "ONE", "ALL", "BOTH", "TWO", "THREE", "FOUR"})


def _is_noun(phrase: str, before: TaggedWord, following: str, lexicon: Lexicon) -> bool:
    """Decide whether a verb is a noun, as in "a set of keys" and "the candle stick"."""
    counts = following == "of" and before.terminal in _BEFORE_NOUNS
    return counts or (before.terminal == "WORD" and bool(lexicon.owners(f"{before.text} {phrase}")))


def _as_first(phrase: str, before: Sequence[TaggedWord], following: str, lexicon: Lexicon) -> str:
    """Return the terminal of "first": a part of a name, nothing more than "then", or a limit that no rule reads."""
    if phrase in lexicon.which and before and before[-1].terminal == "DETERMINER":
        # "The first glass".
        return "WORD"
    opens = all(token.terminal in ENDS for token in before)
    ends = not following or _PUNCTUATION.get(following, lexicon.terminals.get(following)) in ENDS
    only = not any(token.terminal in ENDS for token in before) or _is_one_wish(before)
    return "THEN" if opens or (ends and only) else "LIMIT"


def _is_one_wish(tokens: Sequence[TaggedWord]) -> bool:
    """Decide whether words are one wish of several things: "put the mug and the cup into the bowl"."""
    verbs = sum(token.terminal in _VERBS_AS_NOUNS and token.terminal != "DRIVE" for token in tokens)
    joins = [index for index, token in enumerate(tokens) if token.terminal in ENDS]
    places = [index for index, token in enumerate(tokens) if token.terminal in PREPOSITIONS]
    listing = all(tokens[index].terminal in ("AND", "COMMA") for index in joins)
    return verbs == 1 and listing and len(places) == 1 and joins[-1] < places[0]


def _is_named(piece: str, lexicon: Lexicon) -> bool:
    """Decide whether a word can belong to the name of a thing: unknown words, "drawer", and what stands before it."""
    others = piece in lexicon.courtesy or lexicon.terminals.get(piece, "WORD") not in _IN_NAMES
    return piece[:1].isalnum() and (not others or piece in lexicon.which)


def _begins_a_name(phrase: str, following: str, lexicon: Lexicon) -> bool:
    """Decide whether a phrase about room, order or side is none: "the kitchen table", "at the end of the table"."""
    terminal = lexicon.terminals.get(phrase)
    if terminal in ("THEN", *_FAR_OR_NEAR) and following == "of":
        return True
    is_room = terminal in ("ROOM", *_FAR_OR_NEAR) or phrase in lexicon.rooms
    return is_room and (_is_named(following, lexicon) or following == "of")


def _pieces(query: str) -> list[str]:
    text = unicodedata.normalize("NFKC", query).replace("\u2019", "'").casefold()
    text = _INITIALS.sub(lambda match: match.group().replace(".", ""), _ITEM.sub(" . ", text))
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
