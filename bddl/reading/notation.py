"""Formulas written like function calls, as in `not(ontop(cup_0, table_0))`, and how BDDL writes them."""

from __future__ import annotations

from collections.abc import Sequence

from bddl.diagnostics import one_line
from bddl.reading.forest import Group, Item, Word


def is_call(items: Sequence[Item]) -> bool:
    """Decides whether the first item is a word that touches the parenthesis of the second, as in `open(x)`."""
    if len(items) < 2:
        return False
    word, group = items[0], items[1]
    if not isinstance(word, Word) or word.kind != "NAME" or not isinstance(group, Group):
        return False
    return word.end == group.offset and "<" not in word.text


def to_prefix(words: Sequence[Word]) -> list[Word]:
    """Returns words in which each call `name(a, b)` is turned into `(name a b)`; every word keeps its place.

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


def prefix_text(words: Sequence[Word]) -> str:
    """Returns the words of a call as BDDL on one line, or "" when that is too long for a hint."""
    return one_line(" ".join(word.text for word in to_prefix(words)))


def form_text(item: Item) -> str:
    """Returns a form as BDDL on one line, without its comments, however long it is."""
    words = " ".join(word.text for word in words_of([item]))
    return words.replace("( ", "(").replace(" )", ")")


def _without_commas(word: Word) -> list[Word]:
    """Returns the pieces of a word between its commas."""
    if "," not in word.text:
        return [word]
    pieces: list[Word] = []
    start = 0
    for piece in word.text.split(","):
        pieces += [Word(word.kind, piece, word.offset + start, word.source)] if piece else []
        start += len(piece) + 1
    return pieces


def words_of(items: Sequence[Item]) -> list[Word]:
    """Returns the words and parentheses of some forms, in order."""
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
