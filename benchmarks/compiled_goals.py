"""Goals compiled for complete states: one whole number has a bit for each state of a batch.

`evaluate` interprets a formula; `compile_goal` prepares one that is evaluated often, as a simulator does.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence, Set, Sized
from dataclasses import dataclass
from functools import reduce
from operator import and_, or_
from typing import TYPE_CHECKING, Any, TypeAlias

from bddl.ast import And, Atom, Formula
from bddl.evaluation import Fact, as_bits, has_matching, truth_value
from bddl.grounding import (
    All,
    AtLeast,
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
from bddl.problem import Objects

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import ArrayLike, NDArray

# A packed state; the true atoms, as atoms or as facts; values by atom; or values in the order of some atoms.
TotalState: TypeAlias = int | Set[Atom] | Set[Fact] | Mapping[Atom, bool] | Mapping[Fact, bool] | Sequence[bool]
# The states in which something holds, as a set of bits: one evaluation serves one state or a thousand.
_States: TypeAlias = int


@dataclass(eq=False, repr=False)
class WrongState(ValueError):
    """Raised when a compiled goal is given a state that does not fit it.

    Attributes:
        atoms: How many atoms the goal depends on.
        got: What was given, in words.
    """

    atoms: int
    got: str

    def __str__(self) -> str:
        return (
            f"{self.got} is no state of this goal: give a value for each of its {self.atoms} atoms in the order of "
            "`goal.atoms`, a set of the atoms that are true, or a mapping from atoms to values."
        )


class CompiledGoal:
    """A formula over the objects of one scene, ready to be evaluated; made by `compile_goal`.

    Attributes:
        atoms: The distinct ground atoms that it depends on; their order is that of every state given by position.
        conditions: The parts of the formula as it is written, if it is a conjunction; else the formula alone. A
            conjunction inside it stays whole. BEHAVIOR reports success in these units.
    """

    __slots__ = ("_conditions", "_facts", "_steps", "atoms", "conditions")

    def __init__(self, formula: Formula, objects: Objects | None, pairs: PairSemantics) -> None:
        self.conditions = formula.parts if isinstance(formula, And) else (formula,)
        grounded = ground(And(self.conditions), objects, pairs)
        self.atoms = grounded.atoms
        self._facts = [atom.label for atom in self.atoms]
        nodes = list(operands_first(grounded.root))
        place = {id(node): node.atom for node in nodes if isinstance(node, Leaf)}
        # The values of the atoms come first, then those of the other nodes, each after its operands.
        forms = [node for node in nodes if not isinstance(node, Leaf)]
        place |= {id(node): len(self.atoms) + number for number, node in enumerate(forms)}
        self._steps = [(node, [place[id(part)] for part in children(node)]) for node in forms]
        self._conditions = [place[id(part)] for part in children(grounded.root)]

    def pack(self, state: TotalState) -> int:
        """Return a complete state as a number whose bit i is the value of `atoms[i]`.

        Keep a packed state that is evaluated more than once, or that changes by a bit at a time.

        Args:
            state: A set of what is true, as atoms or as tuples such as `("ontop", "glass_0", "table_0")`; or a mapping
                from atoms to values, absent ones being false; or a list of values in the order of `atoms`. Atoms that
                the goal does not depend on are ignored, since a simulator's state is about all there is; so a slip in
                the name of an atom reads as if it were false (`state - set(goal.atoms)` has it).

        Raises:
            WrongState: It is none of these, has another number of values than there are atoms, or has a value that
                is neither true nor false.
        """
        width = len(self.atoms)
        if type(state) is int:
            if state < 0 or state.bit_length() > width:
                size = "negative" if state < 0 else f"of {state.bit_length()} bits, where a packed state has {width},"
                raise WrongState(width, f"a number that is {size}")
            return state
        given: Any = state
        if isinstance(given, Set | Mapping):
            first = next(iter(given), None)
            if not isinstance(first, Atom | tuple | None):
                raise WrongState(width, f"a collection of {type(first).__name__}, such as {first!r:.40},")
            names: Sequence[Any] = self._facts if isinstance(first, tuple) else self.atoms
            if isinstance(given, Set):
                return as_bits([name in given for name in names])
            given = [given.get(name, False) for name in names]
        if not isinstance(given, Iterable) or isinstance(given, str) or not isinstance(given, Sized):
            raise WrongState(width, f"a {type(state).__name__}")
        if len(given) != width:
            raise WrongState(width, f"{len(given)} values")
        try:
            return as_bits([truth_value(value) for value in given])
        except TypeError:
            kind = "list" if isinstance(state, Mapping) else type(state).__name__
            raise WrongState(width, f"a {kind} with values other than true and false") from None

    def evaluate(self, state: TotalState) -> bool:
        """Decide whether the formula holds in a complete state, packed or in any form that `pack` takes.

        Raises:
            WrongState: The state is in none of these forms.
        """
        return all(self.evaluate_conditions(state))

    def evaluate_conditions(self, state: TotalState) -> tuple[bool, ...]:
        """Decide for each condition whether it holds in a complete state.

        Raises:
            WrongState: The state is in none of the forms that `pack` takes.
        """
        bits = self.pack(state)
        values = self._values([bits >> place & 1 for place in range(len(self.atoms))], 1)
        return tuple([bool(values[place]) for place in self._conditions])

    def evaluate_batch(self, states: ArrayLike) -> NDArray[np.bool_]:
        """Decide for many complete states at once which conditions hold; the formula holds where all of them do.

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
        values = self._values([int.from_bytes(row.tobytes(), "little") for row in bits], (1 << count) - 1)
        length = bits.shape[1]
        data = b"".join([values[place].to_bytes(length, "little") for place in self._conditions])
        bits = np.frombuffer(data, dtype=np.uint8).reshape(len(self._conditions), length)
        return np.unpackbits(bits, axis=1, count=count, bitorder="little").T.astype(np.bool_)

    def _values(self, atoms: list[_States], every: _States) -> list[_States]:
        """Return the states in which each atom holds, and after that those of each other node."""
        values = atoms
        for node, places in self._steps:
            values.append(_holds(node, [values[place] for place in places], every))
        return values


