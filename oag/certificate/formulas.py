"""Formulas of certificates, read from the text that the language prints: at any depth, and nothing else.

Part of the independent check: it knows the language (`bddl`), and nothing of its parser.

Source: docs/bddl.md.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

import bddl

_WORDS = re.compile(r"[()]|[^\s()]+")
_CONNECTIVES: dict[str, Any] = {"not": bddl.Not, "imply": bddl.Imply}
_QUANTIFIERS: dict[str, Any] = {
    "forall": bddl.ForAll,
    "exists": bddl.Exists,
    "forn": bddl.ForN,
    "forpairs": bddl.ForPairs,
    "fornpairs": bddl.ForNPairs,
}


def read_formula(text: str, predicates: Mapping[str, bddl.PredicateSpec] = bddl.PREDICATES) -> bddl.Formula:
    """Return the formula of a text of any depth, in the predicates of a domain.

    Raises:
        ValueError: The text is not the printed form of any formula.

    Example:
        >>> read_formula("(exists (?x - cup) (not (inside ?x box_0)))")
        <Exists (exists (?x - cup) (not (inside ?x box_0)))>
    """
    words = _WORDS.findall(text)
    open_forms: list[list[Any]] = [[]]
    try:
        for word in words:
            if word == "(":
                open_forms.append([])
            elif word == ")":
                form = open_forms.pop()
                open_forms[-1].append(_built(form, predicates))
            else:
                open_forms[-1].append(word)
        ((formula,),) = open_forms
    except (ValueError, TypeError, IndexError, AttributeError):
        formula = None
    if not isinstance(formula, bddl.Formula) or _WORDS.findall(str(formula)) != words:
        raise ValueError(f"{text!r:.60} is no formula as the language prints it")
    return formula


def _built(form: list[Any], predicates: Mapping[str, bddl.PredicateSpec]) -> Any:
    """Return the formula of a form whose operands are formulas; parenthesised variables and numbers are kept."""
    word, *rest = form
    if word.startswith("?") or word.isdecimal():
        return form
    if word in ("and", "or"):
        return (bddl.And if word == "and" else bddl.Or)(tuple(rest))
    if word in _CONNECTIVES:
        return _CONNECTIVES[word](*rest)
    if word in _QUANTIFIERS:
        count = {"count": int(rest.pop(0)[0])} if word in ("forn", "fornpairs") else {}
        *binders, body = rest
        names = [name.removeprefix("?") for variable, _, category in binders for name in (variable, category)]
        return _QUANTIFIERS[word](*names, body, **count)
    spec = predicates.get(word)
    if spec is None or spec.arity != len(rest):
        raise ValueError(f"{word!r} is no predicate of {len(rest)} arguments")
    return bddl.Atom(word, tuple(name.removeprefix("?") for name in rest))
