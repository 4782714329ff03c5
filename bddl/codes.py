"""The closed list of diagnostic codes, each with the mistake it names."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Literal, TypeAlias, get_args

Code: TypeAlias = Literal[
    "bad-binder",
    "bad-init",
    "bad-name",
    "bad-objects",
    "bad-section",
    "empty-form",
    "empty-text",
    "extra-parenthesis",
    "function-notation",
    "markdown-fence",
    "missing-parenthesis",
    "missing-section",
    "no-parentheses",
    "not-a-formula",
    "not-a-name",
    "repeated-object",
    "repeated-section",
    "several-formulas",
    "text-around",
    "unbound-variable",
    "unknown-category",
    "unknown-object",
    "unknown-predicate",
    "unknown-section",
    "unsupported-form",
    "wrong-arity",
    "wrong-kind",
]

CODES: tuple[Code, ...] = get_args(Code)

MEANINGS: Mapping[Code, str] = MappingProxyType(
    {
        "bad-binder": "A quantifier does not begin with one variable and its category, such as (?x - glass).",
        "bad-init": "A section :init holds something other than literals.",
        "bad-name": "A word cannot be the name of an object, a variable or a category.",
        "bad-objects": "A section :objects has a category missing or a hyphen out of place.",
        "bad-section": "A section of a problem does not hold what it should.",
        "empty-form": "A pair of parentheses holds nothing.",
        "empty-text": "The text holds no formula at all.",
        "extra-parenthesis": "A closing parenthesis closes nothing.",
        "function-notation": "A predicate is written before its parenthesis, as in open(x).",
        "markdown-fence": "The formula is wrapped in a Markdown code fence.",
        "missing-parenthesis": "An opening parenthesis is never closed.",
        "missing-section": "A problem lacks a section that it must have.",
        "no-parentheses": "A formula is written without its parentheses.",
        "not-a-formula": "A word stands where a formula in parentheses belongs.",
        "not-a-name": "A form in parentheses stands where a name belongs.",
        "repeated-object": "An object is declared twice.",
        "repeated-section": "A problem has a section twice.",
        "several-formulas": "The text holds several formulas where one belongs.",
        "text-around": "There are words around the formula.",
        "unbound-variable": "A variable stands outside the quantifier that binds it, or no quantifier binds it.",
        "unknown-category": "No object has the category that a quantifier ranges over.",
        "unknown-object": "No object has this name.",
        "unknown-predicate": "The profile has no such predicate or connective.",
        "unknown-section": "The profile has no such section.",
        "unsupported-form": "The form exists in BDDL, but not in this profile.",
        "wrong-arity": "A predicate or connective has too few or too many arguments.",
        "wrong-kind": "The text is a problem where a formula belongs, or the other way round.",
    }
)
