"""States that are known in part, in the forms in which they are given."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Set
from typing import TypeAlias, cast

from bddl.syntax import Atom

# An atom as text: its predicate and its arguments. Many simulators keep their state so.
Fact: TypeAlias = tuple[str, ...]
State: TypeAlias = Mapping[Atom, bool] | Mapping[Fact, bool] | Callable[[Atom], bool | None]
Lookup: TypeAlias = Callable[[Atom], bool | None]


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


def _no_key(key: object) -> TypeError:
    return TypeError(f"A state has atoms, or tuples such as ('open', 'fridge_0'), for its keys, not {key!r}.")


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


def _no_state(state: object) -> TypeError:
    advice = (
        " A set says what is true and not what is unknown: give a mapping, or compile the goal, which takes sets for "
        "complete states."
        if isinstance(state, Set)
        else ""
    )
    return TypeError(f"A state is a mapping from atoms to values or a function of an atom, not {state!r:.80}.{advice}")
