"""Words of standing up what lies: "stand the bottle up", "set the fallen glass upright", "put the can on its feet".

Such a wish has a verb of putting and a word for upright, and says no other place than where the thing is. Where it
says one, that is a wish to put it there, and things are put down upright anyway.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import pairwise

from llm.offline.grounding import Grounding
from llm.offline.words import ENDS, PREPOSITIONS, TaggedWord, read_words

_TURNING = frozenset({"turn", "tip", "tilt", "flip", "get", "make"})
"""Verbs beside those of putting."""

_ARTICLES = frozenset({"DETERMINER", "A", "ONE", "ALL", "BOTH", "TWO", "THREE", "FOUR"})
_JOINING = frozenset({"AND", "COMMA"})
_LONGEST = 6  # Words of a phrase for what lies.


def with_standings(query: str, grounding: Grounding) -> tuple[TaggedWord, ...] | None:
    """Return a query's words with those of standing things up tagged as such; None where it asks for no such thing."""
    lexicon = grounding.names.lexicon
    words, _ = read_words(query, replace(lexicon, manner=lexicon.manner - lexicon.upright))
    clauses = list(_clauses(words, grounding))
    # Without anything that lies, "put the mug upright" is a wish of its own only where nothing else is asked for.
    only = len([clause for clause in clauses if clause[0].terminal not in ENDS]) == 1
    around = grounding.around
    none_lies = not any(around.can_stand(key) and around.is_upright(key) is False for key in around.scene.objects)
    found, stands = list[TaggedWord](), False
    for clause in clauses:
        things = _stood(clause, grounding)
        if things is None or (none_lies and not only and clause[0].text not in lexicon.stands):
            found += clause
        else:
            found += [TaggedWord("SETUPRIGHT", "stand up"), *things]
            stands = True
    if not stands:
        return None
    return tuple(word for word in _without(found, lexicon.fallen) if word.text not in lexicon.upright)


def _clauses(words: Sequence[TaggedWord], grounding: Grounding) -> Iterator[list[TaggedWord]]:
    """Yield the words of each wish, with its whole list of things, and what is between wishes."""
    ends = [-1, *(index for index, word in enumerate(words) if word.terminal in ENDS), len(words)]
    clause = list[TaggedWord]()
    for end, after in pairwise(ends):
        more = list(words[end + 1 : after])
        mark = list(words[max(end, 0) : end + 1])
        if clause and mark and mark[0].terminal in _JOINING and _names_another(more, grounding):
            clause += [*mark, *more]
            continue
        if clause:
            yield clause
        if mark:
            yield mark
        clause = more
    if clause:
        yield clause


def _names_another(words: Sequence[TaggedWord], grounding: Grounding) -> bool:
    first = words[0] if words else None
    is_named = first is not None and first.terminal == "WORD" and grounding.names.knows(first.text)
    return first is not None and (first.terminal in _ARTICLES or is_named)


def _stood(clause: Sequence[TaggedWord], grounding: Grounding) -> list[TaggedWord] | None:
    """Return the words for what a wish stands up; None for another wish."""
    lexicon, (verb, *rest) = grounding.names.lexicon, clause
    rights = verb.text in lexicon.stands
    if not (rights or verb.terminal == "PUT" or verb.text in _TURNING):
        return None
    plain = _without(rest, lexicon.upright)
    if rights:
        plain = [word for word in plain if word.text != "up"]
    if len(plain) == len(rest) or not plain:
        return None
    found = list[TaggedWord]()
    for things in _listed(_without(plain, lexicon.fallen)):
        place = next((k for k, word in enumerate(things) if word.terminal in PREPOSITIONS), None)
        named = _ids(things[:place], grounding)
        if place is not None and not _are_there(named, _ids(things[place + 1 :], grounding), grounding):
            return None
        found += [TaggedWord("AND", "and")] if found else []
        found += _lying_alone(things[:place], named, grounding) + (things[place:] if place is not None else [])
    return found


def _listed(words: Sequence[TaggedWord]) -> list[list[TaggedWord]]:
    found = [list[TaggedWord]()]
    for word in words:
        if word.terminal in _JOINING:
            found.append([])
        else:
            found[-1].append(word)
    return [one for one in found if one]


def _ids(words: Sequence[TaggedWord], grounding: Grounding) -> tuple[str, ...]:
    return grounding.names.described(tuple(word.text for word in words if word.terminal in ("WORD", "DOOR"))).ids


def _are_there(ids: Sequence[str], places: Sequence[str], grounding: Grounding) -> bool:
    """Decide whether a thing is at a place already, so that the words of the place say which thing is meant."""
    return any(step.object_id in places for key in ids for step in grounding.around.supports(key))


def _lying_alone(words: Sequence[TaggedWord], ids: Sequence[str], grounding: Grounding) -> list[TaggedWord]:
    """Return the words for a thing; of several of a name the only one that lies is meant."""
    lying = [key for key in ids if grounding.around.is_upright(key) is False]
    if len(ids) < 2 or len(lying) != 1 or any(word.terminal in _ARTICLES - {"DETERMINER", "A"} for word in words):
        return list(words)
    return [TaggedWord("WORD", lying[0])]


def _without(words: Sequence[TaggedWord], phrases: frozenset[str]) -> list[TaggedWord]:
    """Return words without the longest runs of them that are one of some phrases."""
    found, index = list[TaggedWord](), 0
    while index < len(words):
        runs = (stop for stop in range(min(len(words), index + _LONGEST), index, -1))
        end = next((stop for stop in runs if " ".join(word.text for word in words[index:stop]) in phrases), None)
        if end is None:
            found.append(words[index])
        index = end or index + 1
    return found
