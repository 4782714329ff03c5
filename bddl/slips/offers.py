"""Texts that a hint offers: whoever writes what a hint says must get something legal."""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping

from bddl.codes import Code
from bddl.diagnostics import Diagnostic
from bddl.profiles import Profile
from bddl.reading.text import read_text

_NAME = re.compile(r"\w")
# Mistakes in words, which a piece of a text may share with the text: each has a hint of its own.
_OF_WORDS: frozenset[Code] = frozenset(
    {"unknown-category", "unknown-object", "unknown-predicate", "unknown-room", "wrong-arity"}
)
# Mistakes about the text as a whole: what their hints offer stands for all of it.
_WHOLE: frozenset[Code] = frozenset(
    {
        "extra-parenthesis",
        "function-notation",
        "markdown-fence",
        "missing-parenthesis",
        "no-parentheses",
        "several-formulas",
        "text-around",
    }
)


def concerns_whole(found: Diagnostic) -> bool:
    """Decides whether what a hint offers would stand for the whole text."""
    return found.code in _WHOLE


def is_legal_offer(
    found: Diagnostic,
    known: Collection[tuple[Code, str]],
    profile: Profile,
    objects: Mapping[str, str] | None,
) -> bool:
    """Decides whether a hint offers no form, or one that may be written as it is.

    Args:
        found: The mistake with its hint.
        known: Code and message of every mistake in the text: a piece may have others of them, a whole text none.
        profile: The dialect.
        objects: Category of each object of the scene, or None.
    """
    if found.replacement is None or not found.replacement.text.startswith(("(", "[")):
        return True
    text, whole = found.replacement.text, concerns_whole(found)
    reporter = read_text(text, "any", profile, objects).reporter
    wrong = [item for item in reporter.diagnostics if item.severity == "error"]
    if whole:
        return not wrong
    # A piece of a text may use the variables and the sections around it.
    own = (found.code, found.message)
    return all(
        item.code == "unbound-variable"
        or (item.code in _OF_WORDS and (item.code, item.message) in known and (item.code, item.message) != own)
        for item in wrong
    )


def humble_hint(found: Diagnostic, text: str) -> str:
    """Returns what to say where the form that a hint would offer is not legal either."""
    if found.code == "missing-parenthesis":
        opening = found.expected == ("(",)
        if not _NAME.search(text):
            return "write a formula such as (open refrigerator_0)"
        return "add ( here" if opening else "add ) here"
    if found.code == "wrong-arity" and found.expected:
        return f"write {found.expected[0]}"
    return _HUMBLE.get(found.code, "")


_HUMBLE: Mapping[Code, str] = {
    "extra-parenthesis": "remove it",
    "function-notation": "write (NAME ARGUMENT ...)",
    "markdown-fence": "give the BDDL text alone; a comment begins with ;",
    "no-parentheses": "write a formula such as (open refrigerator_0)",
    "not-a-name": "join formulas with (and ...)",
    "several-formulas": "join them with (and ...)",
    "text-around": "give the BDDL text alone; a comment begins with ;",
}
