"""Truth of a formula in a state that may be known only in part (strong Kleene logic)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import repeat
from typing import NamedTuple, TypeAlias

from bddl.semantics.ground import PairSemantics, check_pair_semantics
from bddl.semantics.kleene import (
    FALSE,
    TRUE,
    UNKNOWN,
    CellTable,
    Conjunction,
    Counting,
    Disjunction,
    Form,
    Negated,
    Value,
    truth,
)
from bddl.semantics.members import Members, smaller_side
from bddl.semantics.states import Lookup, State, lookup, lookup_in_both, truth_value
from bddl.syntax import And, Atom, Exists, ForAll, Formula, ForN, ForPairs, Imply, Not, Or
from bddl.syntax.problem import Objects

# Bindings form a linked list, innermost first: (variable, object, outer bindings).
_Bindings: TypeAlias = "tuple[str, str, _Bindings] | None"
_Operand: TypeAlias = tuple[Formula, _Bindings]


def evaluate(
    formula: Formula, state: State, objects: Objects | None = None, *, pairs: PairSemantics = "matching"
) -> bool | None:
    """Decides whether a formula holds in a state, as far as the state is known.

    An unknown atom leaves the formula unknown unless the known ones decide it. Operands are evaluated from left to
    right, and evaluation stops as soon as the value is decided; the table of a `forpairs` is read in full. A
    quantifier over a category without objects is vacuous: `forall` and `forpairs` are true, `exists` is false.

    Args:
        formula: Any formula, of any depth.
        state: What is known: a mapping in which an absent atom is unknown, or a function that returns None for
            unknown. The keys are atoms, or tuples such as `("open", "fridge_0")`, or some of each.
        objects: Category of each object, or the declared objects of a problem; needed for quantifiers. The category
            `object` holds all of them.
        pairs: `matching` reads `forpairs` and `fornpairs` as a choice of disjoint pairs; `reference` counts rows and
            columns with a true cell, as the reference implementation does.

    Returns:
        True or False when every completion of the state agrees on that by Kleene's tables; None when unknown.

    Raises:
        ObjectsRequired: A quantifier was met and `objects` is None.
        UnknownPairSemantics: `pairs` is neither of the two.
        TypeError: The formula, the state, the objects or the value of an atom is nothing of the kind.

    Source: docs/bddl.md, Truth; the reference implementation is two-valued and does not stop early.

    Example:
        >>> import bddl
        >>> goal = bddl.parse_formula("(or (open refrigerator_0) (inside glass_0 refrigerator_0))")
        >>> bddl.evaluate(goal, {bddl.Atom("open", ("refrigerator_0",)): True})
        True
        >>> bddl.evaluate(goal, {}) is None
        True
    """
    if pairs != "matching":
        check_pair_semantics(pairs)
    value = truth(_value(formula, lookup(state), objects, pairs))
    if value is None and isinstance(state, Mapping):
        # Looked at only when nothing was known: that spares most calls the question.
        both = lookup_in_both(state)
        if both is not None:
            return truth(_value(formula, both, objects, pairs))
    return value


class _Waiting(NamedTuple):
    """A form that waits for its operands."""

    form: Form
    operands: Iterator[_Operand]


def _value(formula: Formula, known: Lookup, objects: Objects | None, pairs: PairSemantics) -> Value:
    """Returns the value of a formula in one state; operands are asked for from left to right, as far as needed."""
    members = Members(objects)
    frames: list[_Waiting] = []
    entering: _Operand | None = (formula, None)
    while entering is not None:
        node, bindings = entering
        if isinstance(node, Atom):
            value = _atom_value(known(node if bindings is None else _ground(node, bindings)))
        else:
            frame = _open(node, bindings, members, pairs)
            entering = next(frame.operands, None)
            if entering is not None:
                frames.append(frame)
                continue
            value = frame.form.result()
        entering = None
        while frames and entering is None:
            form, operands = frames[-1]
            if not form.take(value):
                entering = next(operands, None)
            if entering is None:
                value = frames.pop().form.result()
    return value


def _atom_value(found: object) -> Value:
    """Returns what a state says of an atom; a caller's function may return anything."""
    if found is None:
        return UNKNOWN
    return TRUE if found is True or (found is not False and truth_value(found)) else FALSE


def _open(node: Formula, bindings: _Bindings, members: Members, pairs: PairSemantics) -> _Waiting:
    """Returns a form that is no atom, ready to take its operands."""
    match node:
        case And(parts=parts):
            return _Waiting(Conjunction(1), zip(parts, repeat(bindings)))
        case Or(parts=parts):
            return _Waiting(Disjunction(1), zip(parts, repeat(bindings)))
        case Not(body=body):
            return _Waiting(Negated(1), iter([(body, bindings)]))
        case Imply(left=left, right=right):
            return _Waiting(Disjunction(1), iter([(Not(left), bindings), (right, bindings)]))
        case ForPairs():
            return _open_pairs(node, bindings, members, pairs)
        case ForAll() | Exists() | ForN():
            names = members.of(node.binders[0])
            bodies = ((node.body, (node.variable, name, bindings)) for name in names)
            if isinstance(node, ForN):
                return _Waiting(Counting(node.count, len(names), 1), bodies)
            return _Waiting(Conjunction(1) if isinstance(node, ForAll) else Disjunction(1), bodies)
    raise TypeError(f"A formula was expected, not {node!r}.")


def _open_pairs(node: ForPairs, bindings: _Bindings, members: Members, pairs: PairSemantics) -> _Waiting:
    table = members.pairs(*node.binders, closed_up=pairs == "reference")
    cells = [(row, column, pair) for row, line in enumerate(table) for column, pair in enumerate(line) if pair]
    count = smaller_side(table) if node.number is None else node.number
    form = CellTable(count, ((row, column) for row, column, _ in cells), pairs == "matching", 1)
    return _Waiting(
        form,
        (
            (node.body, (node.other_variable, second, (node.variable, first, bindings)))
            for _, _, (first, second) in cells
        ),
    )


def _ground(atom: Atom, bindings: _Bindings) -> Atom:
    """Returns the atom with every bound variable replaced by its object."""
    return Atom(atom.predicate, tuple(_lookup(name, bindings) for name in atom.args))


def _lookup(name: str, bindings: _Bindings) -> str:
    while bindings is not None:
        variable, value, bindings = bindings
        if variable == name:
            return value
    return name
