"""Ground formulas with every negation at an atom: the form in which ways to make a formula true are counted.

A node says what is to be made true. What is to be made false becomes nodes of its own: the negation of a conjunction is
a choice, of `forn` a choice between too many and too few, of a matching the lack of one.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import NamedTuple, TypeAlias, TypeVar

from bddl.goals.assignment import INFINITE, cheapest_pairs


class Lit(NamedTuple):
    """An atom, by its position in `Ground.atoms`, with the value that it is to have."""

    atom: int
    value: bool


class Every(NamedTuple):
    """All parts, by their positions in `NormalForm.nodes`; none at all is true."""

    parts: tuple[int, ...]


class Either(NamedTuple):
    """At least one part; none at all is false."""

    parts: tuple[int, ...]


class AtLeast(NamedTuple):
    """At least `needed` of the parts, which are more than that."""

    needed: int
    parts: tuple[int, ...]


class Exact(NamedTuple):
    """`needed` of the parts made true and all the others made false; `unwanted[i]` is what makes part i false."""

    needed: int
    wanted: tuple[int, ...]
    unwanted: tuple[int, ...]


Table: TypeAlias = tuple[tuple[int | None, ...], ...]


class Pairing(NamedTuple):
    """`needed` cells, no two of them in one row or in one column; None is a cell that cannot be chosen."""

    needed: int
    cells: Table


class NoPairing(NamedTuple):
    """Cells made false until no `needed` of the others can be chosen, no two in one row or in one column.

    A cell holds what makes it false, or None where it is false anyway.
    """

    needed: int
    cells: Table


NormalNode: TypeAlias = Lit | Every | Either | AtLeast | Exact | Pairing | NoPairing


class NormalForm(NamedTuple):
    """A formula as a graph of nodes.

    Attributes:
        nodes: Every node, after the nodes that it is made of.
        atoms: The atoms below each node, as a set of bits.
        root: The position of the node that stands for the whole formula.
    """

    nodes: tuple[NormalNode, ...]
    atoms: tuple[int, ...]
    root: int


def inside(node: NormalNode) -> tuple[int, ...]:
    """Returns the positions of the nodes that a node is directly made of."""
    match node:
        case Lit():
            return ()
        case Every(parts=parts) | Either(parts=parts) | AtLeast(parts=parts):
            return parts
        case Exact(wanted=wanted, unwanted=unwanted):
            return wanted + unwanted
        case Pairing(cells=cells) | NoPairing(cells=cells):
            return tuple(cell for row in cells for cell in row if cell is not None)


def bits(mask: int) -> Iterator[int]:
    """Yields the positions of the bits that are set, lowest first."""
    while mask:
        low = mask & -mask
        yield low.bit_length() - 1
        mask ^= low


class Builder:
    """A normal form under construction: equal nodes are made once, and constants are simplified away.

    Args:
        start: A form that another builder made, to go on from; None to begin with nothing.
    """

    def __init__(self, start: NormalForm | None = None) -> None:
        self.nodes: list[NormalNode] = [] if start is None else list(start.nodes)
        self.atoms: list[int] = [] if start is None else list(start.atoms)
        # Nodes are tuples, which are equal where their contents are, whatever their kind.
        self._made: dict[tuple[type, NormalNode], int] = {
            (type(node), node): position for position, node in enumerate(self.nodes)
        }
        self.true = self._make(Every(()))
        self.false = self._make(Either(()))

    def form(self, root: int) -> NormalForm:
        """Returns the normal form of the node at a position."""
        return NormalForm(tuple(self.nodes), tuple(self.atoms), root)

    def literal(self, atom: int, value: bool) -> int:
        """Returns the position of a literal."""
        return self._make(Lit(atom, value))

    def every(self, parts: Iterable[int]) -> int:
        """Returns the position of a conjunction."""
        kept = dict.fromkeys(part for part in parts if part != self.true)
        if self.false in kept:
            return self.false
        return next(iter(kept)) if len(kept) == 1 else self._make(Every(tuple(kept)))

    def either(self, parts: Iterable[int]) -> int:
        """Returns the position of a disjunction."""
        kept = dict.fromkeys(part for part in parts if part != self.false)
        if self.true in kept:
            return self.true
        return next(iter(kept)) if len(kept) == 1 else self._make(Either(tuple(kept)))

    def at_least(self, count: int, parts: Iterable[int]) -> int:
        """Returns the position of "at least so many of these"."""
        given = tuple(parts)
        count -= given.count(self.true)
        kept = tuple(part for part in given if part not in (self.true, self.false))
        if count <= 0:
            return self.true
        if count == 1:
            return self.either(kept)
        if count >= len(kept):
            return self.every(kept) if count == len(kept) else self.false
        return self._make(AtLeast(count, kept))

    def exact(self, count: int, wanted: Sequence[int], unwanted: Sequence[int]) -> int:
        """Returns the position of "exactly so many of these"; `unwanted` makes the parts of `wanted` false."""
        count -= sum(part == self.true for part in wanted)
        kept = [pair for pair in zip(wanted, unwanted, strict=True) if self.true not in pair]
        if count in (0, len(kept)):
            return self.every(pair[0 if count else 1] for pair in kept)
        if not 0 < count < len(kept):
            return self.false
        return self._make(Exact(count, tuple(pair[0] for pair in kept), tuple(pair[1] for pair in kept)))

    def pairing(self, count: int, cells: Table) -> int:
        """Returns the position of a choice of cells, no two in one row or column."""
        table = _closed(cells, self.false)
        if count <= 0:
            return self.true
        if count > _height(table) or count > _height(_columns(table)):
            return self.false
        if {*_contents(table)} == {self.true}:
            return self.false if cheapest_pairs(_open(table), count) is None else self.true
        if count == 1:
            return self.either(_contents(table))
        for lines in (table, _columns(table)):
            # What does not depend on the column can be chosen in any, so that only the rows count.
            if (equal := _equal_lines(lines)) is not None:
                return self.at_least(count, equal)
        return self._make(Pairing(count, table))

    def no_pairing(self, count: int, cells: Table) -> int:
        """Returns the position of the lack of such a choice; a cell holds what makes it false."""
        table = _closed(cells, self.true)
        if count <= 0:
            return self.false
        if count > _height(table) or count > _height(_columns(table)):
            return self.true
        if {*_contents(table)} == {self.false}:
            return self.true if cheapest_pairs(_open(table), count) is None else self.false
        if count == 1:
            return self.every(_contents(table))
        for lines in (table, _columns(table)):
            if (equal := _equal_lines(lines)) is not None:
                return self.at_least(len(equal) - count + 1, equal)
        return self._make(NoPairing(count, table))

    def rebuilt(self, node: NormalNode, made: Callable[[int], int]) -> int:
        """Returns the position of a node whose parts were replaced, each by what `made` says."""
        match node:
            case Lit(atom=atom, value=value):
                return self.literal(atom, value)
            case Every(parts=parts):
                return self.every(map(made, parts))
            case Either(parts=parts):
                return self.either(map(made, parts))
            case AtLeast(needed=count, parts=parts):
                return self.at_least(count, map(made, parts))
            case Exact(needed=count, wanted=wanted, unwanted=unwanted):
                return self.exact(count, [*map(made, wanted)], [*map(made, unwanted)])
            case Pairing(needed=count, cells=cells):
                return self.pairing(count, mapped(cells, made))
            case NoPairing(needed=count, cells=cells):
                return self.no_pairing(count, mapped(cells, made))

    def _make(self, node: NormalNode) -> int:
        key = (type(node), node)
        position = self._made.get(key)
        if position is None:
            position = self._made[key] = len(self.nodes)
            below = 1 << node.atom if isinstance(node, Lit) else 0
            for part in inside(node):
                below |= self.atoms[part]
            self.nodes.append(node)
            self.atoms.append(below)
        return position


_Cell = TypeVar("_Cell")


def mapped(cells: Sequence[Sequence[_Cell | None]], made: Callable[[_Cell], int]) -> Table:
    """Returns a table of positions: what `made` says of each cell that there is."""
    return tuple(tuple(None if cell is None else made(cell) for cell in row) for row in cells)


def _closed(cells: Table, hopeless: int) -> Table:
    """Returns the table in which a cell that cannot be chosen is None."""
    return tuple(tuple(None if cell == hopeless else cell for cell in row) for row in cells)


def _open(table: Table) -> list[list[int]]:
    """Returns the costs of cells that can be chosen at no cost, or not at all."""
    return [[INFINITE if cell is None else 0 for cell in row] for row in table]


def _columns(table: Table) -> Table:
    return tuple(zip(*table, strict=True))


def _height(table: Table) -> int:
    """Returns how many rows hold a cell that can be chosen."""
    return sum(any(cell is not None for cell in row) for row in table)


def _contents(table: Table) -> list[int]:
    return [cell for row in table for cell in row if cell is not None]


def _equal_lines(table: Table) -> list[int] | None:
    """Returns the one node that all cells of a row are, for each row; None when they differ or a cell is missing."""
    firsts: list[int] = []
    for row in table:
        if row[0] is None or any(cell != row[0] for cell in row):
            return None
        firsts.append(row[0])
    return firsts
