"""States as sets of bits: which of some atoms are true, and which are false."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from bddl.semantics.truth import State
from bddl.syntax import Atom


def known_bits(bits: Iterable[tuple[Atom, int]], state: State) -> tuple[int, int]:
    """Returns the bits of the atoms that are true in a state and of those that are false; others are unknown.

    Args:
        bits: Atoms, each with its bit.
        state: A mapping in which an absent atom is unknown, or a function that returns None for unknown.
    """
    known = state.get if isinstance(state, Mapping) else state
    true = false = 0
    for atom, bit in bits:
        value = known(atom)
        if value:
            true |= bit
        elif value is not None:
            false |= bit
    return true, false


def numbered(atoms: Iterable[Atom]) -> tuple[tuple[Atom, int], ...]:
    """Returns each atom with its bit: the first with 1, the second with 2, the third with 4."""
    return tuple([(atom, 1 << index) for index, atom in enumerate(atoms)])


_BINARY_DIGITS = bytes([48] + [49] * 255)


def packed(flags: bytes | bytearray) -> int:
    """Returns the number whose bit i is set where byte i is not zero."""
    # Reading binary digits is much faster than shifting bits one by one, and takes linear time.
    return int(flags[::-1].translate(_BINARY_DIGITS) or b"0", 2)
