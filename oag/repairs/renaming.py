"""Formulas with one literal or one name changed."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from itertools import count
from typing import NamedTuple

import bddl
from oag.model.facts import GRIPPER
from oag.table.library import RESTING
from oag.task.rebuilding import rebuilt, with_operands
from oag.task.rebuilding import renamed as renamed_by


class Variant(NamedTuple):
    """A changed formula: what of it was changed, and to what; None for what was left out."""

    formula: bddl.Formula
    old: bddl.Formula
    new: bddl.Formula | None

    @property
    def denies(self) -> bool:
        """True when what was changed says that something is not so."""
        return isinstance(self.old, bddl.Not)

    @property
    def words(self) -> str:
        """The change in words."""
        return bddl.format(self.old) + ("" if self.new is None else f" to {bddl.format(self.new)}")


def renamed(formula: bddl.Formula, old: str, new: str) -> bddl.Formula:
    """Returns a formula with one name written otherwise wherever it stands."""
    return renamed_by(formula, lambda name: new if name == old else name)


def replaced(formula: bddl.Formula, old: bddl.Atom, new: bddl.Atom) -> bddl.Formula:
    """Returns a formula with one atom written for another wherever it stands."""
    return rebuilt(formula, lambda node, parts: new if node == old else with_operands(node, parts))


def flipped(formula: bddl.Formula) -> Iterator[Variant]:
    """Yields a formula with one of its literals negated, for each of them, also below quantifiers."""
    if bddl.literals(formula):
        yield from _variants(formula, lambda literal: (bddl.Literal(literal.atom, not literal.value).formula,))
        return
    for number in range(sum(isinstance(node, bddl.Atom) for node in formula.walk())):
        other = _with_negated_atom(formula, number)
        yield Variant(other, formula, other)


def shortened(formula: bddl.Formula) -> Iterator[Variant]:
    """Yields a conjunction of several literals without one of them, for each of them; nothing is left of one alone."""
    parts = _parts(formula)
    for index, part in enumerate(parts if len(parts) > 1 else ()):
        yield Variant(_conjoined((*parts[:index], *parts[index + 1 :])), part, None)


def respelled(formula: bddl.Formula, names: Iterable[str]) -> Iterator[Variant]:
    """Yields a conjunction of literals with one name in one place written otherwise, the first of `names` first."""
    for name in names:

        def otherwise(literal: bddl.Literal, name: str = name) -> Iterator[bddl.Formula]:
            arguments = literal.atom.args
            for position, old in enumerate(arguments):
                if old not in (name, GRIPPER):
                    changed = (*arguments[:position], name, *arguments[position + 1 :])
                    yield bddl.Literal(bddl.Atom(literal.atom.predicate, changed), literal.value).formula

        yield from _variants(formula, otherwise)


def related(formula: bddl.Formula) -> Iterator[Variant]:
    """Yields a conjunction of literals with `inside` for `ontop` in one of them, or the other way round, for each.

    That a thing is not in another place says next to nothing, so literals that deny are left as they are.
    """

    def otherwise(literal: bddl.Literal) -> Iterator[bddl.Formula]:
        atom, value = literal
        if value and atom.predicate in RESTING and atom.args[1:] != (GRIPPER,):
            yield from (bddl.Atom(relation, atom.args) for relation in RESTING if relation != atom.predicate)

    yield from _variants(formula, otherwise)


def _variants(formula: bddl.Formula, otherwise: Callable[[bddl.Literal], Iterable[bddl.Formula]]) -> Iterator[Variant]:
    """Yields a conjunction of literals with one of them written as each of what it can be written as."""
    parts = _parts(formula)
    for index, literal in enumerate(bddl.literals(formula) or ()):
        for other in otherwise(literal):
            yield Variant(_conjoined((*parts[:index], other, *parts[index + 1 :])), parts[index], other)


def _with_negated_atom(formula: bddl.Formula, wanted: int) -> bddl.Formula:
    numbers = count()

    def rebuild(node: bddl.Formula, parts: tuple[bddl.Formula, ...]) -> bddl.Formula:
        if isinstance(node, bddl.Atom):
            return bddl.Not(node) if next(numbers) == wanted else node
        if isinstance(node, bddl.Not) and isinstance(parts[0], bddl.Not):
            return parts[0].body
        return with_operands(node, parts)

    return rebuilt(formula, rebuild)


def _conjoined(parts: tuple[bddl.Formula, ...]) -> bddl.Formula:
    return parts[0] if len(parts) == 1 else bddl.And(parts)


def _parts(formula: bddl.Formula) -> tuple[bddl.Formula, ...]:
    """Returns the literals of a conjunction, or nothing for another formula."""
    return tuple(literal.formula for literal in bddl.literals(formula) or ())
