"""Rewriting of formulas: rebuild of any depth, variants with one literal or name changed, and a normal form.

In the normal form conjunctions are flat, sorted and without repetition, and variables are named by depth.

Source: docs/semantics.md, Canonical form.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from itertools import count
from typing import NamedTuple

import bddl
from oag.model.symbols import GRIPPER
from oag.primitives.cargo import RESTING

Rebuild = Callable[[bddl.Formula, tuple[bddl.Formula, ...]], bddl.Formula]
"""Returns the replacement of a node, given the replacements of its operands."""


def rebuild_formula(formula: bddl.Formula, rebuild: Rebuild) -> bddl.Formula:
    """Return a formula rebuilt from its leaves upwards, for any depth."""
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


def rename_objects(formula: bddl.Formula, resolve: Callable[[str], str]) -> bddl.Formula:
    """Return the formula with its objects renamed; variables bound by a quantifier are kept."""
    bound = frozenset(binder.variable for node in formula.walk() for binder in getattr(node, "binders", ()))

    def rebuild(node: bddl.Formula, parts: tuple[bddl.Formula, ...]) -> bddl.Formula:
        if isinstance(node, bddl.Atom):
            return bddl.Atom(node.predicate, tuple(name if name in bound else resolve(name) for name in node.args))
        return with_operands(node, parts)

    return rebuild_formula(formula, rebuild)


def with_operands(node: bddl.Formula, parts: tuple[bddl.Formula, ...]) -> bddl.Formula:
    """Return a node of the same kind over other operands."""
    if isinstance(node, bddl.Atom):
        return node
    if isinstance(node, bddl.And | bddl.Or):
        return type(node)(parts)
    if isinstance(node, bddl.Imply):
        return bddl.Imply(*parts)
    return replace(node, body=parts[0])


class Variant(NamedTuple):
    """A changed formula: what was changed, and to what; None for a part that was left out."""

    formula: bddl.Formula
    old: bddl.Formula
    new: bddl.Formula | None

    @property
    def denies(self) -> bool:
        """True when the changed part is a negation."""
        return isinstance(self.old, bddl.Not)

    @property
    def words(self) -> str:
        """The change in words."""
        return bddl.format(self.old) + ("" if self.new is None else f" to {bddl.format(self.new)}")


def rename_object(formula: bddl.Formula, old: str, new: str) -> bddl.Formula:
    """Return a formula with one name replaced wherever it stands."""
    return rename_objects(formula, lambda name: new if name == old else name)


def replace_atom(formula: bddl.Formula, old: bddl.Atom, new: bddl.Atom) -> bddl.Formula:
    """Return a formula with one atom replaced wherever it stands."""
    return rebuild_formula(formula, lambda node, parts: new if node == old else with_operands(node, parts))


def negated_variants(formula: bddl.Formula) -> Iterator[Variant]:
    """Yield a formula with one of its literals negated, for each of them, also below quantifiers."""
    if bddl.literals(formula):
        yield from _variants(formula, lambda literal: (bddl.Literal(literal.atom, not literal.value).formula,))
        return
    for number in range(sum(isinstance(node, bddl.Atom) for node in formula.walk())):
        other = _with_negated_atom(formula, number)
        yield Variant(other, formula, other)


def shortened_variants(formula: bddl.Formula) -> Iterator[Variant]:
    """Yield a conjunction of several literals without one of them, for each; a single literal has no variant."""
    parts = _parts(formula)
    for index, part in enumerate(parts if len(parts) > 1 else ()):
        yield Variant(_conjoined((*parts[:index], *parts[index + 1 :])), part, None)


def renamed_variants(formula: bddl.Formula, names: Iterable[str]) -> Iterator[Variant]:
    """Yield a conjunction of literals with one name in one place replaced, the first of `names` first."""
    for name in names:

        def otherwise(literal: bddl.Literal, name: str = name) -> Iterator[bddl.Formula]:
            arguments = literal.atom.args
            for position, old in enumerate(arguments):
                if old not in (name, GRIPPER):
                    changed = (*arguments[:position], name, *arguments[position + 1 :])
                    yield bddl.Literal(bddl.Atom(literal.atom.predicate, changed), literal.value).formula

        yield from _variants(formula, otherwise)


def relation_variants(formula: bddl.Formula) -> Iterator[Variant]:
    """Yield a conjunction of literals with `inside` for `ontop` in one of them, or the reverse, for each.

    Negative literals stay as they are: that an object is not in another place has nearly no content.
    """

    def otherwise(literal: bddl.Literal) -> Iterator[bddl.Formula]:
        atom, value = literal
        if value and atom.predicate in RESTING and atom.args[1:] != (GRIPPER,):
            yield from (bddl.Atom(relation, atom.args) for relation in RESTING if relation != atom.predicate)

    yield from _variants(formula, otherwise)


def _variants(formula: bddl.Formula, otherwise: Callable[[bddl.Literal], Iterable[bddl.Formula]]) -> Iterator[Variant]:
    """Yield a conjunction of literals with one of them replaced by each alternative."""
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

    return rebuild_formula(formula, rebuild)


def _conjoined(parts: tuple[bddl.Formula, ...]) -> bddl.Formula:
    return parts[0] if len(parts) == 1 else bddl.And(parts)


def _parts(formula: bddl.Formula) -> tuple[bddl.Formula, ...]:
    """Return the literals of a conjunction, or nothing for another formula."""
    return tuple(literal.formula for literal in bddl.literals(formula) or ())


_PLAIN = re.compile(r"x\d+")


def normalize(formula: bddl.Formula) -> bddl.Formula:
    """Return an equivalent formula whose conjunctions and disjunctions are flat, sorted and without repetition.

    Variables are named by the depth of their binder: `?x0` outermost, then `?x1`.

    Example:
        >>> import bddl
        >>> str(normalize(bddl.parse_formula("(and (open b) (and (open a) (not (not (open b)))))")))
        '(and (open a) (open b))'
    """
    return rebuild_formula(_with_plain_variables(formula), _normalize_node)


def sorted_conjunction(parts: Iterable[bddl.Formula]) -> bddl.Formula:
    """Return the normalised conjunction of normalised parts."""
    return _joined(bddl.And, parts)


def normalize_goal(goal: bddl.Formula, target: str) -> bddl.Formula:
    """Return a normalised goal; of several places for its target, the first one stays first.

    UNGRASP puts the target at the first place that the goal names, so that this order matters.
    """
    parts = bddl.conjuncts(normalize(goal))
    atoms = [part for part in bddl.conjuncts(goal) if isinstance(part, bddl.Atom) and part.predicate in RESTING]
    places = [atom for atom in atoms if len(atom.args) == 2 and atom.args[0] == target and atom.args[1] != GRIPPER]
    if len(set(places)) < 2:
        return sorted_conjunction(parts)
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
    """Return a node over other operands, with its variables named by a scope."""
    if isinstance(node, bddl.Atom):
        return bddl.Atom(node.predicate, tuple(scope.get(name, name) for name in node.args))
    if isinstance(node, bddl.ForPairs | bddl.ForNPairs):
        first, second = scope[node.variable], scope[node.other_variable]
        return replace(node, body=parts[0], variable=first, other_variable=second)
    if isinstance(node, bddl.ForAll | bddl.Exists | bddl.ForN):
        return replace(node, body=parts[0], variable=scope[node.variable])
    return with_operands(node, parts)


def _normalize_node(node: bddl.Formula, parts: tuple[bddl.Formula, ...]) -> bddl.Formula:
    if isinstance(node, bddl.And | bddl.Or):
        return _joined(type(node), parts)
    if isinstance(node, bddl.Not) and isinstance(parts[0], bddl.Not):
        return parts[0].body
    return with_operands(node, parts)


def _joined(join: type[bddl.And] | type[bddl.Or], parts: Iterable[bddl.Formula]) -> bddl.Formula:
    """Return normalised parts joined: flat, each once, sorted by text; a single part is itself."""
    flat: dict[str, bddl.Formula] = {}
    for part in parts:
        for inner in part.parts if isinstance(part, join) else (part,):
            flat[str(inner)] = inner
    if len(flat) == 1:
        return next(iter(flat.values()))
    return join(tuple(flat[text] for text in sorted(flat)))
