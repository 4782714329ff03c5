"""Texts that a hint offers: whoever writes what a hint says must get something legal."""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping

from bddl.codes import Code
from bddl.diagnostics import Diagnostic
from bddl.profiles import Profile
from bddl.reading.text import read_text

# A form behind these words is meant to be written as it is; a shape such as (not FORMULA) has words in capitals.
_OFFER = re.compile(r"(?:give the formula alone: |remove the outer parentheses: |(?:.*, )?write )([(\[].*)", re.DOTALL)
_SHAPE = re.compile(r"(?<![\w.?])[A-Z_]{2,}(?![\w.])|\bN\b|\.\.\.|\): ")
_NAME = re.compile(r"\w")
# Sections are no texts of their own, and are offered as examples.
_SECTIONS = ("(:", "(problem ")
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
    offer = _OFFER.fullmatch(found.hint)
    if offer is None or _SHAPE.search(found.hint) or offer.group(1).startswith(_SECTIONS):
        return True
    text, alternative, _ = offer.group(1).partition("), or ")
    text += ")" if alternative else ""
    whole = concerns_whole(found)
    if whole and text.startswith("(") and ")" not in text:
        # Not a form, but where one begins.
        return True
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


def humble_hint(found: Diagnostic) -> str:
    """Returns what to say where the form that a hint would offer is not legal either."""
    if found.code == "missing-parenthesis":
        opening = found.expected == ("(",)
        if not _NAME.search(found.excerpt.partition("|")[2].partition("\n")[0]):
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
