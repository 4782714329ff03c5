"""Pairing off: which cells of a table can be chosen, no two of them in one row or in one column.

An algorithm of its own, since truth needs its answer for tables of three rows in a few microseconds; the libraries that
have one first build a graph or a sparse matrix, which takes longer than the answer.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TypeAlias

# A table of true cells: one number for each row, in which bit j says whether the cell of column j is true.
Rows: TypeAlias = Sequence[int]


def has_matching(rows: Rows, count: int) -> bool:
    """Decides whether `count` true cells can be chosen, no two in one row or column."""
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
    return count <= 2 or len(largest_matching(rows)) >= count


def largest_matching(rows: Rows) -> dict[int, int]:
    """Returns as many true cells as can be chosen, no two in one row or column: for each column its row.

    Source: augmenting paths, one breadth-first search for each row (Kuhn's method).

    Example:
        >>> largest_matching([0b11, 0b01, 0b01])
        {0: 1, 1: 0}
    """
    row_of: dict[int, int] = {}
    column_of: dict[int, int] = {}
    for start in range(len(rows)):
        reached_from: dict[int, int] = {}
        end = _free_column(rows, start, row_of, reached_from)
        while end is not None:
            # Each row on the path takes the column that it reached, and leaves its own to the row before it.
            row = reached_from[end]
            before = column_of.get(row)
            column_of[row], row_of[end] = end, row
            end = before
    return row_of


def _free_column(rows: Rows, start: int, row_of: dict[int, int], reached_from: dict[int, int]) -> int | None:
    """Returns a column that no row has and that a row can get when others move on, or None; notes the way there."""
    waiting = [start]
    seen = 0
    for row in waiting:
        for column in _bits(rows[row] & ~seen):
            reached_from[column] = row
            if column not in row_of:
                return column
            waiting.append(row_of[column])
        seen |= rows[row]
    return None


def _bits(mask: int) -> Iterator[int]:
    while mask:
        low = mask & -mask
        yield low.bit_length() - 1
        mask ^= low