def compile_goal(
    formula: Formula, objects: Objects | None = None, *, pairs: PairSemantics = "matching"
) -> CompiledGoal:
    """Return a formula prepared for repeated evaluation; arguments and exceptions are those of `evaluate`.

    Example:
        >>> import bddl
        >>> formula = bddl.parse_formula("(and (open fridge) (exists (?x - glass) (inside ?x fridge)))")
        >>> goal = compile_goal(formula, {"glass_0": "glass", "glass_1": "glass", "fridge": "refrigerator"})
        >>> goal.evaluate_conditions([True, False, True])
        (True, True)
        >>> goal.evaluate(goal.pack({bddl.Atom("open", ("fridge",))}))
        False
    """
    return CompiledGoal(formula, objects, pairs)


def _holds(node: GroundNode, parts: list[_States], every: _States) -> _States:
    """Return the states in which a node holds, from those of the nodes inside it."""
    match node:
        case All():
            return reduce(and_, parts, every)
        case Some():
            return reduce(or_, parts, 0)
        case Negation():
            return every ^ parts[0]
        case AtLeast(count=count):
            return _count_states(parts, count, every)[count]
        case Exactly(count=count):
            reached = _count_states(parts, count + 1, every)
            return reached[count] & ~reached[count + 1]
        case Matching(count=count, cells=cells):
            return _matching_states(count, cells, parts, every)
    raise TypeError(f"A ground node other than an atom was expected, not {node!r}.")


def _count_states(parts: Iterable[_States], most: int, every: _States) -> list[_States]:
    """Return, for each number up to `most`, the states in which at least so many parts hold."""
    reached = [every] + [0] * most
    for states in parts:
        for number in range(most, 0, -1):
            reached[number] |= reached[number - 1] & states
    return reached


def _matching_states(
    count: int, cells: tuple[tuple[GroundNode | None, ...], ...], parts: list[_States], every: _States
) -> _States:
    """Return the states in which `count` cells can be chosen, no two of them in one row or column."""
    places = [(row, column) for row, line in enumerate(cells) for column, cell in enumerate(line) if cell is not None]
    found = every
    for side in (0, 1):
        lines: dict[int, _States] = {}
        for place, states in zip(places, parts, strict=True):
            lines[place[side]] = lines.get(place[side], 0) | states
        found &= _count_states(lines.values(), count, every)[count]
    # By König's theorem, where two cells cannot be chosen, one row or one column holds all of them.
    if count <= 2:
        return found
    left = found
    while left:
        state = left & -left
        left ^= state
        rows = [0] * len(cells)
        for (row, column), states in zip(places, parts, strict=True):
            rows[row] |= bool(states & state) << column
        if not has_matching(rows, count):
            found ^= state
    return found
