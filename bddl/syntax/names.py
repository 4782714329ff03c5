"""Which legal names a misspelt or foreign name may have meant."""

from __future__ import annotations

import re
from collections.abc import Iterable

from bddl.syntax.vocabulary import ABSENT_CONNECTIVES, FORM_SYNONYMS, NOUN_GROUPS, PREDICATES

_INDEX = re.compile(r"(?:_|-|\.)?\d+$")
_DENIAL = re.compile(r"(?:is_?not|isn_?t|not|non|no)[_\-](?P<word>.+)")
_MOST = 3
# The word of the language that another word means.
SYNONYM_OF = {synonym: spec.name for spec in PREDICATES.values() for synonym in spec.synonyms} | dict(FORM_SYNONYMS)


def near_names(name: str, legal: Iterable[str]) -> tuple[str, ...]:
    """Returns up to three legal names that the given one may have meant, the likeliest first.

    A synonym comes before the same noun with another number, that before another noun for the same kind of thing,
    that before a spelling slip of one or two letters (one in a short name). Letter case is ignored.

    Args:
        name: The name that was not found.
        legal: The names that would have been legal.

    Returns:
        The near names, likeliest first; empty when none is near.

    Example:
        >>> near_names("on", PREDICATES)
        ('ontop',)
        >>> near_names("fridge_0", ["table_0", "refrigerator_0"])
        ('refrigerator_0',)
    """
    wanted = name.casefold()
    ranked = []
    denied = denied_word(wanted)
    for option in dict.fromkeys(legal):
        rank = _rank(wanted, option.casefold())
        # A word that says the contrary is not near, however alike the letters are.
        contrary = wanted in ABSENT_CONNECTIVES or denied_word(option.casefold()) != denied
        if rank is not None and option != name and (rank[0] < 2 or not contrary):
            ranked.append((rank, option))
    ranked.sort()
    return tuple(option for _, option in ranked[:_MOST])


def denied_word(name: str) -> str:
    """Returns the word that a name such as `not_open` denies, or "" when it denies none.

    Example:
        >>> denied_word("not_open"), denied_word("notebook")
        ('open', '')
    """
    found = _DENIAL.fullmatch(name)
    return found["word"] if found is not None else ""


def _rank(wanted: str, option: str) -> tuple[int, int] | None:
    """Returns how far the option is from the wanted name (smaller is nearer), or None when it is not near."""
    if wanted == option or SYNONYM_OF.get(wanted) == option:
        return (0, 0)
    wanted_stem, option_stem = _INDEX.sub("", wanted), _INDEX.sub("", option)
    same_index = 0 if wanted.removeprefix(wanted_stem) == option.removeprefix(option_stem) else 1
    if wanted_stem and _squeeze(wanted_stem) == _squeeze(option_stem):
        return (1, same_index)
    if any(wanted_stem in group and option_stem in group for group in NOUN_GROUPS):
        return (2, same_index)
    longest = max(len(wanted_stem), len(option_stem))
    allowed = 0 if longest < 3 else 1 if longest < 6 else 2
    slips = edit_distance(wanted_stem, option_stem, at_most=allowed)
    if slips is not None and slips > 0:
        return (2 + slips, same_index)
    parts = set(wanted_stem.split("_")) & set(option_stem.split("_"))
    if any(len(part) > 2 for part in parts):
        return (5, same_index)
    if min(len(wanted_stem), len(option_stem)) >= 4 and (wanted_stem in option_stem or option_stem in wanted_stem):
        return (6, same_index)
    return None


def _squeeze(stem: str) -> str:
    return stem.replace("_", "").replace("-", "")


def edit_distance(left: str, right: str, at_most: int) -> int | None:
    """Returns how many letters to insert, delete, replace or swap with a neighbour, or None when more than allowed."""
    if abs(len(left) - len(right)) > at_most:
        return None
    before: list[int] = []
    above = list(range(len(right) + 1))
    for row, letter in enumerate(left, start=1):
        current = [row]
        for column, other in enumerate(right, start=1):
            cost = min(above[column] + 1, current[-1] + 1, above[column - 1] + (letter != other))
            if row > 1 and column > 1 and letter == right[column - 2] and left[row - 2] == other:
                cost = min(cost, before[column - 2] + 1)
            current.append(cost)
        if min(current) > at_most:
            return None
        before, above = above, current
    return above[-1] if above[-1] <= at_most else None
