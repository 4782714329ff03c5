"""States in the forms in which they are given: known in part or complete, by atoms, by tuples or by position."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence, Set, Sized
from typing import Any, TypeAlias, cast

from bddl.syntax import Atom
from bddl.syntax.errors import WrongState

# An atom as text: its predicate and its arguments. Many simulators keep their state so.
Fact: TypeAlias = tuple[str, ...]
State: TypeAlias = Mapping[Atom, bool] | Mapping[Fact, bool] | Callable[[Atom], bool | None]
Lookup: TypeAlias = Callable[[Atom], bool | None]
# A packed state; what is true, as atoms or as facts; values by atom; or values in the order of some atoms.
TotalState: TypeAlias = int | Set[Atom] | Set[Fact] | Mapping[Atom, bool] | Mapping[Fact, bool] | Sequence[bool]


def lookup(state: State) -> Lookup:
    """Returns the function that says what a state has of an atom: its value, or None where that is unknown.

    Args:
        state: A mapping from atoms, or from tuples such as `("open", "fridge_0")`, in which an absent one is unknown;
            or such a function.

    Raises:
        TypeError: It is none of these.
    """
    if not isinstance(state, Mapping):
        if callable(state):
            return state
        raise _no_state(state)
    first = next(iter(state), None)
    if first is None or isinstance(first, Atom):
        return cast("Mapping[Atom, bool]", state).get
    if not isinstance(first, tuple):
        raise _no_key(first)
    facts = cast("Mapping[Fact, bool]", state)
    return lambda atom: facts.get(atom.label)


def lookup_in_both(state: Mapping[Atom, bool] | Mapping[Fact, bool]) -> Lookup | None:
    """Returns the lookup for a state that names some atoms by tuples and some by themselves; None where none does so.

    `lookup` goes by the first key, since looking at all of them takes longer than most questions. What it finds is so
    in either case; this is for what it does not find.

    Raises:
        TypeError: A key is neither, or an atom has two values, one under each name.
    """
    if len(set(map(type, state))) < 2:
        return None
    facts: dict[object, bool] = {}
    for key, value in state.items():
        if not isinstance(key, Atom | tuple):
            raise _no_key(key)
        label = key.label if isinstance(key, Atom) else key
        if facts.setdefault(label, value) != value:
            raise TypeError(f"A state gives {label!r} two values, once as an atom and once as a tuple.")
    return lambda atom: facts.get(atom.label)


def truth_value(value: object) -> bool:
    """Returns a value that is no plain bool as one: 1 and 0 count, and so do the booleans of numpy.

    Raises:
        TypeError: It is another value: a probability, say, is no truth value.
    """
    try:
        if value in (True, False):
            return bool(value)
    except ValueError:
        pass  # An array, which compares to several values at once.
    raise TypeError(f"The value of an atom is True, False or, where it may be unknown, None; not {value!r}.")


def known_bits(atoms: Sequence[Atom], state: State) -> tuple[int, int]:
    """Returns which atoms are true in a state and which are false, as sets of bits; the others are unknown.

    Args:
        atoms: The atoms; bit i stands for the i-th.
        state: A mapping in which an absent atom is unknown, or a function that returns None for unknown.

    Raises:
        TypeError: It is no state, or the value of an atom is none.
    """
    values = _values(atoms, lookup(state))
    if None in values and isinstance(state, Mapping):
        both = lookup_in_both(state)
        if both is not None:
            values = _values(atoms, both)
    return _bits([value is True for value in values]), _bits([value is False for value in values])


class AtomNames:
    """Some atoms under both of their names.

    Attributes:
        atoms: The atoms.
        facts: The same as tuples of a predicate and its arguments.
    """

    __slots__ = ("atoms", "facts")

    def __init__(self, atoms: Sequence[Atom]) -> None:
        self.atoms = atoms
        self.facts: Sequence[Fact] = [atom.label for atom in atoms]


def packed(names: AtomNames, state: TotalState) -> int:
    """Returns a complete state as a number whose bit i is the value of the i-th atom.

    Raises:
        WrongState: It is in none of the forms of `TotalState`, or does not fit the atoms.
    """
    width = len(names.atoms)
    if type(state) is int:
        if state < 0 or state.bit_length() > width:
            size = "negative" if state < 0 else f"of {state.bit_length()} bits, where a packed state has {width},"
            raise WrongState(width, f"a number that is {size}")
        return state
    given: Any = state
    if isinstance(given, Set | Mapping):
        first = next(iter(given), None)
        if first is not None and not isinstance(first, Atom | tuple):
            raise WrongState(width, f"a collection of {type(first).__name__}, such as {first!r:.40},")
        wanted: Sequence[Any] = names.facts if isinstance(first, tuple) else names.atoms
        if isinstance(given, Set):
            return _bits([name in given for name in wanted])
        given = [given.get(name, False) for name in wanted]
    if not isinstance(given, Iterable) or isinstance(given, str) or not isinstance(given, Sized):
        raise WrongState(width, f"a {type(state).__name__}")
    if len(given) != width:
        raise WrongState(width, f"{len(given)} values")
    try:
        return _bits([truth_value(value) for value in given])
    except TypeError:
        kind = "list" if isinstance(state, Mapping) else type(state).__name__
        raise WrongState(width, f"a {kind} with values other than true and false") from None


def _values(atoms: Sequence[Atom], known: Lookup) -> list[bool | None]:
    return [None if (value := known(atom)) is None else truth_value(value) for atom in atoms]


def _bits(flags: Sequence[bool]) -> int:
    """Returns the number whose bit i is the i-th flag."""
    # Reading binary digits takes linear time, setting bits one by one quadratic.
    return int("".join(["1" if flag else "0" for flag in reversed(flags)]) or "0", 2)


def _no_key(key: object) -> TypeError:
    return TypeError(f"A state has atoms, or tuples such as ('open', 'fridge_0'), for its keys, not {key!r}.")


def _no_state(state: object) -> TypeError:
    advice = (
        " A set says what is true and not what is unknown: give a mapping, or compile the goal, which takes sets for "
        "complete states."
        if isinstance(state, Set)
        else ""
    )
    return TypeError(f"A state is a mapping from atoms to values or a function of an atom, not {state!r:.80}.{advice}")
