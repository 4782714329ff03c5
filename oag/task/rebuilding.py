"""Formulas taken apart and put together again, whatever their depth."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import bddl

Rebuild = Callable[[bddl.Formula, tuple[bddl.Formula, ...]], bddl.Formula]
"""Returns what stands for a node, given what stands for its operands."""


def rebuilt(formula: bddl.Formula, rebuild: Rebuild) -> bddl.Formula:
    """Returns a formula rebuilt from its leaves upwards, whatever its depth."""
    done: list[bddl.Formula] = []
    pending: list[tuple[bddl.Formula, bool]] = [(formula, False)]
    while pending:
        node, ready = pending.pop()
        if not ready:
            pending.append((node, True))
            pending.extend((operand, False) for operand in reversed(node.operands))
            continue
        count = len(node.operands)
        parts = tuple(done[len(done) - count :])
        del done[len(done) - count :]
        done.append(rebuild(node, parts))
    return done[0]


def renamed(formula: bddl.Formula, resolve: Callable[[str], str]) -> bddl.Formula:
    """Returns the formula with its objects renamed; variables that a quantifier binds are left alone."""
    bound = frozenset(binder.variable for node in formula.walk() for binder in getattr(node, "binders", ()))

    def rebuild(node: bddl.Formula, parts: tuple[bddl.Formula, ...]) -> bddl.Formula:
        if isinstance(node, bddl.Atom):
            return bddl.Atom(node.predicate, tuple(name if name in bound else resolve(name) for name in node.args))
        return with_operands(node, parts)

    return rebuilt(formula, rebuild)


def with_operands(node: bddl.Formula, parts: tuple[bddl.Formula, ...]) -> bddl.Formula:
    """Returns a node of the same kind over other operands."""
    if isinstance(node, bddl.Atom):
        return node
    if isinstance(node, bddl.And | bddl.Or):
        return type(node)(parts)
    if isinstance(node, bddl.Imply):
        return bddl.Imply(*parts)
    return replace(node, body=parts[0])
