"""The conditions of a certificate: lists of literals, or formulas as the language prints them.

Part of the independent check: it reads formulas by a reader of its own, strictly. What it has read, printed again, has
to be the text, word by word.

Source: docs/semantics.md, Certificates; docs/bddl.md has the forms.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

import bddl
from bddl.semantics.members import spelled_out
from oag.checker.cases import Rejected, require
from oag.model.facts import ANY, ROBOT_FACTS, condition_on
from oag.table.library import Clause, Needed, needed

# Parts that the formulas of a plan may have, with every quantifier spelled out over the objects.
MOST_PARTS = 20_000

_WORDS = re.compile(r"[()]|[^\s()]+")
_CONNECTIVES: dict[str, Any] = {"not": bddl.Not, "imply": bddl.Imply}
_QUANTIFIERS: dict[str, Any] = {
    "forall": bddl.ForAll,
    "exists": bddl.Exists,
    "forn": bddl.ForN,
    "forpairs": bddl.ForPairs,
    "fornpairs": bddl.ForNPairs,
}


def needed_of(condition: Any) -> Needed:
    """Returns the clauses of a list of [atom, value], or the formula that a text says.

    Raises:
        Rejected: It speaks of a pattern, or of a variable of the robot as if it were an atom.
    """
    if isinstance(condition, str):
        formula = read_formula(condition)
        require(all((atom.predicate, *atom.args) not in ROBOT_FACTS for atom in bddl.atoms(formula)), "no formula")
        return needed(formula)
    clauses: list[Clause] = []
    for names, value in condition:
        fact = tuple(names)
        # The robot's variables alone are about nothing.
        if type(value) is not bool or len(fact) < 2 or ANY in "".join(fact):
            raise Rejected(f"{names} is no literal")
        clauses.append((condition_on(fact, value),))
    return tuple(clauses)


def check_size(plan: Mapping[str, Any], objects: Mapping[str, str]) -> None:
    """Checks that what the plan's formulas say of the objects, all together, is not too much to be evaluated."""
    left = MOST_PARTS
    for condition in (plan["goal"], *(s[field] for s in plan["subtasks"] for field in ("init", "goal"))):
        # Without a variable there is no quantifier.
        if isinstance(condition, str) and "?" in condition:
            left -= spelled_out(read_formula(condition), objects, left)
            require(left >= 0, f"its quantifiers say more than {MOST_PARTS} things of the objects")


def read_formula(text: str) -> bddl.Formula:
    """Returns the formula that a text says, whatever its depth.

    Raises:
        ValueError: The text is not what the language prints for any formula.

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
                open_forms[-1].append(_built(form))
            else:
                open_forms[-1].append(word)
        ((formula,),) = open_forms
    except (ValueError, TypeError, IndexError, AttributeError):
        formula = None
    if not isinstance(formula, bddl.Formula) or _WORDS.findall(str(formula)) != words:
        raise ValueError(f"{text!r:.60} is no formula as the language prints it")
    return formula


def _built(form: list[Any]) -> Any:
    """Returns the formula of a form whose operands are formulas; a variable or a number in parentheses as it is."""
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
    spec = bddl.PREDICATES.get(word)
    if spec is None or spec.arity != len(rest):
        raise ValueError(f"{word!r} is no predicate of {len(rest)} arguments")
    return bddl.Atom(word, tuple(name.removeprefix("?") for name in rest))
