"""The slips that language models make when they write BDDL, each with a stable label."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Literal, TypeAlias

from bddl.codes import Code

Slip: TypeAlias = Literal[
    "argument-count",
    "bare-words",
    "binder-shape",
    "comma",
    "define-missing",
    "ellipsis",
    "empty-answer",
    "equality",
    "extra-parenthesis",
    "foreign-comment",
    "function-notation",
    "goal-missing",
    "goal-section",
    "infix-operator",
    "init-connective",
    "invented-object",
    "invented-predicate",
    "json-text",
    "letter-case",
    "markdown-fence",
    "misspelt-section",
    "misspelt-word",
    "missing-parenthesis",
    "nested-atom",
    "no-formula",
    "object-variant",
    "operator-symbol",
    "opposite-predicate",
    "pddl-form",
    "predicate-synonym",
    "prose-around",
    "quoted-name",
    "robot-predicate",
    "several-goals",
    "stray-question-mark",
    "swapped-roles",
    "truth-constant",
    "typographic-character",
    "unbound-variable",
]

SLIPS: Mapping[Slip, str] = MappingProxyType(
    {
        "argument-count": "A predicate or connective has too few or too many arguments.",
        "bare-words": "A formula lacks its own parentheses: (not open x).",
        "binder-shape": "The variable of a quantifier is not written as (?x - category).",
        "comma": "Commas stand between names or formulas.",
        "define-missing": "The sections of a problem stand without (define ...) around them.",
        "ellipsis": "Three dots stand for something that was not written out.",
        "empty-answer": "There is nothing.",
        "equality": "Two names are compared by =.",
        "extra-parenthesis": "There is a parenthesis too many.",
        "foreign-comment": "A comment begins with # or // instead of ;.",
        "function-notation": "A predicate stands before its parenthesis: open(x).",
        "goal-missing": "A problem has no goal.",
        "goal-section": "A section of a problem stands where a formula belongs: (:goal (open x)).",
        "infix-operator": "An operator stands between its operands: (a) and (b).",
        "init-connective": "The literals of :init are joined by (and ...).",
        "invented-object": "An object is named that nobody mentioned.",
        "invented-predicate": "A predicate is used that does not exist.",
        "json-text": "The formula is written as JSON, or with the escapes of a JSON string.",
        "letter-case": "The name of an object is written in another letter case.",
        "markdown-fence": "The formula is wrapped in a Markdown code fence or in backticks.",
        "misspelt-section": "The name of a section is misspelt.",
        "misspelt-word": "A predicate or connective is misspelt.",
        "missing-parenthesis": "A parenthesis is missing.",
        "nested-atom": "A formula stands where the name of an object belongs.",
        "no-formula": "The answer is prose and holds no formula.",
        "object-variant": "An object is named by another word or number than its own: fridge_0 for refrigerator_0.",
        "operator-symbol": "A connective is written as a symbol: !(open x).",
        "opposite-predicate": "A predicate is used for the opposite of one that exists: (closed x).",
        "pddl-form": "A form of PDDL is used that BDDL lacks, such as :precondition, when or increase.",
        "predicate-synonym": "Another word is used for a predicate: on for ontop.",
        "prose-around": "There is prose around the formula.",
        "quoted-name": "Names stand in quotation marks.",
        "robot-predicate": "Holding is a predicate of its own instead of (inside x gripper).",
        "several-goals": "Several formulas stand where one belongs.",
        "stray-question-mark": "The name of an object is marked as a variable: ?glass_0.",
        "swapped-roles": "The arguments of a predicate stand in the wrong order.",
        "truth-constant": "A truth value is written as an argument: (open x true).",
        "typographic-character": "There are typographic quotes, dashes or parentheses.",
        "unbound-variable": "A variable is used that no quantifier binds.",
    }
)

# Where the text around a mistake tells nothing more, the kind of mistake decides.
SLIP_OF_CODE: Mapping[Code, Slip] = MappingProxyType(
    {
        "bad-binder": "binder-shape",
        "empty-text": "empty-answer",
        "extra-parenthesis": "extra-parenthesis",
        "function-notation": "function-notation",
        "markdown-fence": "markdown-fence",
        "missing-parenthesis": "missing-parenthesis",
        "no-parentheses": "bare-words",
        "not-a-formula": "bare-words",
        "not-a-name": "nested-atom",
        "several-formulas": "several-goals",
        "swapped-roles": "swapped-roles",
        "text-around": "prose-around",
        "unbound-variable": "unbound-variable",
        "unknown-object": "invented-object",
        "unknown-predicate": "invented-predicate",
        "unknown-section": "misspelt-section",
        "wrong-arity": "argument-count",
    }
)
