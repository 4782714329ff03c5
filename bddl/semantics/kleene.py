"""Values of formulas in one state or in many at once, known in part: strong Kleene logic on two sets of states.

A value is a pair of whole numbers with a bit for each state: where a formula is true for sure, and where it is possibly
true; where it is only possibly true, it is unknown. One state takes one bit. A form is evaluated by taking the values
of its operands one after the other, until they decide it in every state or none is left.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import reduce
from operator import or_
from typing import Final, Protocol, TypeAlias

from bddl.semantics.matching import has_matching

# States as a set of bits.
States: TypeAlias = int
# The states where something is true for sure, and those where it is possibly true.
Value: TypeAlias = tuple[States, States]

TRUE: Final[Value] = (1, 1)
FALSE: Final[Value] = (0, 0)
UNKNOWN: Final[Value] = (0, 1)


def truth(value: Value, state: int = 0) -> bool | None:
    """Returns the value in one state: True, False, or None for unknown."""
    sure, possible = value
    if sure >> state & 1:
        return True
    return None if possible >> state & 1 else False


class Form(Protocol):
    """A connective or quantifier whose operands are being evaluated."""

    def take(self, value: Value) -> bool:
        """Takes the value of the next operand; True when no further one can change the result in any state."""

    def result(self) -> Value:
        """Returns the value, once it is decided or no operand is left."""


class Negated:
    """True where its operand is false."""

    __slots__ = ("_every", "_value")

    def __init__(self, every: States) -> None:
        self._every = every
        self._value: Value = (0, every)

    def take(self, value: Value) -> bool:
        """Takes its one operand."""
        self._value = value
        return True

    def result(self) -> Value:
        """Returns the negation."""
        sure, possible = self._value
        return self._every ^ possible, self._every ^ sure


class Conjunction:
    """True where all operands are."""

    __slots__ = ("_possible", "_sure")

    def __init__(self, every: States) -> None:
        self._sure = self._possible = every

    def take(self, value: Value) -> bool:
        """Takes an operand; decided where it is false."""
        self._sure &= value[0]
        self._possible &= value[1]
        return not self._possible

    def result(self) -> Value:
        """Returns the conjunction of the operands so far."""
        return self._sure, self._possible


class Disjunction:
    """True where some operand is."""

    __slots__ = ("_every", "_possible", "_sure")

    def __init__(self, every: States) -> None:
        self._every = every
        self._sure = self._possible = 0

    def take(self, value: Value) -> bool:
        """Takes an operand; decided where it is true."""
        self._sure |= value[0]
        self._possible |= value[1]
        return self._sure == self._every

    def result(self) -> Value:
        """Returns the disjunction of the operands so far."""
        return self._sure, self._possible


class Counting:
    """True where exactly so many of its operands are.

    Args:
        count: How many.
        total: How many operands there are.
        every: All states.
    """

    __slots__ = ("_every", "_false", "_true")

    def __init__(self, count: int, total: int, every: States) -> None:
        self._every = every
        # Where at least k operands are true, and where at least k are false, by k. One past the last is too many.
        self._true = [every] + [0] * (count + 1)
        self._false = [every] + [0] * max(0, total - count + 1)

    def take(self, value: Value) -> bool:
        """Takes an operand; decided where too many are true, or too few can be."""
        sure, possible = value
        _count(self._true, sure)
        _count(self._false, self._every ^ possible)
        return self._true[-1] | self._false[-1] == self._every

    def result(self) -> Value:
        """Returns where the count is right: as many are true as wanted, and all others are false."""
        ruled_out = self._true[-1] | self._false[-1]
        # Where more are wanted than there are, the list of the false ones has one entry, which rules out all states.
        sure = self._true[-2] & self._false[-2] if len(self._false) > 1 else 0
        return sure, self._every ^ ruled_out


class CellTable:
    """True where `count` cells of a table can be chosen, no two in one row or column.

    Args:
        count: How many.
        places: Row and column of each operand, in order.
        matching: False to ask only for `count` rows and `count` columns with a true cell, as the reference does.
        every: All states.
    """

    __slots__ = ("_cells", "_count", "_every", "_matching", "_places")

    def __init__(self, count: int, places: Iterator[tuple[int, int]], matching: bool, every: States) -> None:
        self._count = count
        self._places = places
        self._matching = matching
        self._every = every
        self._cells: list[tuple[tuple[int, int], Value]] = []

    def take(self, value: Value) -> bool:
        """Takes the next cell; every cell is needed."""
        self._cells.append((next(self._places), value))
        return False

    def result(self) -> Value:
        """Returns the value of the table: it is monotone, so sure cells make it sure and possible ones possible."""
        sure = self._where([(place, value[0]) for place, value in self._cells])
        return sure, self._where([(place, value[1]) for place, value in self._cells])

    def _where(self, cells: Sequence[tuple[tuple[int, int], States]]) -> States:
        rows: dict[int, list[States]] = {}
        columns: dict[int, list[States]] = {}
        for (row, column), states in cells:
            rows.setdefault(row, []).append(states)
            columns.setdefault(column, []).append(states)
        found = self._lines_with_a_cell(rows) & self._lines_with_a_cell(columns)
        # By König's theorem, where two cells cannot be chosen, one row or one column holds all of them.
        if self._count <= 2 or not self._matching:
            return found
        return sum([state for state in _each(found) if has_matching(_rows(cells, state), self._count)])

    def _lines_with_a_cell(self, lines: dict[int, list[States]]) -> States:
        """Returns where at least `count` lines have a true cell."""
        reached = [self._every] + [0] * self._count
        for line in lines.values():
            _count(reached, reduce(or_, line))
        return reached[-1]


def _count(reached: list[States], states: States) -> None:
    """Counts one operand more: `reached[k]` is where at least k operands were counted."""
    for number in range(len(reached) - 1, 0, -1):
        reached[number] |= reached[number - 1] & states


def _each(states: States) -> Iterator[States]:
    while states:
        state = states & -states
        states ^= state
        yield state


def _rows(cells: Sequence[tuple[tuple[int, int], States]], state: States) -> list[int]:
    """Returns the true cells of one state: for each row its columns, as a set of bits."""
    rows: dict[int, int] = {}
    for (row, column), states in cells:
        rows[row] = rows.get(row, 0) | (1 << column if states & state else 0)
    return list(rows.values())
