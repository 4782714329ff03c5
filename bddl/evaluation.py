"""Truth of formulas in states that are known in part, by strong Kleene logic.

Pairs are decided by a matching algorithm of our own, since tables of three rows need an answer in a few microseconds.
Libraries first build a graph or a sparse matrix, which takes longer than the answer.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterable, Iterator, Mapping, Sequence, Set
from importlib import import_module
from itertools import repeat
from typing import TYPE_CHECKING, Any, TypeAlias, cast

from bddl.ast import And, Atom, Exists, ForAll, Formula, ForN, ForPairs, Imply, Not, Or
from bddl.grounding import Members, PairSemantics, check_pair_semantics, smaller_side
from bddl.problem import Objects

if TYPE_CHECKING:
    from bddl.dialects import Profile

# An atom as text: its predicate and its arguments. Many simulators keep their state so.
Fact: TypeAlias = tuple[str, ...]
# A set has the facts that are true; all others are false.
State: TypeAlias = Mapping[Atom, bool] | Mapping[Fact, bool] | Callable[[Atom], bool | None] | Set[Atom | Fact | str]

# Bindings form a linked list, innermost first: (variable, object, outer bindings).
_Bindings: TypeAlias = "tuple[str, str, _Bindings] | None"
_Operand: TypeAlias = tuple[Formula, _Bindings]
# A form asks for its operands one by one, is sent the value of each, and returns its own as soon as that is decided.
_Form: TypeAlias = Generator[_Operand, bool | None, bool | None]


def evaluate(
    formula: Formula | str,
    state: State,
    objects: Objects | None = None,
    *,
    pairs: PairSemantics = "matching",
    profile: str | Profile = "auto",
) -> bool | None:
    """Decide whether a formula holds in a state, as far as the state is known.

    The value is True or False when every completion of the state agrees on that by Kleene's tables, else None. Operands
    are evaluated from left to right, and evaluation stops as soon as the value is decided; the table of a `forpairs` is
    read in full. A quantifier over a category without objects is vacuous: `forall` and `forpairs` are true, `exists` is
    false. A wildcard of BEHAVIOR is counted as one object, of which CountedWildcard warns.

    Args:
        formula: Any formula, of any depth, or its text.
        state: A mapping in which an absent atom is unknown, a function that returns None for unknown, or the set of all
            facts that are true. Keys and facts are atoms, or tuples such as `("open", "fridge_0")`, or some of each;
            facts may be texts as well.
        objects: Category of each object, or the declared objects of a problem; needed for quantifiers. The category
            `object` holds all of them.
        pairs: `matching` reads `forpairs` and `fornpairs` as a choice of disjoint pairs; `reference` counts rows and
            columns with a true cell, as the reference implementation does.
        profile: The dialect of texts, or its name.

    Source: docs/bddl.md, Truth; the reference implementation is two-valued and does not stop early.

    Example:
        >>> import bddl
        >>> goal = bddl.parse_formula("(or (open refrigerator_0) (inside glass_0 refrigerator_0))")
        >>> bddl.evaluate(goal, {bddl.Atom("open", ("refrigerator_0",)): True})
        True
        >>> bddl.evaluate(goal, {}) is None
        True
        >>> bddl.evaluate("(not (open refrigerator_0))", {"(inside glass_0 refrigerator_0)"})
        True
    """
    check_pair_semantics(pairs)
    # A function of the caller may return any value.
    known: Callable[[Atom], object] = lookup(state, profile)
    members = Members(objects, warns=True)
    node: Formula = _read(formula, profile) if isinstance(formula, str) else formula
    bindings: _Bindings = None
    # A stack instead of recursion, since formulas may be nested thousands deep.
    waiting: list[_Form] = []
    while True:
        value: bool | None = None
        if isinstance(node, Atom):
            found = known(node if bindings is None else _ground(node, bindings))
            value = found if found is None or isinstance(found, bool) else truth_value(found)
        else:
            waiting.append(_form(node, bindings, members, pairs))
        while waiting:
            try:
                node, bindings = waiting[-1].send(value)
                break
            except StopIteration as decided:
                value = decided.value
                waiting.pop()
        else:
            if value is None and isinstance(state, Mapping):
                _check_keys(state)
            return value


def _form(node: Formula, bindings: _Bindings, members: Members, pairs: PairSemantics) -> _Form:
    match node:
        case And(parts=parts):
            return _junction(zip(parts, repeat(bindings)), False)
        case Or(parts=parts):
            return _junction(zip(parts, repeat(bindings)), True)
        case Not(body=body):
            return _negation((body, bindings))
        case Imply(left=left, right=right):
            return _junction(iter([(Not(left), bindings), (right, bindings)]), True)
        case ForPairs():
            return _paired(node, bindings, members, pairs)
        case ForAll() | Exists() | ForN():
            bodies = [(node.body, (node.variable, name, bindings)) for name in members.of(node.binders[0])]
            return (
                _exactly(node.count, bodies) if isinstance(node, ForN) else _junction(bodies, isinstance(node, Exists))
            )
    raise TypeError(f"A formula was expected, not {node!r}.")


def _negation(operand: _Operand) -> _Form:
    value = yield operand
    return None if value is None else not value


def _junction(operands: Iterable[_Operand], decisive: bool) -> _Form:
    """A conjunction, which one false operand decides, or a disjunction, which one true operand decides."""
    result: bool | None = not decisive
    for operand in operands:
        value = yield operand
        if value is decisive:
            return decisive
        if value is None:
            result = None
    return result


def _exactly(count: int, operands: Sequence[_Operand]) -> _Form:
    true, possible = 0, len(operands)
    if possible < count:
        return False
    for operand in operands:
        value = yield operand
        true += value is True
        possible -= value is False
        if true > count or possible < count:
            return False
    return True if true == possible else None


def _paired(node: ForPairs, bindings: _Bindings, members: Members, pairs: PairSemantics) -> _Form:
    """A table of pairs: true when the cells known to be true suffice, false when not even all possible ones do."""
    table = members.pairs(*node.binders, closed_up=pairs == "reference")
    count = smaller_side(table) if node.number is None else node.number
    true: list[int] = []
    possible: list[int] = []
    for line in table:
        true.append(0)
        possible.append(0)
        for column, pair in enumerate(line):
            if pair is not None:
                first, second = pair
                value = yield node.body, (node.other_variable, second, (node.variable, first, bindings))
                true[-1] |= (value is True) << column
                possible[-1] |= (value is not False) << column
    enough = has_matching if pairs == "matching" else _covers
    return True if enough(true, count) else None if enough(possible, count) else False


def _covers(rows: Sequence[int], count: int) -> bool:
    """Decide whether at least `count` rows and as many columns have a true cell, as the reference counts."""
    columns = 0
    for row in rows:
        columns |= row
    return sum(map(bool, rows)) >= count and columns.bit_count() >= count


def _ground(atom: Atom, bindings: _Bindings) -> Atom:
    return Atom(atom.predicate, tuple([_value_of(name, bindings) for name in atom.args]))


def _value_of(name: str, bindings: _Bindings) -> str:
    while bindings is not None:
        variable, value, bindings = bindings
        if variable == name:
            return value
    return name


def _read(text: str, profile: str | Profile) -> Formula:
    # Loaded with the first text, since evaluation is part of what reading needs.
    found: Formula = import_module("bddl.parser").parse_formula(text, profile)
    return found


def lookup(state: State, profile: str | Profile = "auto") -> Callable[[Atom], bool | None]:
    """Return the function from an atom to its value in a state, None where that is unknown."""
    given: Any = state
    if isinstance(given, Set):
        true = frozenset(_label(fact, profile) for fact in given)
        return lambda atom: atom.label in true
    if not isinstance(given, Mapping):
        if callable(given):
            return cast("Callable[[Atom], bool | None]", given)
        raise TypeError(
            "A state is a mapping from atoms to values, a function of an atom or a set of true facts, "
            f"not {state!r:.80}."
        )
    first = next(iter(given), None)
    if not isinstance(first, Atom | tuple | None):
        raise _no_key(first)
    values: Mapping[Any, bool] = given
    if not isinstance(first, tuple):
        return lambda atom: values.get(atom.label) if (value := values.get(atom)) is None else value
    return lambda atom: values.get(atom) if (value := values.get(atom.label)) is None else value


def _label(fact: object, profile: str | Profile) -> Fact:
    """Return a true fact as its predicate and its arguments."""
    if isinstance(fact, str):
        fact = _read(fact, profile)
    if isinstance(fact, tuple) and all(isinstance(word, str) for word in fact):
        return fact
    if not isinstance(fact, Atom):
        raise TypeError(f"A true fact is an atom, a tuple such as ('open', 'fridge_0') or a text, not {fact!r:.80}.")
    return fact.label


def _check_keys(state: Mapping[Any, bool]) -> None:
    """Raise TypeError where a state of mixed keys has an illegal one, or gives an atom two values.

    This takes longer than most evaluations, so it runs only where the result is unknown.
    """
    if len(set(map(type, state))) < 2:
        return
    facts: dict[Fact, bool] = {}
    for key, value in state.items():
        if not isinstance(key, Atom | tuple):
            raise _no_key(key)
        label = key.label if isinstance(key, Atom) else key
        if facts.setdefault(label, value) != value:
            raise TypeError(f"A state gives {label!r} two values, once as an atom and once as a tuple.")


def _no_key(key: object) -> TypeError:
    return TypeError(f"A state has atoms, or tuples such as ('open', 'fridge_0'), for its keys, not {key!r}.")


def truth_value(value: object) -> bool:
    """Return a value as a plain bool: 1, 0 and the booleans of numpy count; a probability is no truth value."""
    try:
        if value in (True, False):
            return bool(value)
    except ValueError:
        pass  # An array, which compares to several values at once.
    raise TypeError(f"The value of an atom is True, False or, where it may be unknown, None; not {value!r}.")


def known_bits(atoms: Sequence[Atom], state: State) -> tuple[int, int]:
    """Return which atoms are true in a state and which are false, as sets of bits; the others are unknown."""
    known = lookup(state)
    values = [None if (value := known(atom)) is None else truth_value(value) for atom in atoms]
    return as_bits([value is True for value in values]), as_bits([value is False for value in values])


def as_bits(flags: Sequence[bool]) -> int:
    """Return the number whose bit i is the i-th flag."""
    # Reading binary digits takes linear time, setting bits one by one quadratic.
    return int("".join(["1" if flag else "0" for flag in reversed(flags)]) or "0", 2)


# A table of true cells: one number for each row, in which bit j says whether the cell of column j is true.
Rows: TypeAlias = Sequence[int]


def has_matching(rows: Rows, count: int) -> bool:
    """Decide whether `count` true cells can be chosen, no two in one row or column."""
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
    """Return as many true cells as can be chosen, no two in one row or column: for each column its row.

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
    """Return a free column at the end of an augmenting path from a row, or None; record the path in `reached_from`."""
    waiting = [start]
    visited = 0
    for row in waiting:
        for column in _bits(rows[row] & ~visited):
            reached_from[column] = row
            if column not in row_of:
                return column
            waiting.append(row_of[column])
        visited |= rows[row]
    return None


def _bits(mask: int) -> Iterator[int]:
    while mask:
        low = mask & -mask
        yield low.bit_length() - 1
        mask ^= low
