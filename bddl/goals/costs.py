"""What it costs to make each node of a normal form true, when each literal has a price."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from heapq import nsmallest
from itertools import accumulate
from operator import itemgetter
from typing import NamedTuple, TypeAlias

from bddl.goals.assignment import INFINITE, cheapest_pairs
from bddl.goals.normal import AtLeast, Either, Every, Exact, Lit, NoPairing, NormalForm, NormalNode, Pairing, Table
from bddl.semantics.matching import has_matching

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
    least = [min(row, default=INFINITE) for row in costs]
    rows = nsmallest(count, range(len(costs)), key=least.__getitem__)
    total = sum([least[row] for row in rows])
    if total >= INFINITE:
        return INFINITE
    # No choice costs less than that. Where cells that cost the least in their rows can be chosen, it is the answer.
    cheap = [sum([1 << column for column, cost in enumerate(costs[row]) if cost == least[row]]) for row in rows]
    if has_matching(cheap, count):
        return total
    chosen = cheapest_pairs(costs, count)
    return INFINITE if chosen is None else sum(costs[row][column] for row, column in chosen)


def pairs_stand(count: int, costs: Sequence[Sequence[int]]) -> bool:
    """Decides whether so many cells are not false yet, no two in one row or column.

    Args:
        count: How many.
        costs: What it costs to make each cell false; 0 where it is.
    """
    return has_matching([sum([1 << column for column, cost in enumerate(row) if cost]) for row in costs], count)


def no_pairing_cost(count: int, costs: Sequence[Sequence[int]]) -> int:
    """Returns no more than it costs to make cells false until no `count` of them can be chosen; 0 when none can.

    A cell made false takes one pair away at most, and all cells outside of some `count - 1` rows and columns have to
    be false. Finding the cheapest set of cells is NP-hard (it is the problem of covering the most edges of a bipartite
    graph with a given number of its vertices).
    """
    excess = 0
    while pairs_stand(count + excess, costs):
        excess += 1
    if not excess:
        return 0
    cells = min(cost for row in costs for cost in row if cost)
    lines = Lines(tuple(range(len(costs))), tuple(range(len(costs[0]))))
    return max(excess * cells, uncovered_cost(count - 1, costs, Lines((), ()), lines))


class Lines(NamedTuple):
    """Some rows and some columns of a table."""

    rows: tuple[int, ...]
    columns: tuple[int, ...]


def uncovered_cost(spare: int, costs: Sequence[Sequence[int]], bare: Lines, left: Lines) -> int:
    """Returns no more than it costs to make all cells false that some choice of lines leaves uncovered.

    However many of the lines are rows, each row that is not chosen pays at least for its cheapest cells, as many as
    there are columns that are not chosen; and the other way round.

    Args:
        spare: How many lines may be chosen.
        costs: What it costs to make each cell false; 0 where it is.
        bare: Lines that are not chosen; the cells where two of them cross are paid for already.
        left: Lines that may be chosen.
    """
    by_rows = [_line_costs([costs[row] for row in rows], bare.columns, left.columns, paid=rows is bare.rows)
               for rows in (bare.rows, left.rows)]  # fmt: skip
    table = [*zip(*costs, strict=True)]
    by_columns = [_line_costs([table[column] for column in columns], bare.rows, left.rows, paid=columns is bare.columns)
                  for columns in (bare.columns, left.columns)]  # fmt: skip
    least = INFINITE if spare < len(left.rows) + len(left.columns) else 0
    for in_rows in range(max(0, spare - len(left.columns)), min(spare, len(left.rows)) + 1):
        open_rows, open_columns = len(left.rows) - in_rows, len(left.columns) - (spare - in_rows)
        least = min(
            least, max(_cheapest(by_rows, open_rows, open_columns), _cheapest(by_columns, open_columns, open_rows))
        )
    return least


def _line_costs(
    lines: Sequence[Sequence[int]], bare: Sequence[int], left: Sequence[int], *, paid: bool
) -> list[list[int]]:
    """Returns for each line what it costs at least, by the number of lines left that cross it and are not chosen."""
    return [
        [*accumulate(sorted([line[at] for at in left]), initial=0 if paid else sum([line[at] for at in bare]))]
        for line in lines
    ]


def _cheapest(lines: Sequence[Sequence[Sequence[int]]], count: int, crossing: int) -> int:
    bare, left = lines
    return sum([line[crossing] for line in bare]) + sum(sorted([line[crossing] for line in left])[:count])


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
