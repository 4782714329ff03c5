"""States as sets of bits: which of some atoms are true, and which are false."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from bddl.semantics.knownstate import Lookup, State, lookup, lookup_in_both, truth_value
from bddl.syntax import Atom


def known_bits(bits: Iterable[tuple[Atom, int]], state: State) -> tuple[int, int]:
    """Returns the bits of the atoms that are true in a state and of those that are false; others are unknown.

    Args:
        bits: Atoms, each with its bit.
        state: A mapping in which an absent atom is unknown, or a function that returns None for unknown.

    Raises:
        TypeError: It is no state, or the value of an atom is none.
    """
    pairs = tuple(bits)
    true, false = _bits(pairs, lookup(state))
    if isinstance(state, Mapping) and (true | false).bit_count() < len(pairs):
        both = lookup_in_both(state)
        if both is not None:
            return _bits(pairs, both)
    return true, false


def _bits(bits: Iterable[tuple[Atom, int]], known: Lookup) -> tuple[int, int]:
    """Returns the bits of what a lookup finds true, and of what it finds false."""
    true = false = 0
    for atom, bit in bits:
        value: object = known(atom)
        if value is None:
            continue
        if value is True or (value is not False and truth_value(value)):
            true |= bit
        else:
            false |= bit
    return true, false


def numbered(atoms: Iterable[Atom]) -> tuple[tuple[Atom, int], ...]:
    """Returns each atom with its bit: the first with 1, the second with 2, the third with 4."""
    return tuple([(atom, 1 << index) for index, atom in enumerate(atoms)])


# What is neither 0 nor 1 becomes no digit, so that reading it fails.
_BINARY_DIGITS = b"01" + b"?" * 254


def packed(flags: bytes | bytearray) -> int:
    """Returns the number whose bit i is byte i.

    Raises:
        ValueError: A byte is neither 0 nor 1.
    """
    # Reading binary digits is much faster than shifting bits one by one, and takes linear time.
    return int(flags[::-1].translate(_BINARY_DIGITS) or b"0", 2)
