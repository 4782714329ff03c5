"""Pairing off: whether enough cells of a table can be chosen, no two of them in one row or in one column.

An algorithm of its own, since truth needs its answer for tables of three rows in a microsecond or two; the libraries
that have one first build a graph or a sparse matrix, which takes longer than the answer.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TypeAlias

# A table of true cells: one number for each row, in which bit j says whether the cell of column j is true.
Rows: TypeAlias = Sequence[int]
PairTest: TypeAlias = Callable[[Rows, int], bool]


def has_matching(rows: Rows, count: int) -> bool:
    """Decides whether `count` true cells can be chosen, no two in one row or column.

    Source: augmenting paths, one breadth-first search for each row (Kuhn's method). A row that finds none will find
    none later either, so the search ends as soon as too many rows went without.
    """
    columns = taken = filled = placed = 0
    for row in rows:
        if row:
            filled += 1
            columns |= row
            free = row & ~taken
            if free:
                taken |= free & -free
                placed += 1
    # Most tables are decided by taking the first free column of each row, or by counting rows and columns.
    if placed >= count:
        return True
    if filled < count or columns.bit_count() < count:
        return False
    # By König's theorem, where two cells cannot be chosen, one row or one column holds all of them.
    return count <= 2 or _Pairing(rows).reaches(count)


def covers(rows: Rows, count: int) -> bool:
    """Decides whether at least `count` rows and at least `count` columns have a true cell."""
    columns = 0
    filled = 0
    for row in rows:
        if row:
            columns |= row
            filled += 1
    return filled >= count and columns.bit_count() >= count


def decide(test: PairTest, count: int, sure: Rows, possible: Rows) -> bool | None:
    """Returns what a test says of a table that is known in part: cells that are true for sure, and that may be.

    Both tests are monotone, so the sure cells alone decide that it holds, and all possible ones that it does not.
    """
    if test(sure, count):
        return True
    return None if test(possible, count) else False


class _Pairing:
    """Rows and the columns that were chosen for them so far."""

    __slots__ = ("column_of", "row_of", "rows", "taken")

    def __init__(self, rows: Rows) -> None:
        self.rows = rows
        self.row_of: dict[int, int] = {}
        self.column_of: dict[int, int] = {}
        self.taken = 0

    def reaches(self, count: int) -> bool:
        """Chooses cells row by row until there are `count` of them, or until too few rows are left."""
        spare = len(self.rows) - count
        for row in range(len(self.rows)):
            if not self._place(row):
                spare -= 1
                if spare < 0:
                    return False
            elif len(self.column_of) == count:
                return True
        return count <= 0

    def _place(self, row: int) -> bool:
        """Finds a column for a row, moving others on if need be; False when there is no way."""
        waiting = [row]
        seen = 0
        reached_from: dict[int, int] = {}
        for current in waiting:
            free = self.rows[current] & ~self.taken
            if free:
                self._move_on(current, (free & -free).bit_length() - 1, reached_from)
                return True
            fresh = self.rows[current] & ~seen
            seen |= fresh
            while fresh:
                column = (fresh & -fresh).bit_length() - 1
                fresh &= fresh - 1
                reached_from[column] = current
                waiting.append(self.row_of[column])
        return False

    def _move_on(self, row: int, column: int, reached_from: dict[int, int]) -> None:
        """Gives a row its new column, its old column to the row it was reached from, and so on to the first."""
        self.taken |= 1 << column
        while True:
            before = self.column_of.get(row)
            self.column_of[row] = column
            self.row_of[column] = row
            if before is None:
                return
            column, row = before, reached_from[before]
