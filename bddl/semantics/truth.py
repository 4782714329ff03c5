"""Truth of a formula in a state that may be known only in part (strong Kleene logic)."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from itertools import repeat
from typing import Any, TypeAlias

from bddl.problem import Objects
from bddl.semantics.ground import PairSemantics, check_pair_semantics
from bddl.semantics.knownstate import Fact, Lookup, State, lookup, lookup_in_both, truth_value
from bddl.semantics.matching import PairTest, covers, decide, has_matching
from bddl.semantics.members import Members, smaller_side
from bddl.syntax import And, Atom, Exists, ForAll, Formula, ForN, ForPairs, Imply, Not, Or, Quantified

# Bindings form a linked list, innermost first: (variable, object, outer bindings).
_Bindings: TypeAlias = "tuple[str, str, _Bindings] | None"
_Operand: TypeAlias = tuple[Formula, _Bindings]
# What a state answers is looked at: a caller's function may return any value.
_Found: TypeAlias = Callable[[Atom], Any]


class _Junction:
    """A connective whose operands are being evaluated: all of them, or any of them, must hold."""

    __slots__ = ("absorbing", "negated", "operands", "unknown")

    def __init__(self, operands: Iterator[_Operand], absorbing: bool, negated: bool = False) -> None:
        self.operands = operands
        self.absorbing = absorbing
        self.negated = negated
        self.unknown = False

    def takes(self, value: bool | None) -> bool:
        """Takes the value of the next operand; True when it decides the connective."""
        if value is None:
            self.unknown = True
        return value == self.absorbing

    def result(self, decided: bool) -> bool | None:
        """The value of the connective, once an operand decided it or none is left."""
        if not decided and self.unknown:
            return None
        value = self.absorbing if decided else not self.absorbing
        return value != self.negated


class _Tally:
    """A `forn` whose bodies are being evaluated: exactly so many of them must hold."""

    __slots__ = ("count", "most", "operands", "sure")

    def __init__(self, operands: Iterator[_Operand], count: int, most: int) -> None:
        self.operands = operands
        self.count = count
        # How many hold at least, and how many can hold at most, as far as they were evaluated.
        self.sure = 0
        self.most = most

    def takes(self, value: bool | None) -> bool:
        """Takes the value of the next body; True when too many hold, or too few can."""
        if value:
            self.sure += 1
        elif value is False:
            self.most -= 1
        return self.sure > self.count or self.most < self.count

    def result(self, decided: bool) -> bool | None:
        """The value of the `forn`, once it is decided or no body is left."""
        if decided or not self.sure <= self.count <= self.most:
            return False
        return True if self.sure == self.most else None


class _PairTable:
    """A `forpairs` or `fornpairs` whose bodies are being evaluated, row by row; every cell is read."""

    __slots__ = ("cells", "count", "operands", "possible", "sure", "test")

    def __init__(
        self, operands: Iterator[_Operand], cells: Iterator[tuple[int, int]], height: int, count: int, test: PairTest
    ) -> None:
        self.operands = operands
        self.cells = cells
        self.count = count
        self.test = test
        self.sure = [0] * height
        self.possible = [0] * height

    def takes(self, value: bool | None) -> bool:
        """Takes the value of the next cell."""
        row, column = next(self.cells)
        if value is not False:
            self.possible[row] |= 1 << column
            if value:
                self.sure[row] |= 1 << column
        return False

    def result(self, decided: bool) -> bool | None:
        """The value of the quantifier, once every cell was read."""
        return decide(self.test, self.count, self.sure, self.possible)


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
    # A dictionary is asked for its keys only when nothing was known: that spares most calls the question.
    known = state.get if type(state) is dict else lookup(state)
    value = _value(formula, known, objects, pairs)
    if value is None and isinstance(state, Mapping):
        again = _another_lookup(state)
        if again is not None:
            return _value(formula, again, objects, pairs)
    return value


def _another_lookup(state: Mapping[Atom, bool] | Mapping[Fact, bool]) -> Lookup | None:
    """The lookup for a mapping whose keys are not all atoms; None where the first one has said all that there is."""
    both = lookup_in_both(state)
    if both is None and type(state) is dict and state and not isinstance(next(iter(state)), Atom):
        return lookup(state)
    return both


def _value(formula: Formula, known: _Found, objects: Objects | None, pairs: PairSemantics) -> bool | None:
    """The value of a formula, by a stack of what is open: connectives and quantifiers that wait for an operand."""
    stack: list[_Junction | _Tally | _PairTable] = []
    entering: _Operand | None = (formula, None)
    members: Members | None = None
    value: bool | None = None
    while True:
        if entering is not None:
            node, bindings = entering
            if isinstance(node, Atom):
                value = known(node if bindings is None else _ground(node, bindings))
                if value is not True and value is not False and value is not None:
                    value = truth_value(value)
            elif isinstance(node, Not) and isinstance(node.body, Atom):
                value = known(node.body if bindings is None else _ground(node.body, bindings))
                if value is not None:
                    value = not value if value is True or value is False else not truth_value(value)
            else:
                if isinstance(node, Quantified):
                    members = members or Members(objects)
                    stack.append(_open_quantifier(node, bindings, members, pairs))
                else:
                    stack.append(_open(node, bindings))
                entering = next(stack[-1].operands, None)
                if entering is not None:
                    continue
                value = stack.pop().result(decided=False)
        if not stack:
            return value
        decided = stack[-1].takes(value)
        entering = None if decided else next(stack[-1].operands, None)
        if entering is None:
            value = stack.pop().result(decided)


def _open(node: Formula, bindings: _Bindings) -> _Junction:
    """Returns the connective of a formula that is neither atom nor quantifier, ready to be evaluated."""
    match node:
        case And(parts=parts):
            return _Junction(zip(parts, repeat(bindings)), absorbing=False)
        case Or(parts=parts):
            return _Junction(zip(parts, repeat(bindings)), absorbing=True)
        case Not(body=body):
            return _Junction(iter([(body, bindings)]), absorbing=False, negated=True)
        case Imply(left=left, right=right):
            return _Junction(iter([(Not(left), bindings), (right, bindings)]), absorbing=True)
    raise TypeError(f"A formula was expected, not {node!r}.")


def _open_quantifier(
    node: ForAll | Exists | ForN | ForPairs, bindings: _Bindings, members: Members, pairs: PairSemantics
) -> _Junction | _Tally | _PairTable:
    """Returns a quantifier, ready to be evaluated for each choice of objects."""
    if isinstance(node, ForPairs):
        return _open_pairs(node, bindings, members, pairs)
    names = members.of(node.binders[0])
    bodies = ((node.body, (node.variable, name, bindings)) for name in names)
    if isinstance(node, ForN):
        return _Tally(bodies, node.count, len(names))
    return _Junction(bodies, absorbing=isinstance(node, Exists))


def _open_pairs(node: ForPairs, bindings: _Bindings, members: Members, pairs: PairSemantics) -> _PairTable:
    table = members.pairs(*node.binders, closed_up=pairs == "reference")
    bodies = (
        (node.body, (node.other_variable, second, (node.variable, first, bindings)))
        for row in table
        for pair in row
        if pair is not None
        for first, second in (pair,)
    )
    cells = ((i, j) for i, row in enumerate(table) for j, pair in enumerate(row) if pair is not None)
    count = smaller_side(table) if node.number is None else node.number
    return _PairTable(bodies, cells, len(table), count, has_matching if pairs == "matching" else covers)


def _ground(atom: Atom, bindings: _Bindings) -> Atom:
    """Returns the atom with every bound variable replaced by its object."""
    return Atom(atom.predicate, tuple(_lookup(name, bindings) for name in atom.args))


def _lookup(name: str, bindings: _Bindings) -> str:
    while bindings is not None:
        variable, value, bindings = bindings
        if variable == name:
            return value
    return name
