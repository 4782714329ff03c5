"""The cheapest choice of a given number of cells of a table, no two in one row or in one column.

Libraries choose as many cells as there are rows or columns; here a smaller number may be wanted, on small tables,
once for each step of a simulation.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

# The cost of what cannot be had. Costs are whole numbers, so sums of them stay exact; whatever reaches it is hopeless.
INFINITE: Final = 1 << 60


def cheapest_pairs(costs: Sequence[Sequence[int]], count: int) -> list[tuple[int, int]] | None:
    """Returns the cells of a cheapest choice, or None when so many cannot be chosen.

    Args:
        costs: Cost of each cell, from 0; a cell that costs `INFINITE` or more cannot be chosen.
        count: How many cells to choose.

    Source: successive shortest paths with node potentials (Ahuja, Magnanti and Orlin, Network Flows, section 9.7);
        after k augmentations the choice is a cheapest one of k cells.

    Example:
        >>> cheapest_pairs([[1, 0], [5, 1]], 2)
        [(0, 0), (1, 1)]
    """
    if count > len(costs):
        return None
    search = _Augmenting(costs)
    for _ in range(count):
        if not search.augment():
            return None
    return [(row, column) for row, column in enumerate(search.column_of) if column >= 0]


class _Augmenting:
    """A cheapest choice of k cells, which each augmentation turns into one of k + 1."""

    def __init__(self, costs: Sequence[Sequence[int]]) -> None:
        self.costs = costs
        width = len(costs[0]) if costs else 0
        self.column_of = [-1] * len(costs)
        self.row_of = [-1] * width
        self.row_potential = [0] * len(costs)
        self.column_potential = [0] * width

    def augment(self) -> bool:
        """Chooses one cell more; False when there is no way to."""
        width = len(self.row_of)
        distance = [INFINITE] * width
        reached_from = [-1] * width
        for row, column in enumerate(self.column_of):
            if column < 0:
                self._relax(row, 0, distance, reached_from)
        unsettled = set(range(width))
        while unsettled:
            nearest = min(unsettled, key=distance.__getitem__)
            if distance[nearest] >= INFINITE:
                break
            unsettled.remove(nearest)
            if (row := self.row_of[nearest]) >= 0:
                self._relax(row, distance[nearest], distance, reached_from)
        ends = [c for c in range(width) if self.row_of[c] < 0 and distance[c] < INFINITE]
        if not ends:
            return False
        end = min(ends, key=lambda column: distance[column] + self.column_potential[column])
        for column, length in enumerate(distance):
            if length < INFINITE:
                self.column_potential[column] += length
                if (row := self.row_of[column]) >= 0:
                    self.row_potential[row] += length
        self._flip(end, reached_from)
        return True

    def _relax(self, row: int, length: int, distance: list[int], reached_from: list[int]) -> None:
        base = length + self.row_potential[row]
        for column, cost in enumerate(self.costs[row]):
            if cost < INFINITE and column != self.column_of[row]:
                through = base + cost - self.column_potential[column]
                if through < distance[column]:
                    distance[column] = through
                    reached_from[column] = row

    def _flip(self, column: int, reached_from: list[int]) -> None:
        while column >= 0:
            row = reached_from[column]
            before = self.column_of[row]
            self.column_of[row], self.row_of[column] = column, row
            column = before
