"""Where opening parentheses are missing: before words that begin a form and stand without one."""

from __future__ import annotations

from collections.abc import Sequence

from bddl.libero import REGION_ATTRIBUTES
from bddl.profiles import FORM_SHAPES, Profile
from bddl.reading.forest import Word

_TITLES = ("problem", "domain")


def unopened_forms(words: Sequence[Word], profile: Profile) -> list[int]:
    """Returns the positions of the words before which an opening parenthesis is missing.

    Connectives, predicates with their names, sections, variables with a category and numbers behind `forn` begin
    forms. Only when there are as many of them without a parenthesis as there are closing ones too many, and all
    parentheses match with those put in, do they explain the text.

    Args:
        words: The words and parentheses of a text whose parentheses do not match.
        profile: The dialect.

    Returns:
        The positions in order, or nothing when such words do not explain the text.
    """
    surplus = sum((word.kind == "CLOSE") - (word.kind == "OPEN") for word in words)
    if surplus <= 0:
        return []
    found: list[int] = []
    for position, word in enumerate(words):
        opened = position > 0 and words[position - 1].kind == "OPEN"
        if not opened and word.kind not in ("OPEN", "CLOSE", "HYPHEN") and _begins_form(words, position, profile):
            found.append(position)
            if len(found) > surplus:
                return []
    return found if len(found) == surplus and _match(words, set(found)) else []


def _begins_form(words: Sequence[Word], position: int, profile: Profile) -> bool:
    """Decides whether a word must be the first of a form, to judge by what follows it."""
    word = words[position]
    following = words[position + 1] if position + 1 < len(words) else None
    if following is None:
        return False
    if word.kind == "SECTION":
        attributes = REGION_ATTRIBUTES if ":regions" in profile.sections else ()
        return word.key in (*profile.sections, *profile.ignored_sections, *attributes)
    before = words[position - 1] if position else None
    if word.kind == "VARIABLE":
        return following.kind == "HYPHEN"
    if word.key in profile.predicates:
        return _has_its_names(words, position, profile.predicates[word.key].arity)
    if before is not None and "(N)" in FORM_SHAPES.get(before.key, ""):
        return word.text.isdecimal() and following.kind == "CLOSE"
    if word.key in profile.forms:
        bare = following.kind != "OPEN" and _begins_form(words, position + 1, profile)
        return following.kind == "OPEN" or bare or (following.kind == "CLOSE" and word.key in ("and", "or"))
    if word.key in _TITLES:
        return before is not None and before.key == "define"
    return word.key == "define" and position == 0


def _has_its_names(words: Sequence[Word], position: int, arity: int) -> bool:
    """Decides whether a predicate is followed by as many names as it takes, and then by a closing parenthesis."""
    names = words[position + 1 : position + 1 + arity]
    end = position + 1 + arity
    plain = len(names) == arity and all(name.kind in ("NAME", "VARIABLE") for name in names)
    return plain and end < len(words) and words[end].kind == "CLOSE"


def _match(words: Sequence[Word], opened: set[int]) -> bool:
    """Decides whether the parentheses match as one form, with some put in."""
    depth = 0
    for position, word in enumerate(words):
        depth += (position in opened) + (word.kind == "OPEN") - (word.kind == "CLOSE")
        if depth < 0 or (depth == 0 and position < len(words) - 1):
            return False
    return depth == 0
