"""Truth of a formula in a state that may be known only in part (strong Kleene logic)."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import TypeAlias

from bddl.errors import ObjectsRequired
from bddl.syntax import And, Atom, Exists, ForAll, Formula, Imply, Not, Or

# The category that every object of a scene belongs to, as in typed PDDL.
ROOT_CATEGORY = "object"

State: TypeAlias = Mapping[Atom, bool] | Callable[[Atom], bool | None]
# Bindings form a linked list, innermost first: (variable, object, outer bindings).
_Bindings: TypeAlias = "tuple[str, str, _Bindings] | None"
_Operand: TypeAlias = tuple[Formula, _Bindings]


class _Junction:
    """A connective whose operands are being evaluated: all of them, or any of them, must hold."""

    __slots__ = ("absorbing", "negated", "operands", "unknown")

    def __init__(self, operands: Iterator[_Operand], absorbing: bool, negated: bool = False) -> None:
        self.operands = operands
        self.absorbing = absorbing
        self.negated = negated
        self.unknown = False

    def result(self, decided: bool) -> bool | None:
        """The value of the connective, once an operand decided it or none is left."""
        if not decided and self.unknown:
            return None
        value = self.absorbing if decided else not self.absorbing
        return value != self.negated


def evaluate(formula: Formula, state: State, objects: Mapping[str, str] | None = None) -> bool | None:
    """Decides whether a formula holds in a state, as far as the state is known.

    An unknown atom leaves the formula unknown unless the known ones decide it. Operands are evaluated from left to
    right, and evaluation stops as soon as the value is decided. A quantifier over a category without objects is
    vacuous: `forall` is true, `exists` is false.

    Args:
        formula: Any formula, of any depth.
        state: What is known: a mapping in which an absent atom is unknown, or a function that returns None for unknown.
        objects: Category of each object; needed for quantifiers. The category `object` holds all of them.

    Returns:
        True or False when every completion of the state agrees on that by Kleene's tables; None when unknown.

    Raises:
        ObjectsRequired: A quantifier was met and `objects` is None.

    Source: docs/semantics.md, Knowledge; the reference implementation is two-valued and does not stop early.

    Example:
        >>> import bddl
        >>> goal = bddl.parse_formula("(or (open refrigerator_0) (inside glass_0 refrigerator_0))")
        >>> bddl.evaluate(goal, {bddl.Atom("open", ("refrigerator_0",)): True})
        True
        >>> bddl.evaluate(goal, {}) is None
        True
    """
    known = state.get if isinstance(state, Mapping) else state
    stack: list[_Junction] = []
    entering: _Operand | None = (formula, None)
    value: bool | None = None
    while True:
        if entering is not None:
            node, bindings = entering
            if isinstance(node, Atom):
                value = known(node if bindings is None else _ground(node, bindings))
            else:
                stack.append(_open(node, bindings, objects))
                entering = next(stack[-1].operands, None)
                if entering is not None:
                    continue
                value = stack.pop().result(decided=False)
        if not stack:
            return value
        junction = stack[-1]
        if value is None:
            junction.unknown = True
        decided = value == junction.absorbing
        entering = None if decided else next(junction.operands, None)
        if entering is None:
            value = stack.pop().result(decided)


def _open(node: Formula, bindings: _Bindings, objects: Mapping[str, str] | None) -> _Junction:
    """Returns the connective of a formula that is no atom, ready to be evaluated."""
    match node:
        case And(parts=parts):
            return _Junction(((part, bindings) for part in parts), absorbing=False)
        case Or(parts=parts):
            return _Junction(((part, bindings) for part in parts), absorbing=True)
        case Not(body=body):
            return _Junction(iter([(body, bindings)]), absorbing=False, negated=True)
        case Imply(left=left, right=right):
            return _Junction(iter([(Not(left), bindings), (right, bindings)]), absorbing=True)
        case ForAll() | Exists():
            instances = _instances(node, objects)
            bound = ((node.body, (node.variable, name, bindings)) for name in instances)
            return _Junction(bound, absorbing=isinstance(node, Exists))
    raise TypeError(f"A formula was expected, not {node!r}.")


def _instances(node: ForAll | Exists, objects: Mapping[str, str] | None) -> list[str]:
    if objects is None:
        raise ObjectsRequired(node.variable, node.category)
    return [name for name, category in objects.items() if node.category in (category, ROOT_CATEGORY)]


def _ground(atom: Atom, bindings: _Bindings) -> Atom:
    """Returns the atom with every bound variable replaced by its object."""
    return Atom(atom.predicate, tuple(_lookup(name, bindings) for name in atom.args))


def _lookup(name: str, bindings: _Bindings) -> str:
    while bindings is not None:
        variable, value, bindings = bindings
        if variable == name:
            return value
    return name
