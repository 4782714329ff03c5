"""The closed list of diagnostic codes, each with the mistake it names."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Literal, TypeAlias, get_args

Code: TypeAlias = Literal[
    "bad-binder", "bad-count", "bad-init", "bad-name", "bad-objects", "bad-predicate", "bad-section",
    "bad-wildcard", "contradictory-init", "counted-wildcard", "described-future", "empty-form", "empty-range",
    "empty-text", "extra-parenthesis", "function-notation", "future-without-real", "goal-holds-at-start",
    "idle-real", "impossible-goal", "markdown-fence", "misplaced-predicate", "missing-parenthesis",
    "missing-section", "mixed-instance", "negative-kinematics", "no-parentheses", "not-a-formula", "not-a-name",
    "other-profile", "reflexive-atom", "repeated-category", "repeated-literal", "repeated-object",
    "repeated-predicate", "repeated-section", "several-formulas", "shadowed-variable", "swapped-roles",
    "text-around", "unbound-variable", "unchecked-goal", "unknown-category", "unknown-domain", "unknown-object",
    "unknown-predicate", "unknown-requirement", "unknown-room", "unknown-section", "unmentioned-object",
    "unsupported-form", "unused-variable", "wrong-arity", "wrong-category", "wrong-kind",
]  # fmt: skip

CODES: tuple[Code, ...] = get_args(Code)

MEANINGS: Mapping[Code, str] = MappingProxyType(
    {
        "bad-binder": "A quantifier does not begin with one variable and its category, such as (?x - glass).",
        "bad-count": "A quantifier with a number does not begin with one whole number in parentheses, such as (2).",
        "bad-init": "A section :init holds something other than literals.",
        "bad-name": "A word cannot be the name of an object, a variable or a category.",
        "bad-objects": "A section :objects has a category missing or a hyphen out of place.",
        "bad-predicate": "A domain declares something that is no predicate with parameters.",
        "bad-section": "A section of a problem does not hold what it should.",
        "bad-wildcard": "A wildcard, such as sink.n.01_*, is not the last of its line or stands outside (inroom ...).",
        "contradictory-init": "The section :init both affirms and denies an atom.",
        "counted-wildcard": "A quantifier ranges over a wildcard, which is counted as one object.",
        "described-future": "The section :init says where, or how, an object is that does not exist at the start.",
        "empty-form": "A pair of parentheses holds nothing.",
        "empty-range": "A quantifier ranges over no object, or over pairs of a single one.",
        "empty-text": "The text holds no formula at all.",
        "extra-parenthesis": "A parenthesis is too many: it closes nothing, or opens nothing.",
        "function-notation": "A predicate is written before its parenthesis, as in open(x).",
        "future-without-real": "An object that does not exist at the start is not asked for by the goal.",
        "goal-holds-at-start": "The goal holds before anything is done.",
        "idle-real": "The goal asks that an object exist which exists from the start.",
        "impossible-goal": "No state satisfies the goal.",
        "markdown-fence": "The formula is wrapped in a Markdown code fence.",
        "misplaced-predicate": "A predicate stands in a section that it does not belong in.",
        "missing-parenthesis": "A parenthesis is missing: a form is never closed, or never opened.",
        "missing-section": "A problem lacks a section that it must have.",
        "mixed-instance": "The body of a quantifier names an object that the variable ranges over.",
        "negative-kinematics": "The section :init denies how things lie to each other.",
        "no-parentheses": "A formula is written without its parentheses.",
        "not-a-formula": "A word stands where a formula in parentheses belongs.",
        "not-a-name": "A form in parentheses stands where a name belongs.",
        "other-profile": "The text is written in another profile than the one it was read in.",
        "reflexive-atom": "An atom relates an object to itself.",
        "repeated-category": "The section :objects has two lines for one category.",
        "repeated-literal": "The section :init says a literal twice.",
        "repeated-object": "An object is declared twice.",
        "repeated-predicate": "A domain declares a predicate twice.",
        "repeated-section": "A problem has a section twice.",
        "several-formulas": "The text holds several formulas where one belongs.",
        "shadowed-variable": "A variable hides an outer variable, or an object, of the same name.",
        "swapped-roles": "The arguments of an atom seem to stand in the wrong order.",
        "text-around": "There are words around the formula.",
        "unbound-variable": "A variable stands outside the quantifier that binds it, or no quantifier binds it.",
        "unchecked-goal": "Whether the goal holds at the start, or whether some state satisfies it, was not examined.",
        "unknown-category": "No object has the category that a quantifier ranges over.",
        "unknown-domain": "The profile has no such domain, or the problem belongs to another one than was given.",
        "unknown-object": "No object has this name.",
        "unknown-predicate": "The profile has no such predicate or connective.",
        "unknown-requirement": "A domain requires something that the language does not know.",
        "unknown-room": "There is no such type of room.",
        "unknown-section": "The profile has no such section.",
        "unmentioned-object": "The goal is about an object of which :init says nothing.",
        "unsupported-form": "The form exists in BDDL, but not in this profile.",
        "unused-variable": "The body of a quantifier never names its variable.",
        "wrong-arity": "A predicate or connective has too few or too many arguments.",
        "wrong-category": "An object is not named after the category that it is declared with.",
        "wrong-kind": "The text is a problem where a formula belongs, or the other way round.",
    }
)

Slip: TypeAlias = Literal[
    "argument-count", "bare-words", "binder-shape", "comma", "define-missing", "ellipsis", "empty-answer",
    "equality", "extra-parenthesis", "foreign-comment", "function-notation", "goal-missing", "goal-section",
    "infix-operator", "init-connective", "invented-object", "invented-predicate", "json-text", "letter-case",
    "markdown-fence", "misspelt-section", "misspelt-word", "missing-parenthesis", "nested-atom", "no-formula",
    "object-variant", "operator-symbol", "opposite-predicate", "pddl-form", "predicate-synonym", "prose-around",
    "quoted-name", "robot-predicate", "several-goals", "stray-question-mark", "swapped-roles", "truth-constant",
    "typographic-character", "unbound-variable",
]  # fmt: skip

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
