"""What it costs to make each node of a normal form true, when each literal has a price."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from heapq import nsmallest
from operator import itemgetter
from typing import TypeAlias

from bddl.goals.assignment import INFINITE, cheapest_pairs
from bddl.goals.normal import AtLeast, Either, Every, Exact, Lit, NoPairing, NormalForm, NormalNode, Pairing, Table

Price: TypeAlias = Callable[[Lit], int]
_Values: TypeAlias = list[int]
_Step: TypeAlias = Callable[[_Values], int]


class Costs:
    """Costs of all nodes of a normal form, computed in one pass from the literals up.

    A conjunction costs the sum of its parts, a disjunction the least; of counted parts the cheapest are taken, of a
    table the cheapest pairs. Where parts that are needed together share no atom, this is the exact price of the
    cheapest set of literals that makes a node true. Zero is exact in any case: a node costs nothing exactly when the
    free literals make it true.

    Args:
        form: The normal form.
        price: The price of a literal, by its node: a whole number from 1.
        whole_price: The price of a literal of an atom that is singled out; the same if None.
    """

    __slots__ = ("_literals", "_size", "_steps")

    def __init__(self, form: NormalForm, price: Price, whole_price: Price | None = None) -> None:
        self._size = len(form.nodes)
        self._literals: list[tuple[int, int, bool, int, int]] = []
        self._steps: list[tuple[int, _Step]] = []
        for position, node in enumerate(form.nodes):
            if isinstance(node, Lit):
                alone = price(node) if whole_price is None else whole_price(node)
                self._literals.append((position, 1 << node.atom, node.value, price(node), alone))
            else:
                self._steps.append((position, _step(node)))

    def sweep(self, true: int, false: int, never_true: int = 0, never_false: int = 0, whole: int = 0) -> list[int]:
        """Returns the cost of each node, `INFINITE` or more for what cannot be made true.

        Args:
            true: Atoms that are true at no price, as a set of bits.
            false: Atoms that are false at no price.
            never_true: Atoms that cannot be made true, whatever one pays.
            never_false: Atoms that cannot be made false.
            whole: Atoms that are singled out, so that their literals have the other price.
        """
        values = [0] * self._size
        for position, bit, value, price, whole_price in self._literals:
            free, barred = (true, never_true) if value else (false, never_false)
            if not free & bit:
                values[position] = INFINITE if barred & bit else whole_price if whole & bit else price
        for position, step in self._steps:
            values[position] = step(values)
        return values


def exact_cost(count: int, wanted: Iterable[int], unwanted: Sequence[int]) -> int:
    """Returns what it costs to make so many parts true and the others false.

    Args:
        count: How many, at most as many as there are parts.
        wanted: What it costs to make each part true.
        unwanted: What it costs to make each part false.
    """
    # All are made false at first; then those are made true instead for which that is the least expensive.
    changes = sorted(true - false for true, false in zip(wanted, unwanted, strict=True))
    return sum(unwanted) + sum(changes[:count])


def pairing_cost(count: int, costs: Sequence[Sequence[int]]) -> int:
    """Returns the cost of the cheapest choice of so many cells, no two in one row or in one column."""
    chosen = cheapest_pairs(costs, count)
    return INFINITE if chosen is None else sum(costs[row][column] for row, column in chosen)


def standing_pairs(count: int, costs: Sequence[Sequence[int]]) -> list[tuple[int, int]] | None:
    """Returns so many cells that are not false yet, no two in one row or column; None when there are none.

    Args:
        count: How many.
        costs: What it costs to make each cell false; 0 where it is.
    """
    return cheapest_pairs([[0 if cost else INFINITE for cost in row] for row in costs], count)


def no_pairing_cost(count: int, costs: Sequence[Sequence[int]]) -> int:
    """Returns no more than it costs to make cells false until no `count` of them can be chosen; 0 when none can.

    A cell made false takes one pair away at most; finding the cheapest set of cells is NP-hard (it is the problem of
    covering the most edges of a bipartite graph with a given number of its vertices).
    """
    excess = 0
    while standing_pairs(count + excess, costs) is not None:
        excess += 1
    return excess and excess * min(cost for row in costs for cost in row if cost)


def table_of(values: Sequence[int], cells: Table, missing: int) -> list[list[int]]:
    """Returns the costs of the cells of a table, with a value for those that are missing."""
    return [[missing if cell is None else values[cell] for cell in row] for row in cells]


def _step(node: NormalNode) -> _Step:
    """Returns the function that computes the cost of a node that is no literal from the costs before it."""
    match node:
        case Every(parts=()):
            return lambda values: 0
        case Either(parts=()):
            return lambda values: INFINITE
        case Every(parts=parts):
            of_parts = itemgetter(*parts)
            return lambda values: sum(of_parts(values))
        case Either(parts=parts):
            of_parts = itemgetter(*parts)
            return lambda values: min(of_parts(values))
        case AtLeast(needed=count, parts=parts):
            of_parts = itemgetter(*parts)
            return lambda values: sum(nsmallest(count, of_parts(values)))
        case Exact(needed=count, wanted=wanted, unwanted=unwanted):
            true, false = itemgetter(*wanted), itemgetter(*unwanted)
            return lambda values: exact_cost(count, true(values), false(values))
        case Pairing(needed=count, cells=cells):
            return lambda values: pairing_cost(count, table_of(values, cells, INFINITE))
        case NoPairing(needed=count, cells=cells):
            return lambda values: no_pairing_cost(count, table_of(values, cells, 0))
    raise TypeError(f"The cost of a literal is its price: {node!r}.")
