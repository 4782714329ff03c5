"""Formulas with one literal or one name changed."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from itertools import count
from typing import NamedTuple

import bddl
from oag.model.facts import GRIPPER
from oag.model.rebuilding import rebuilt, with_operands
from oag.table.library import RESTING

_WORD = re.compile(r"[^\s()]+")


class Variant(NamedTuple):
    """A changed formula, and the change in words."""

    formula: bddl.Formula
    words: str


def renamed(formula: bddl.Formula, old: str, new: str) -> bddl.Formula:
    """Returns a formula with one name written otherwise wherever it stands; one without that name is returned as is."""
    literals = bddl.literals(formula)
    if literals is None:
        text = _WORD.sub(lambda found: new if found[0] == old else found[0], bddl.format(formula))
        return bddl.parse_formula(text)
    if not any(old in literal.atom.args for literal in literals):
        return formula
    return conjoined(
        tuple(
            _literal(
                bddl.Atom(literal.atom.predicate, tuple(new if name == old else name for name in literal.atom.args)),
                literal.value,
            )
            for literal in literals
        )
    )


def flipped(formula: bddl.Formula) -> Iterator[Variant]:
    """Yields a formula with one of its literals negated, for each of them, also below quantifiers."""
    parts = _parts(formula)
    if not parts:
        yield from _flipped_within(formula)
    for index, part in enumerate(parts):
        other = part.body if isinstance(part, bddl.Not) else bddl.Not(part)
        yield Variant(
            conjoined((*parts[:index], other, *parts[index + 1 :])), f"{bddl.format(part)} to {bddl.format(other)}"
        )


def _flipped_within(formula: bddl.Formula) -> Iterator[Variant]:
    """Yields a formula of any form with one literal negated, in the order in which they stand in its text."""
    for number in range(sum(isinstance(node, bddl.Atom) for node in formula.walk())):
        other = _with_negated_atom(formula, number)
        yield Variant(other, f"{bddl.format(formula)} to {bddl.format(other)}")


def _with_negated_atom(formula: bddl.Formula, wanted: int) -> bddl.Formula:
    """Returns a formula with one of its atoms, counted from the left, negated."""
    numbers = count()

    def rebuild(node: bddl.Formula, parts: tuple[bddl.Formula, ...]) -> bddl.Formula:
        if isinstance(node, bddl.Atom):
            return bddl.Not(node) if next(numbers) == wanted else node
        if isinstance(node, bddl.Not) and isinstance(parts[0], bddl.Not):
            return parts[0].body
        return with_operands(node, parts)

    return rebuilt(formula, rebuild)


def shortened(formula: bddl.Formula) -> Iterator[Variant]:
    """Yields a conjunction of several literals without one of them, for each of them; nothing is left of one alone."""
    parts = _parts(formula)
    for index, part in enumerate(parts if len(parts) > 1 else ()):
        yield Variant(conjoined((*parts[:index], *parts[index + 1 :])), bddl.format(part))


def respelled(formula: bddl.Formula, names: Iterable[str]) -> Iterator[Variant]:
    """Yields a conjunction of literals with one name in one place written otherwise, the first of `names` first."""
    parts = _parts(formula)
    literals = bddl.literals(formula) or ()
    for name in names:
        for index, literal in enumerate(literals):
            arguments = literal.atom.args
            for position, old in enumerate(arguments):
                if old != name and old != GRIPPER:
                    atom = bddl.Atom(literal.atom.predicate, (*arguments[:position], name, *arguments[position + 1 :]))
                    other = _literal(atom, literal.value)
                    yield Variant(
                        conjoined((*parts[:index], other, *parts[index + 1 :])),
                        f"{bddl.format(parts[index])} to {bddl.format(other)}",
                    )


def related(formula: bddl.Formula) -> Iterator[Variant]:
    """Yields a conjunction of literals with `inside` for `ontop` in one of them, or the other way round, for each.

    That a thing is not in another place says next to nothing, so literals that deny are left as they are.
    """
    parts = _parts(formula)
    for index, (atom, value) in enumerate(bddl.literals(formula) or ()):
        other = _otherwise_related(atom)
        if value and other is not None:
            yield Variant(
                conjoined((*parts[:index], other, *parts[index + 1 :])),
                f"{bddl.format(atom)} to {bddl.format(other)}",
            )


def replaced(formula: bddl.Formula, old: bddl.Atom, new: bddl.Atom) -> bddl.Formula:
    """Returns a formula with one atom written for another wherever it stands."""
    return rebuilt(formula, lambda node, parts: new if node == old else with_operands(node, parts))


def conjoined(parts: tuple[bddl.Formula, ...]) -> bddl.Formula:
    """Returns the conjunction of some formulas; of one, the formula itself."""
    return parts[0] if len(parts) == 1 else bddl.And(parts)


def _parts(formula: bddl.Formula) -> tuple[bddl.Formula, ...]:
    """Returns the literals of a conjunction, or nothing for another formula."""
    return tuple(_literal(literal.atom, literal.value) for literal in bddl.literals(formula) or ())


def _literal(atom: bddl.Atom, value: bool) -> bddl.Formula:
    """Returns an atom or its negation."""
    return atom if value else bddl.Not(atom)


def _otherwise_related(atom: bddl.Atom) -> bddl.Atom | None:
    """Returns an atom with `inside` for `ontop`, or the other way round; None for one that says no place."""
    if atom.predicate not in RESTING or atom.args[1:] == (GRIPPER,):
        return None
    (predicate,) = (relation for relation in RESTING if relation != atom.predicate)
    return bddl.Atom(predicate, atom.args)
