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
        raise TypeError(f"A state has atoms, or tuples such as ('open', 'fridge_0'), for its keys, not {first!r}.")
    facts = cast("Mapping[Fact, bool]", state)
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


def _no_state(state: object) -> TypeError:
    advice = (
        " A set says what is true and not what is unknown: give a mapping, or compile the goal, which takes sets for "
        "complete states."
        if isinstance(state, Set)
        else ""
    )
    return TypeError(f"A state is a mapping from atoms to values or a function of an atom, not {state!r:.80}.{advice}")
