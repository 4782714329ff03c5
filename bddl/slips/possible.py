"""Which slips a kind of mistake can be: the place alone does not tell."""

from __future__ import annotations

from collections.abc import Mapping

from bddl.codes import Code
from bddl.diagnostics import Diagnostic
from bddl.slips.catalogue import Slip

# Slips of writing, not of meaning: they can look like any mistake.
_OF_WRITING: frozenset[Slip] = frozenset(
    {
        "comma",
        "ellipsis",
        "foreign-comment",
        "function-notation",
        "infix-operator",
        "json-text",
        "markdown-fence",
        "operator-symbol",
        "prose-around",
        "quoted-name",
        "typographic-character",
    }
)
_OF_OBJECTS: frozenset[Slip] = frozenset(
    {"invented-object", "letter-case", "object-variant", "stray-question-mark", "truth-constant", "equality"}
)
_OF_PREDICATES: frozenset[Slip] = frozenset(
    {
        "equality",
        "goal-section",
        "invented-predicate",
        "misspelt-word",
        "opposite-predicate",
        "pddl-form",
        "predicate-synonym",
        "robot-predicate",
        "truth-constant",
    }
)
_OF_CODE: Mapping[Code, frozenset[Slip]] = {
    "bad-binder": frozenset({"binder-shape"}),
    "bad-init": frozenset({"init-connective", "stray-question-mark"}),
    "bad-name": frozenset({"letter-case", "stray-question-mark", "truth-constant", "equality"}),
    "bad-section": frozenset({"pddl-form", "several-goals", "bare-words"}),
    "missing-section": frozenset({"misspelt-section"}),
    "no-parentheses": frozenset({"bare-words"}),
    "not-a-formula": frozenset({"bare-words", "truth-constant", "several-goals", "binder-shape", "equality"}),
    "not-a-name": frozenset({"pddl-form", "truth-constant", "equality", "extra-parenthesis", "several-goals"}),
    "repeated-section": frozenset({"several-goals"}),
    "several-formulas": frozenset({"define-missing", "several-goals"}),
    "text-around": frozenset({"bare-words", "define-missing", "several-goals"}),
    "unbound-variable": frozenset({"binder-shape", "stray-question-mark", "unbound-variable"}),
    "unknown-object": _OF_OBJECTS,
    "unknown-predicate": _OF_PREDICATES | {"define-missing", "bare-words"},
    "unknown-section": frozenset({"goal-section", "misspelt-section", "pddl-form"}),
    "unsupported-form": frozenset({"pddl-form"}),
    "wrong-arity": frozenset({"argument-count", "bare-words", "truth-constant", "pddl-form", "several-goals"}),
    "wrong-kind": frozenset({"define-missing", "goal-section", "pddl-form"}),
}


def possible_slips(found: Diagnostic) -> frozenset[Slip]:
    """Returns the slips of which a mistake can be the trace."""
    return _OF_WRITING | _OF_CODE.get(found.code, frozenset())
