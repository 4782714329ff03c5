"""Ground formulas with every negation at an atom, and a lower bound on what it costs to make each part true.

A node says what has to be true. The negation of a conjunction is a choice, that of `forn` a choice between too many and
too few, that of a pairing the lack of one.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from heapq import nsmallest
from typing import Final, NamedTuple, TypeAlias

from bddl.semantics.ground import All, AtLeast, Exactly, Ground, GroundNode, Leaf, Matching, Negation, Some
from bddl.semantics.matching import has_matching, largest_matching

# The cost of what cannot be made true. Costs are whole numbers, so sums stay exact; more than this is as hopeless.
IMPOSSIBLE: Final = 1 << 60


class Lit(NamedTuple):
    """An atom, by its position in `Ground.atoms`, with the value that it is to have."""

    atom: int
    value: bool


class Every(NamedTuple):
    """All parts, by their positions in `NormalForm.nodes`; of those that are `apart` no two share an atom."""

    parts: tuple[int, ...]
    apart: tuple[int, ...]


class Either(NamedTuple):
    """At least one part; without parts it is false."""

    parts: tuple[int, ...]


class Enough(NamedTuple):
    """At least `needed` of the parts; `apart` when no two parts share an atom."""

    needed: int
    parts: tuple[int, ...]
    apart: bool


class Exact(NamedTuple):
    """`needed` of the parts true and all others false; `opposites[i]` is what makes part i false."""

    needed: int
    parts: tuple[int, ...]
    opposites: tuple[int, ...]
    apart: bool


Cells: TypeAlias = tuple[tuple[int | None, ...], ...]


class Pairing(NamedTuple):
    """`needed` cells of a table, no two in one row or column; None is a cell that cannot be chosen.

    It is `apart` when no two rows share an atom.
    """

    needed: int
    cells: Cells
    apart: bool


class NoPairing(NamedTuple):
    """Cells made false until no `needed` of the others can be paired off; a cell holds what makes it false."""

    needed: int
    cells: Cells
    apart: bool


NormalNode: TypeAlias = Lit | Every | Either | Enough | Exact | Pairing | NoPairing


@dataclass(frozen=True, slots=True)
class NormalForm:
    """A formula as a graph of nodes.

    Attributes:
        nodes: Every node, after the nodes that it is made of.
        atoms: The atoms below each node, as a set of bits.
        root: The position of the node that stands for the whole formula.
    """

    nodes: tuple[NormalNode, ...]
    atoms: tuple[int, ...]
    root: int

    def costs(self, price: Callable[[Lit], int]) -> list[int]:
        """Returns what it costs at least to make each node true.

        Args:
            price: The price of a literal: 0 where it holds, from 1 up to make it hold, `IMPOSSIBLE` where it cannot.

        Returns:
            For each node a number that is 0 exactly where the literals of price 0 make it true by Kleene's tables,
            and never more than the cheapest set of literals that makes it true.
        """
        costs: list[int] = []
        for node in self.nodes:
            costs.append(price(node) if isinstance(node, Lit) else self.cost(node, costs))
        return costs

    def cost(self, node: NormalNode, costs: list[int]) -> int:
        """Returns the cost of a node, which need not be one of `nodes`, from the costs of its parts."""
        match node:
            case Lit():
                raise TypeError("The cost of a literal is its price.")
            case Every(parts=parts, apart=apart):
                # Where parts share an atom, one literal may serve both.
                return max(sum([costs[part] for part in apart]), max([costs[part] for part in parts], default=0))
            case Either(parts=parts):
                return min([costs[part] for part in parts], default=IMPOSSIBLE)
            case Enough(needed=count, parts=parts, apart=apart):
                return _cheapest(count, [costs[part] for part in parts], apart)
            case Exact(needed=count, parts=parts, opposites=opposites, apart=apart):
                true, false = [costs[part] for part in parts], [costs[part] for part in opposites]
                if not apart or not 0 <= count <= len(parts):
                    return max(_cheapest(count, true, apart), _cheapest(len(parts) - count, false, apart))
                # All are made false at first; then those are made true for which that is least expensive.
                return sum(false) + sum(nsmallest(count, [one - other for one, other in zip(true, false, strict=True)]))
            case Pairing(needed=count, cells=cells, apart=apart):
                if not has_matching(rows_of(cells, lambda cell: costs[cell] < IMPOSSIBLE), count):
                    return IMPOSSIBLE
                missing = count - len(largest_matching(rows_of(cells, lambda cell: not costs[cell])))
                least = [min([costs[cell] for cell in row if cell is not None], default=IMPOSSIBLE) for row in cells]
                return max(_cheapest(count, least, apart), missing if apart else min(missing, 1))
            case NoPairing(needed=count, cells=cells, apart=apart):
                if has_matching(rows_of(cells, lambda cell: costs[cell] >= IMPOSSIBLE), count):
                    return IMPOSSIBLE
                surplus = len(largest_matching(rows_of(cells, lambda cell: costs[cell] > 0))) - count + 1
                return max(0, surplus if apart else min(surplus, 1))

    def below(self, node: NormalNode) -> int:
        """Returns the atoms of a node, which need not be one of `nodes`, as a set of bits."""
        if isinstance(node, Lit):
            return 1 << node.atom
        atoms = 0
        for part in _parts(node):
            atoms |= self.atoms[part]
        return atoms


def _parts(node: NormalNode) -> Iterable[int]:
    """Returns the positions of the nodes that a node is directly made of, but for the opposites of counted parts."""
    match node:
        case Lit():
            return ()
        case Every(parts=parts) | Either(parts=parts) | Enough(parts=parts) | Exact(parts=parts):
            return parts
        case Pairing(cells=cells) | NoPairing(cells=cells):
            return [cell for row in cells for cell in row if cell is not None]


def _cheapest(count: int, costs: list[int], apart: bool) -> int:
    """Returns what so many of some parts cost at least."""
    if count > len(costs):
        return IMPOSSIBLE
    chosen = nsmallest(count, costs)
    return sum(chosen) if apart else max(chosen, default=0)


def rows_of(cells: Cells, test: Callable[[int], bool]) -> list[int]:
    """Returns for each row the columns whose cells pass a test, as a set of bits."""
    return [sum([1 << column for column, cell in enumerate(row) if cell is not None and test(cell)]) for row in cells]


def normal_form(ground: Ground) -> NormalForm:
    """Returns the formula with negations at its atoms only; parts that the ground formula shares stay shared.

    A state that is known in part makes the normal form true exactly when Kleene's tables make the formula true.
    """
    builder = _FormBuilder()
    stack: list[tuple[GroundNode, bool]] = [(ground.root, True)]
    while stack:
        node, value = stack[-1]
        needed = [part for part in _needed(node, value) if (id(part[0]), part[1]) not in builder.made]
        if needed:
            stack.extend(reversed(needed))
            continue
        stack.pop()
        if (id(node), value) not in builder.made:
            builder.made[id(node), value] = builder.convert(node, value)
    return NormalForm(tuple(builder.nodes), tuple(builder.atoms), builder.made[id(ground.root), True])


def _needed(node: GroundNode, value: bool) -> Iterator[tuple[GroundNode, bool]]:
    """Yields what is converted before a node: its parts, each with the value that it is to have."""
    match node:
        case Negation(body=body):
            yield body, not value
        case All(parts=parts) | Some(parts=parts) | AtLeast(parts=parts):
            yield from ((part, value) for part in parts)
        case Exactly(parts=parts):
            yield from ((part, wanted) for part in parts for wanted in (True, False))
        case Matching(cells=cells):
            yield from ((cell, value) for row in cells for cell in row if cell is not None)


class _FormBuilder:
    """A normal form under construction; ground nodes are known by identity, each with the value it is to have."""

    def __init__(self) -> None:
        self.nodes: list[NormalNode] = []
        self.atoms: list[int] = []
        self.made: dict[tuple[int, bool], int] = {}

    def convert(self, node: GroundNode, value: bool) -> int:
        """Returns the position of what gives a ground node a value; its parts are made already."""
        match node:
            case Leaf(atom=atom):
                return self._add(Lit(atom, value))
            case Negation(body=body):
                return self.made[id(body), not value]
            case All(parts=parts) | Some(parts=parts):
                inside = self._all(parts, value)
                return self._every(inside) if isinstance(node, All) == value else self._add(Either(inside))
            case Exactly(count=count, parts=parts):
                true, false = self._all(parts, True), self._all(parts, False)
                apart = self._are_apart(true)
                if value:
                    return self._add(Exact(count, true, false, apart))
                too_many = self._add(Enough(count + 1, true, apart))
                too_few = self._add(Enough(len(parts) - count + 1, false, apart))
                return self._add(Either((too_many, too_few)))
            case Matching(count=count, cells=cells):
                table = tuple(tuple(None if one is None else self.made[id(one), value] for one in row) for row in cells)
                kind = Pairing if value else NoPairing
                columns: Cells = tuple(zip(*table, strict=True))
                if not self._rows_are_apart(table) and self._rows_are_apart(columns):
                    table = columns
                return self._add(kind(count, table, self._rows_are_apart(table)))
            case AtLeast(count=count, parts=parts):
                inside = self._all(parts, value)
                needed = count if value else len(parts) - count + 1
                return self._add(Enough(needed, inside, self._are_apart(inside)))

    def _add(self, node: NormalNode) -> int:
        below = 1 << node.atom if isinstance(node, Lit) else 0
        for part in _parts(node):
            below |= self.atoms[part]
        self.nodes.append(node)
        self.atoms.append(below)
        return len(self.nodes) - 1

    def _all(self, parts: Iterable[GroundNode], value: bool) -> tuple[int, ...]:
        return tuple([self.made[id(part), value] for part in parts])

    def _every(self, parts: tuple[int, ...]) -> int:
        return self._add(Every(parts, self._first_apart(parts)))

    def _are_apart(self, parts: tuple[int, ...]) -> bool:
        return len(self._first_apart(parts)) == len(parts)

    def _rows_are_apart(self, cells: Cells) -> bool:
        seen = 0
        for row in cells:
            atoms = 0
            for cell in row:
                atoms |= 0 if cell is None else self.atoms[cell]
            if seen & atoms:
                return False
            seen |= atoms
        return True

    def _first_apart(self, parts: tuple[int, ...]) -> tuple[int, ...]:
        """Returns the parts that share no atom with those returned before them."""
        seen = 0
        kept: list[int] = []
        for part in parts:
            if not seen & self.atoms[part]:
                seen |= self.atoms[part]
                kept.append(part)
        return tuple(kept)
