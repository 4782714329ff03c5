"""Ground formulas as circuits: gates in order, each over atoms and the gates before it.

A signal is a whole number, as in the AIGER format: 2 k is the k-th input or gate, 2 k + 1 its negation, so negating is
flipping the last bit, and disjunctions are negated conjunctions of negations. Conjunctions inside conjunctions are
opened, and equal gates are one.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TypeAlias

from bddl.semantics.ground import All, Coverage, Exactly, GroundNode, Leaf, Matching, Negation, Some, children

Signal: TypeAlias = int


@dataclass(frozen=True, slots=True)
class Conjunction:
    """True when all inputs are; the inputs are distinct and sorted."""

    inputs: tuple[Signal, ...]


@dataclass(frozen=True, slots=True)
class Count:
    """True when exactly `count` of the inputs are; an input that stands there twice counts twice."""

    count: int
    inputs: tuple[Signal, ...]


@dataclass(frozen=True, slots=True)
class Table:
    """True when `count` cells can be paired off (`matching`), or else when `count` rows and columns have a true cell.

    Rows are equally long; None is a cell that is never true.
    """

    count: int
    cells: tuple[tuple[Signal | None, ...], ...]
    matching: bool


Gate: TypeAlias = Conjunction | Count | Table


@dataclass(frozen=True, slots=True)
class Circuit:
    """Formulas over the same inputs, as gates.

    Attributes:
        inputs: How many inputs there are.
        gates: The gates; the k-th is signal 2 (inputs + k). Each uses inputs and gates before it only.
        outputs: One signal for each formula.
    """

    inputs: int
    gates: tuple[Gate, ...]
    outputs: tuple[Signal, ...]


def signals_of(gate: Gate) -> Iterator[Signal]:
    """Yields the signals that a gate reads."""
    if isinstance(gate, Table):
        yield from (cell for row in gate.cells for cell in row if cell is not None)
    else:
        yield from gate.inputs


# A node together with whether its negation is meant.
_Polar: TypeAlias = tuple[GroundNode, int]


def circuit(roots: Sequence[GroundNode], inputs: int) -> Circuit:
    """Returns ground formulas over so many atoms as a circuit with one output for each."""
    builder = _Builder(inputs)
    outputs = tuple([builder.signal(root) for root in roots])
    return Circuit(inputs, tuple(builder.gates), outputs)


class _Builder:
    """Makes gates from ground nodes, each node once, with a stack of its own."""

    def __init__(self, inputs: int) -> None:
        self._inputs = inputs
        self.gates: list[Gate] = []
        self._place: dict[Gate, Signal] = {}
        self._done: dict[int, Signal] = {}

    def signal(self, root: GroundNode) -> Signal:
        """Returns the signal that says whether a node is true, made with all that it needs, parts first."""
        top, negated = _plain(root, 0)
        pending = [top]
        awaited: dict[int, list[_Polar]] = {}
        while pending:
            node = pending[-1]
            if id(node) in self._done:
                pending.pop()
            elif id(node) in awaited:
                pending.pop()
                self._done[id(node)] = self._make(node, awaited.pop(id(node)))
            else:
                awaited[id(node)] = _parts(node)
                for part, _ in reversed(awaited[id(node)]):
                    if isinstance(part, Leaf):
                        self._done[id(part)] = 2 * part.atom
                    elif id(part) not in self._done:
                        pending.append(part)
        return self._done[id(top)] ^ negated

    def _make(self, node: GroundNode, parts: list[_Polar]) -> Signal:
        inputs = [self._done[id(part)] ^ negated for part, negated in parts]
        match node:
            case Leaf(atom=atom):
                return 2 * atom
            case All():
                return self._conjunction(inputs)
            case Some():
                return self._conjunction(inputs) ^ 1
            case Exactly(count=count):
                return self._add(Count(count, tuple(inputs)))
            case Matching(count=count, cells=cells) | Coverage(count=count, cells=cells):
                cell_signals = iter(inputs)
                width = max(map(len, cells), default=0)
                rows = tuple(
                    tuple(None if cell is None else next(cell_signals) for cell in row) + (None,) * (width - len(row))
                    for row in cells
                )
                return self._add(Table(count, rows, isinstance(node, Matching)))
        raise TypeError(f"A ground node was expected, not {node!r}.")

    def _conjunction(self, inputs: list[Signal]) -> Signal:
        # A signal and its negation stay both, for where they are unknown their conjunction is unknown, too.
        distinct = set(inputs)
        return distinct.pop() if len(distinct) == 1 else self._add(Conjunction(tuple(sorted(distinct))))

    def _add(self, gate: Gate) -> Signal:
        if gate not in self._place:
            self._place[gate] = 2 * (self._inputs + len(self.gates))
            self.gates.append(gate)
        return self._place[gate]


def _plain(node: GroundNode, negated: int) -> _Polar:
    """Returns the same without negations at its top."""
    while isinstance(node, Negation):
        node, negated = node.body, negated ^ 1
    return node, negated


def _parts(node: GroundNode) -> list[_Polar]:
    """Returns what a gate for the node reads: the inputs of its conjunction, or the counted parts."""
    if not isinstance(node, All | Some):
        return [_plain(child, 0) for child in children(node)]
    found: list[_Polar] = []
    opened = {id(node)}
    # A disjunction is the negation of the conjunction of its negated parts.
    pending = [(part, int(isinstance(node, Some))) for part in reversed(node.parts)]
    while pending:
        part, negated = _plain(*pending.pop())
        if not isinstance(part, Some if negated else All):
            found.append((part, negated))
        elif id(part) not in opened:
            opened.add(id(part))
            pending.extend((inner, negated) for inner in reversed(part.parts))
    return found
