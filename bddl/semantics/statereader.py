"""Circuits evaluated in complete states, in whatever form a state comes."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence, Set, Sized
from typing import Any, TypeAlias

from bddl.errors import WrongState
from bddl.semantics.circuit import Circuit, Conjunction, Signal
from bddl.semantics.knownstate import Fact, truth_value
from bddl.semantics.maskprogram import MaskProgram
from bddl.semantics.statebits import packed
from bddl.syntax import Atom

# A packed state; what is true, as atoms or as facts; values by atom; or values in the order of the goal's atoms.
TotalState: TypeAlias = int | Set[Atom] | Set[Fact] | Mapping[Atom, bool] | Mapping[Fact, bool] | Sequence[bool]

_SETS = (set, frozenset)
# Up to so many atoms, setting bits one by one is faster than any detour; its time is quadratic.
_FEW = 100


class StateReader:
    """A circuit over atoms, ready to be evaluated.

    Args:
        atoms: The atoms that are its inputs.
        circuit: The circuit.

    Attributes:
        program: The circuit as a program over packed states.
    """

    __slots__ = ("_atoms", "_circuit", "_every", "_facts", "_names", "_read", "program")

    def __init__(self, atoms: Sequence[Atom], circuit: Circuit) -> None:
        self.program = MaskProgram(circuit)
        self._circuit = circuit
        self._read = self.program.reader()
        self._atoms = atoms
        self._every = (1 << len(atoms)) - 1
        self._names: _TrueNames | None = None
        self._facts: _TrueNames | None = None

    def values(self, state: TotalState) -> tuple[bool, ...]:
        """Returns the value of each output in a state.

        Raises:
            WrongState: The state is in no form that `pack` takes.
        """
        if type(state) is int:
            if 0 <= state <= self._every:
                return self._read(state)
            raise self._out_of_range(state)
        if isinstance(state, _SETS):
            for name in state:
                if type(name) is tuple:
                    return (self._facts or self._by_fact()).values(state)
                if type(name) is not Atom:
                    raise self._no_name(name)
                break
            return (self._names or self._by_atom()).values(state)
        return self._read(self.pack(state))

    def pack(self, state: TotalState) -> int:
        """Returns a state as a number whose bit i is the value of the i-th atom.

        Raises:
            WrongState: It is in none of the forms, or has another number of values than there are atoms.
        """
        # Lists first: asking whether something is a set takes as long as packing a few values.
        if type(state) is not list:
            if type(state) is int:
                if 0 <= state <= self._every:
                    return state
                raise self._out_of_range(state)
            if isinstance(state, Set):
                return (self._by_fact() if self._has_facts(state) else self._by_atom()).pack(state)
            if isinstance(state, Mapping):
                names: Sequence[Any] = [atom.label for atom in self._atoms] if self._has_facts(state) else self._atoms
                return self._pack_checked([state.get(name, False) for name in names])
            if not isinstance(state, Iterable):
                raise self._wrong(f"a {type(state).__name__}")
        try:
            values = bytes(state)
            if len(values) == len(self._atoms):
                return packed(values)
        except (TypeError, ValueError):
            pass  # Values of another kind, or none: looked at one by one, to tell which is wrong.
        return self._pack_checked(state)

    def _pack_checked(self, state: Sequence[object]) -> int:
        if isinstance(state, str) or not isinstance(state, Sized):
            raise self._wrong(f"a {type(state).__name__}")
        if len(state) != len(self._atoms):
            raise self._wrong(f"{len(state)} values")
        try:
            return packed(bytes([truth_value(value) for value in state]))
        except TypeError:
            raise self._wrong(f"a {type(state).__name__} with values other than true and false") from None

    def _has_facts(self, state: Set[Any] | Mapping[Any, bool]) -> bool:
        """Returns whether a state names what is true by facts; else by atoms."""
        first = next(iter(state), None)
        if first is not None and not isinstance(first, Atom | tuple):
            raise self._no_name(first)
        return isinstance(first, tuple)

    def _no_name(self, name: object) -> WrongState:
        return self._wrong(f"a collection of {type(name).__name__}, such as {name!r:.40},")

    def _out_of_range(self, state: int) -> WrongState:
        width = len(self._atoms)
        sign = "negative" if state < 0 else f"of {state.bit_length()} bits, where a packed state has {width},"
        return self._wrong(f"a number that is {sign}")

    def _wrong(self, got: str) -> WrongState:
        return WrongState(len(self._atoms), got)

    def _by_atom(self) -> _TrueNames:
        self._names = self._names or _TrueNames(self._atoms, self._circuit, self._read)
        return self._names

    def _by_fact(self) -> _TrueNames:
        self._facts = self._facts or _TrueNames([atom.label for atom in self._atoms], self._circuit, self._read)
        return self._facts


_SetTest: TypeAlias = Callable[[Set[Any]], bool]


class _TrueNames:
    """The inputs by name, for states that are sets of the names of what is true.

    Without gates, an output is a conjunction of inputs and negated inputs or the negation of one. Python tests whole
    sets for that without asking for a hash, and stops at the first member that does not fit.

    Attributes:
        values: Returns the value of each output in a state.
    """

    __slots__ = ("_names", "values")

    def __init__(self, names: Sequence[Any], circuit: Circuit, read: Callable[[int], tuple[bool, ...]]) -> None:
        self._names = names
        tests = [_set_test(names, circuit, output) for output in circuit.outputs]
        plain = [(test, sign) for test, sign in tests if test is not None]
        self.values: Callable[[Set[Any]], tuple[bool, ...]] = (
            _set_reader(plain) if len(plain) == len(tests) else lambda true: read(self.pack(true))
        )

    def pack(self, true: Set[Any]) -> int:
        """Returns a state as a number."""
        if len(self._names) > _FEW:
            return packed(bytes([*map(true.__contains__, self._names)]))
        state, bit = 0, 1
        for name in self._names:
            if name in true:
                state |= bit
            bit += bit
        return state


def _set_test(names: Sequence[Any], circuit: Circuit, output: Signal) -> tuple[_SetTest | None, bool]:
    """Returns how an output is tested on sets, and whether it is what the test says; None where there are gates."""
    inputs: Sequence[Signal] = (output & ~1,)
    if output // 2 >= circuit.inputs:
        gate = circuit.gates[output // 2 - circuit.inputs]
        if not isinstance(gate, Conjunction) or any(signal // 2 >= circuit.inputs for signal in gate.inputs):
            return None, True
        inputs = gate.inputs
    wanted = frozenset([names[signal // 2] for signal in inputs if not signal & 1])
    refused = frozenset([names[signal // 2] for signal in inputs if signal & 1])
    if wanted and refused:
        return lambda true: wanted <= true and refused.isdisjoint(true), not output & 1
    return refused.isdisjoint if refused else wanted.issubset, not output & 1


def _set_reader(tests: list[tuple[_SetTest, bool]]) -> Callable[[Set[Any]], tuple[bool, ...]]:
    """Returns a function that tests a set; few tests are written out, as a loop takes longer than they do."""
    match tests:
        case [(a, b)]:
            return lambda true: (a(true) is b,)
        case [(a, b), (c, d)]:
            return lambda true: (a(true) is b, c(true) is d)
        case [(a, b), (c, d), (e, f)]:
            return lambda true: (a(true) is b, c(true) is d, e(true) is f)
    return lambda true: tuple([test(true) is sign for test, sign in tests])
