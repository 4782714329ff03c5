"""Questions about the shape of a formula: its conjuncts, its atoms, its literals."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

from bddl.syntax.tree import And, Atom, Formula, Imply, Not


class Literal(NamedTuple):
    """An atom with the value it must have.

    Attributes:
        atom: The atom.
        value: True for the atom itself, False for its negation.
    """

    atom: Atom
    value: bool

    @property
    def formula(self) -> Formula:
        """The literal as a formula."""
        return self.atom if self.value else Not(self.atom)

    def __str__(self) -> str:
        return str(self.formula)


def conjuncts(formula: Formula) -> tuple[Formula, ...]:
    """Returns the parts of a conjunction, nested conjunctions opened, in order; any other formula alone.

    Example:
        >>> import bddl
        >>> [str(part) for part in bddl.conjuncts(bddl.parse_formula("(and (open a) (and (open b) (open c)))"))]
        ['(open a)', '(open b)', '(open c)']
    """
    found: list[Formula] = []
    pending = [formula]
    while pending:
        node = pending.pop()
        if isinstance(node, And):
            pending.extend(reversed(node.parts))
        else:
            found.append(node)
    return tuple(found)


def atoms(formula: Formula) -> frozenset[Atom]:
    """Returns every atom that occurs in the formula; under a quantifier, with the variable as it is written."""
    return frozenset(node for node in formula.walk() if isinstance(node, Atom))


def affirmed(formula: Formula) -> Iterator[Atom]:
    """Yield the atoms that are not negated: those under an even number of negations."""
    pending: list[tuple[Formula, bool]] = [(formula, True)]
    while pending:
        node, value = pending.pop()
        if isinstance(node, Atom) and value:
            yield node
        flips = isinstance(node, Not)
        pending.extend((operand, value != flips) for operand in reversed(node.operands))
        if isinstance(node, Imply):
            pending[-1] = (node.left, not value)


def literals(formula: Formula) -> tuple[Literal, ...] | None:
    """Returns the literals of a conjunction of literals, in order, or None when the formula is no such conjunction.

    A doubled negation counts as none, so `(not (not (open a)))` is the literal `(open a)`.
    """
    if isinstance(formula, Atom):
        return (Literal(formula, True),)
    if isinstance(formula, Not) and isinstance(formula.body, Atom):
        return (Literal(formula.body, False),)
    found: list[Literal] = []
    for part in conjuncts(formula):
        value, core = True, part
        while isinstance(core, Not):
            value, core = not value, core.body
        if not isinstance(core, Atom):
            return None
        found.append(Literal(core, value))
    return tuple(found)
