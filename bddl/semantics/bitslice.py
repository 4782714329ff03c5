"""Circuits over many states at once: a whole number holds one signal in all states, one bit for each state.

Conjunctions are then `&` of long numbers, counts are adders of whole numbers, and matchings are a table over subsets
of the rows. Nothing of numpy is needed, and nothing depends on how many states there are.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache, reduce
from operator import or_
from typing import TypeAlias

from bddl.semantics.circuit import Circuit, Conjunction, Count, Gate, Table
from bddl.semantics.matching import has_matching

# The value of a signal in all states: bit i is its value in state i.
Column: TypeAlias = int
_Cells: TypeAlias = tuple[tuple[Column, ...], ...]

# A matching of more rows (and columns) is decided state by state: the table over subsets would have too many of them.
_MOST_ROWS_AT_ONCE = 9


def output_columns(circuit: Circuit, inputs: Sequence[Column], states: int) -> list[Column]:
    """Returns the value of each output of a circuit in all states.

    Args:
        circuit: The circuit.
        inputs: The value of each input in all states; bits past the number of states are zero.
        states: How many states there are.
    """
    every = (1 << states) - 1
    signals: list[Column] = []
    for column in inputs:
        signals += (column, column ^ every)
    for gate in circuit.gates:
        column = _gate_column(gate, signals, every)
        signals += (column, column ^ every)
    return [signals[output] for output in circuit.outputs]


def _gate_column(gate: Gate, signals: Sequence[Column], every: Column) -> Column:
    match gate:
        case Conjunction(inputs=inputs):
            column = every
            for signal in inputs:
                column &= signals[signal]
            return column
        case Count(count=count, inputs=inputs):
            return _exactly(count, [signals[signal] for signal in inputs], every)
        case Table(count=count, cells=cells, matching=matching):
            columns = tuple(tuple(0 if cell is None else signals[cell] for cell in row) for row in cells)
            covered = _covered(count, columns, every)
            # Two pairs are there as soon as two rows and two columns are covered; see `has_matching`.
            return covered if count <= 2 or not matching or not covered else _matched(count, columns, covered)


def _exactly(count: int, parts: Sequence[Column], every: Column) -> Column:
    """Returns where exactly so many parts are true, by a binary counter of one digit a column."""
    digits: list[Column] = []
    for part in parts:
        carry = part
        for place, digit in enumerate(digits):
            digits[place] = digit ^ carry
            carry &= digit
            if not carry:
                break
        else:
            digits.append(carry)
    if count >> len(digits):
        return 0
    found = every
    for place, digit in enumerate(digits):
        found &= digit if count >> place & 1 else digit ^ every
    return found


def _at_least(count: int, parts: Sequence[Column], every: Column) -> Column:
    """Returns where at least so many parts are true."""
    reached = [every] + [0] * count
    for part in parts:
        for number in range(count, 0, -1):
            reached[number] |= reached[number - 1] & part
    return reached[count]


def _covered(count: int, cells: _Cells, every: Column) -> Column:
    """Returns where at least `count` rows and at least `count` columns have a true cell."""
    rows = _at_least(count, [reduce(or_, row, 0) for row in cells], every)
    return rows and rows & _at_least(count, [reduce(or_, column, 0) for column in zip(*cells, strict=True)], every)


def _matched(count: int, cells: _Cells, covered: Column) -> Column:
    """Returns where `count` cells can be paired off, among the states where enough rows and columns are covered."""
    columns = tuple(zip(*cells, strict=True))
    rows, columns = (cells, columns) if len(cells) <= len(columns) else (columns, cells)
    if len(rows) > _MOST_ROWS_AT_ONCE:
        return _matched_one_by_one(count, rows, covered)
    # placed[s] is where the rows of subset s have different columns among those seen so far.
    placed = [covered] + [0] * ((1 << len(rows)) - 1)
    subsets = _subsets(len(rows), count)
    for column in columns:
        for subset, members in subsets:
            for row, rest in members:
                placed[subset] |= placed[rest] & column[row]
    return reduce(or_, (placed[subset] for subset, members in subsets if len(members) == count), 0)


@lru_cache(maxsize=64)
def _subsets(rows: int, most: int) -> tuple[tuple[int, tuple[tuple[int, int], ...]], ...]:
    """Returns the subsets of so many rows, of 1 to `most` members, greater first: each with (member, the rest)."""
    return tuple(
        (subset, tuple((row, subset ^ 1 << row) for row in range(rows) if subset >> row & 1))
        for subset in range((1 << rows) - 1, 0, -1)
        if subset.bit_count() <= most
    )


def _matched_one_by_one(count: int, rows: _Cells, covered: Column) -> Column:
    found = 0
    left = covered
    while left:
        state = left & -left
        left ^= state
        if has_matching([sum(1 << j for j, cell in enumerate(row) if cell & state) for row in rows], count):
            found |= state
    return found
