"""Other sentences for one wish, for data sets that teach language: each is read by the grammar as the first one is."""

from __future__ import annotations

import re
from collections.abc import Iterator
from functools import cache

from llm.offline.lexicon import Lexicon, built_in
from llm.offline.reader import Reading, read, read_words

_VERBS = {
    "open": ("open", "open up", "pull open"),
    "close": ("close", "shut", "push shut"),
    "shut": ("close", "shut", "push shut"),
    "pick up": ("pick up", "grab", "take", "lift", "get"),
    "grab": ("pick up", "grab", "take", "lift", "get"),
    "get": ("pick up", "grab", "take", "lift", "get"),
    "lift": ("pick up", "grab", "take", "lift", "get"),
    "put": ("put", "place", "set", "move"),
    "place": ("put", "place", "set", "move"),
    "move": ("put", "place", "set", "move"),
}
# What somebody says around a wish, and what is said around it here instead.
_AROUND = re.compile(r"^(?:(?:please|could you|can you|would you)\b[ ,]*)+|(?:[ ,]*\bplease\b|\?)+$", re.IGNORECASE)
_FRAMES = ("{}", "please {}", "could you {}?", "{}, please", "I want you to {}")


@cache
def paraphrases(query: str, most: int = 8) -> tuple[str, ...]:
    """Returns sentences that say what a query says in other words, in an order that follows from the query alone.

    Args:
        query: One wish that begins with its verb, such as "put the glass into the refrigerator"; of others there are
            only the courteous forms.
        most: How many at the most; they are spread over all that are found.
    """
    lexicon = built_in()
    wanted = _readings(query, lexicon)
    if not wanted:
        return ()
    found = [text for text in _candidates(query) if text != query and _readings(text, lexicon) == wanted]
    step = max(len(found) / most, 1.0)
    return tuple(found[int(place * step)] for place in range(min(most, len(found))))


def _readings(text: str, lexicon: Lexicon) -> frozenset[Reading]:
    return frozenset(read(read_words(text, lexicon)[0]))


def _candidates(query: str) -> Iterator[str]:
    wish = _AROUND.sub("", query.strip())
    verb = next((verb for verb in _VERBS if wish.startswith(f"{verb} ")), "")
    for frame in _FRAMES:
        for other in _VERBS.get(verb, ("",)):
            yield frame.format(other + wish.removeprefix(verb))
