"""Goals prepared for being asked often: of one state, of a state known in part, of many states at once."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from bddl.semantics.ground import (
    All,
    Coverage,
    Exactly,
    GroundNode,
    Leaf,
    Matching,
    Negation,
    PairSemantics,
    Some,
    children,
    ground,
    operands_first,
)
from bddl.semantics.kleene import CellTable, Conjunction, Counting, Disjunction, Form, Negated, States, Value, truth
from bddl.semantics.states import AtomNames, State, TotalState, known_bits, packed
from bddl.syntax import And, Formula
from bddl.syntax.errors import WrongState
from bddl.syntax.problem import Objects

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import ArrayLike, NDArray


class CompiledGoal:
    """A formula over the objects of one scene, ready to be evaluated; made by `compile_goal`.

    Attributes:
        atoms: The distinct ground atoms that it depends on; their order is that of every state given by position.
        conditions: The parts of the formula as it is written, if it is a conjunction; else the formula alone. A
            conjunction inside it stays whole. BEHAVIOR reports success in these units.
    """

    __slots__ = ("_conditions", "_names", "_steps", "atoms", "conditions")

    def __init__(self, formula: Formula, objects: Objects | None, pairs: PairSemantics) -> None:
        self.conditions = formula.parts if isinstance(formula, And) else (formula,)
        spelled_out = ground(And(self.conditions), objects, pairs)
        self.atoms = spelled_out.atoms
        self._names = AtomNames(self.atoms)
        nodes = [node for node in operands_first(spelled_out.root) if not isinstance(node, Leaf)]
        # The values of the atoms come first, then those of the other nodes, each after its operands.
        place = {id(node): len(self.atoms) + number for number, node in enumerate(nodes)}
        place |= {id(node): node.atom for node in operands_first(spelled_out.root) if isinstance(node, Leaf)}
        # The last node is the conjunction of the conditions.
        self._steps = [(node, [place[id(part)] for part in children(node)]) for node in nodes]
        self._conditions = [place[id(part)] for part in children(spelled_out.root)]

    def pack(self, state: TotalState) -> int:
        """Returns a complete state as a number whose bit i is the value of `atoms[i]`.

        A packed state is worth keeping where it is asked about more than once, or changes by a bit at a time.

        Args:
            state: A set of what is true, as atoms or as tuples such as `("ontop", "glass_0", "table_0")`; or a mapping
                from atoms to values, absent ones being false; or a list of values in the order of `atoms`. Atoms that
                the goal does not depend on are ignored, since a simulator's state is about all there is; so a slip in
                the name of an atom reads as if it were false (`state - set(goal.atoms)` has it).

        Raises:
            WrongState: It is none of these, has another number of values than there are atoms, or has a value that
                is neither true nor false.
        """
        return packed(self._names, state)

    def evaluate(self, state: TotalState) -> bool:
        """Decides whether the formula holds in a complete state, packed or in any form that `pack` takes.

        Raises:
            WrongState: The state is in none of these forms.
        """
        return all(self.evaluate_conditions(state))

    def evaluate_conditions(self, state: TotalState) -> tuple[bool, ...]:
        """Decides for each condition whether it holds in a complete state.

        Raises:
            WrongState: The state is in none of the forms that `pack` takes.
        """
        bits = self.pack(state)
        values = self._values([(bit, bit) for bit in _split(bits, len(self.atoms))], 1)
        return tuple([bool(values[place][0]) for place in self._conditions])

    def decide(self, state: State) -> bool | None:
        """Decides whether the formula holds in a state that may be known in part, as `evaluate` of this package does.

        Args:
            state: What is known: a mapping in which an absent atom is unknown, or a function that returns None for
                unknown. It is asked about every atom.

        Returns:
            True or False when every completion of the state agrees on that by Kleene's tables; None when unknown.

        Raises:
            TypeError: It is no state, or the value of an atom is none.
        """
        return truth(self._known_values(state)[-1])

    def decide_conditions(self, state: State) -> tuple[bool | None, ...]:
        """Decides each condition in a state that may be known in part; see `decide`."""
        values = self._known_values(state)
        return tuple([truth(values[place]) for place in self._conditions])

    def _known_values(self, state: State) -> list[Value]:
        true, false = known_bits(self.atoms, state)
        width = len(self.atoms)
        possible = [1 - bit for bit in _split(false, width)]
        return self._values(list(zip(_split(true, width), possible, strict=True)), 1)

    def evaluate_batch(self, states: ArrayLike) -> NDArray[np.bool_]:
        """Decides for many complete states at once which conditions hold; the formula holds where all of them do.

        Args:
            states: Boolean values, shape (states, atoms): one row for each state, its values in the order of `atoms`.
                Each condition is worked out in all of them at once, so a few hundred cost little more than one.

        Returns:
            Boolean values, shape (states, conditions).

        Raises:
            WrongState: The array has another shape, or values that are neither true nor false.
        """
        import numpy as np

        given = np.asarray(states)
        if given.dtype != np.bool_ and not np.isin(given, (0, 1)).all():
            raise WrongState(len(self.atoms), "an array with values other than true and false")
        table = given.astype(np.bool_, copy=False)
        if table.ndim != 2 or table.shape[1] != len(self.atoms):
            raise WrongState(len(self.atoms), f"an array of shape {table.shape}")
        count = table.shape[0]
        bits = np.packbits(table.T, axis=1, bitorder="little")
        columns = [int.from_bytes(row.tobytes(), "little") for row in bits]
        values = self._values([(column, column) for column in columns], (1 << count) - 1)
        length = bits.shape[1]
        data = b"".join([values[place][0].to_bytes(length, "little") for place in self._conditions])
        bits = np.frombuffer(data, dtype=np.uint8).reshape(len(self._conditions), length)
        return np.unpackbits(bits, axis=1, count=count, bitorder="little").T.astype(np.bool_)

    def _values(self, atoms: list[Value], every: States) -> list[Value]:
        """Returns the values of the atoms, and after them those of all other nodes."""
        values = atoms
        for node, parts in self._steps:
            form = _form(node, every)
            for part in parts:
                if form.take(values[part]):
                    break
            values.append(form.result())
        return values


def _form(node: GroundNode, every: States) -> Form:
    """Returns a ground node that is no atom, ready to take the values of its operands."""
    match node:
        case All():
            return Conjunction(every)
        case Some():
            return Disjunction(every)
        case Negation():
            return Negated(every)
        case Exactly(count=count, parts=parts):
            return Counting(count, len(parts), every)
        case Matching(count=count, cells=cells) | Coverage(count=count, cells=cells):
            places = [(at, column) for at, row in enumerate(cells) for column, cell in enumerate(row) if cell]
            return CellTable(count, iter(places), isinstance(node, Matching), every)
    raise TypeError(f"A ground node was expected, not {node!r}.")


def _split(bits: int, width: int) -> Sequence[int]:
    """Returns each bit of a number, the lowest first."""
    return [bits >> place & 1 for place in range(width)]


def compile_goal(
    formula: Formula, objects: Objects | None = None, *, pairs: PairSemantics = "matching"
) -> CompiledGoal:
    """Prepares a formula for being evaluated often.

    Args:
        formula: Any formula, of any depth.
        objects: Category of each object, or the declared objects of a problem; needed for quantifiers. The category
            `object` holds all of them.
        pairs: `matching` reads `forpairs` and `fornpairs` as a choice of disjoint pairs; `reference` counts rows and
            columns with a true cell, as the reference implementation does.

    Raises:
        ObjectsRequired: There is a quantifier and `objects` is None.
        UnknownPairSemantics: `pairs` is neither of the two.

    Source: docs/bddl.md, Goals that are asked often.

    Example:
        >>> import bddl
        >>> formula = bddl.parse_formula("(and (open fridge) (exists (?x - glass) (inside ?x fridge)))")
        >>> goal = bddl.compile_goal(formula, {"glass_0": "glass", "glass_1": "glass", "fridge": "refrigerator"})
        >>> goal.evaluate_conditions([True, False, True])
        (True, True)
        >>> goal.evaluate(goal.pack({bddl.Atom("open", ("fridge",))}))
        False
    """
    return CompiledGoal(formula, objects, pairs)
