"""Formulas in one form: conjunctions flat, without repetition, in alphabetical order; one naming of variables.

Source: docs/canonical.md, Formulas.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import replace

import bddl
from oag.model.facts import GRIPPER
from oag.table.library import RESTING
from oag.task.rebuilding import rebuilt, with_operands

_PLAIN = re.compile(r"x\d+")


def tidy(formula: bddl.Formula) -> bddl.Formula:
    """Returns an equivalent formula whose conjunctions and disjunctions are flat, sorted and without repetition.

    Variables are named by how deep they are bound: `?x0` outermost, then `?x1`.

    Example:
        >>> import bddl
        >>> str(tidy(bddl.parse_formula("(and (open b) (and (open a) (not (not (open b)))))")))
        '(and (open a) (open b))'
    """
    return rebuilt(_with_plain_variables(formula), _tidy_node)


def conjunction(parts: Iterable[bddl.Formula]) -> bddl.Formula:
    """Returns the conjunction of tidy parts, tidy itself."""
    return _joined(bddl.And, parts)


def tidy_goal(goal: bddl.Formula, target: str) -> bddl.Formula:
    """Returns a goal tidied, but where it names several places for its target, the first one stays the first.

    Letting go puts the target at the first place that the goal names, so that order is no matter of taste.
    """
    parts = bddl.conjuncts(tidy(goal))
    atoms = [part for part in bddl.conjuncts(goal) if isinstance(part, bddl.Atom) and part.predicate in RESTING]
    places = [atom for atom in atoms if len(atom.args) == 2 and atom.args[0] == target and atom.args[1] != GRIPPER]
    if len(set(places)) < 2:
        return conjunction(parts)
    return bddl.And((places[0], *(part for part in parts if part != places[0])))


def _variables(node: object) -> tuple[str, ...]:
    return tuple(binder.variable for binder in getattr(node, "binders", ()))


def _with_plain_variables(formula: bddl.Formula) -> bddl.Formula:
    bound = {name for node in formula.walk() for name in _variables(node)}
    if not bound or any(_PLAIN.fullmatch(name) for atom in bddl.atoms(formula) for name in set(atom.args) - bound):
        return formula
    done: list[bddl.Formula] = []
    pending: list[tuple[bddl.Formula, dict[str, str], int, bool]] = [(formula, {}, 0, False)]
    while pending:
        node, scope, depth, ready = pending.pop()
        if ready:
            count = len(node.operands)
            parts = tuple(done[len(done) - count :])
            del done[len(done) - count :]
            done.append(_renamed_node(node, parts, scope))
            continue
        variables = _variables(node)
        if variables:
            scope = {**scope, **{name: f"x{depth + index}" for index, name in enumerate(variables)}}
        pending.append((node, scope, depth, True))
        below = depth + len(variables)
        pending.extend((operand, scope, below, False) for operand in reversed(node.operands))
    return done[0]


def _renamed_node(node: bddl.Formula, parts: tuple[bddl.Formula, ...], scope: dict[str, str]) -> bddl.Formula:
    """Returns a node over other operands, its variables named as a scope has it."""
    if isinstance(node, bddl.Atom):
        return bddl.Atom(node.predicate, tuple(scope.get(name, name) for name in node.args))
    if isinstance(node, bddl.ForPairs | bddl.ForNPairs):
        first, second = scope[node.variable], scope[node.other_variable]
        return replace(node, body=parts[0], variable=first, other_variable=second)
    if isinstance(node, bddl.ForAll | bddl.Exists | bddl.ForN):
        return replace(node, body=parts[0], variable=scope[node.variable])
    return with_operands(node, parts)


def _tidy_node(node: bddl.Formula, parts: tuple[bddl.Formula, ...]) -> bddl.Formula:
    if isinstance(node, bddl.And | bddl.Or):
        return _joined(type(node), parts)
    if isinstance(node, bddl.Not) and isinstance(parts[0], bddl.Not):
        return parts[0].body
    return with_operands(node, parts)


def _joined(join: type[bddl.And] | type[bddl.Or], parts: Iterable[bddl.Formula]) -> bddl.Formula:
    """Returns tidy parts joined: flat, each once, sorted by their text; one part alone is itself."""
    flat: dict[str, bddl.Formula] = {}
    for part in parts:
        for inner in part.parts if isinstance(part, join) else (part,):
            flat[str(inner)] = inner
    if len(flat) == 1:
        return next(iter(flat.values()))
    return join(tuple(flat[text] for text in sorted(flat)))
