"""Circuits as tests of masks: a state is one whole number, and a gate is a test that sets one more of its bits."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple, TypeAlias

from bddl.semantics.circuit import Circuit, Conjunction, Count, Gate, Signal, Table, signals_of
from bddl.semantics.matching import Rows, covers, decide, has_matching
from bddl.semantics.statebits import packed


class MaskTest(NamedTuple):
    """A conjunction of bits: it holds where `state & mask == want`."""

    mask: int
    want: int

    def holds(self, state: int) -> bool:
        """Its value in a complete state."""
        return state & self.mask == self.want

    def truth(self, true: int, false: int) -> bool | None:
        """Its value where some bits are known to be true, some to be false, and the others are unknown."""
        refused = self.mask ^ self.want
        if true & self.want == self.want and false & refused == refused:
            return True
        return False if false & self.want or true & refused else None


@dataclass(frozen=True, slots=True)
class CountTest:
    """True when exactly `count` of the bits of a mask are as they should be; `flip` has those that should be 0."""

    mask: int
    flip: int
    count: int

    def holds(self, state: int) -> bool:
        """Its value in a complete state."""
        return ((state ^ self.flip) & self.mask).bit_count() == self.count

    def truth(self, true: int, false: int) -> bool | None:
        """Its value where some bits are known to be true, some to be false, and the others are unknown."""
        kept = self.mask ^ self.flip
        sure = ((true & kept) | (false & self.flip)).bit_count()
        ruled_out = ((false & kept) | (true & self.flip)).bit_count()
        most = self.mask.bit_count() - ruled_out
        if not sure <= self.count <= most:
            return False
        return True if sure == most else None


@dataclass(frozen=True, slots=True)
class TableTest:
    """True when enough cells of a table can be paired off, or are covered; its rows are bits one after the other."""

    first: int
    height: int
    width: int
    count: int
    matching: bool

    def _rows(self, bits: int) -> Rows:
        full = (1 << self.width) - 1
        bits >>= self.first
        return [bits >> row * self.width & full for row in range(self.height)]

    def holds(self, state: int) -> bool:
        """Its value in a complete state."""
        return (has_matching if self.matching else covers)(self._rows(state), self.count)

    def truth(self, true: int, false: int) -> bool | None:
        """Its value where some bits are known to be true, some to be false, and the others are unknown."""
        test = has_matching if self.matching else covers
        return decide(test, self.count, self._rows(true), self._rows(~false))


Test: TypeAlias = MaskTest | CountTest | TableTest


class Output(NamedTuple):
    """An output: true where its test holds, or where it does not if `positive` is False."""

    test: MaskTest
    positive: bool

    def truth(self, true: int, false: int) -> bool | None:
        """Its value where some bits are known to be true, some to be false, and the others are unknown."""
        value = self.test.truth(true, false)
        return None if value is None else value is self.positive


class MaskProgram:
    """A circuit, ready to be run on states in which bit i is input i.

    Attributes:
        outputs: The outputs, to be tested once the bits of the gates are set.
    """

    __slots__ = ("_absent", "_masks", "_steps", "outputs")

    def __init__(self, circuit: Circuit) -> None:
        layout = _Layout(circuit)
        self.outputs = tuple([layout.output(signal) for signal in circuit.outputs])
        self._absent = layout.absent
        self._steps = tuple(layout.steps)
        masks = [(test.mask, test.want, bit) for test, bit in layout.steps if isinstance(test, MaskTest)]
        # Most goals count nothing; theirs are run without a call for each gate.
        self._masks = masks if len(masks) == len(layout.steps) else None

    def run(self, state: int) -> int:
        """Returns a complete state with the bits of the gates set as well."""
        if self._masks is None:
            for test, bit in self._steps:
                if test.holds(state):
                    state |= bit
        else:
            for mask, want, bit in self._masks:
                if state & mask == want:
                    state |= bit
        return state

    @property
    def has_gates(self) -> bool:
        """Whether there are gates to run before the outputs can be tested."""
        return bool(self._steps)

    def reader(self) -> Callable[[int], tuple[bool, ...]]:
        """Returns a function from complete states to the values of the outputs."""
        read = _reader([(test.mask, test.want, positive) for test, positive in self.outputs])
        return (lambda state: read(self.run(state))) if self._steps else read

    def truths(self, true: int, false: int) -> tuple[bool | None, ...]:
        """Returns the value of each output where some inputs are known to be true, some to be false, others unknown."""
        false |= self._absent
        for test, bit in self._steps:
            value = test.truth(true, false)
            if value:
                true |= bit
            elif value is False:
                false |= bit
        return tuple([output.truth(true, false) for output in self.outputs])


def _reader(tests: list[tuple[int, int, bool]]) -> Callable[[int], tuple[bool, ...]]:
    """Returns a function that tests a state: `state & mask == want`, or the contrary, for each test."""
    # Most goals have few conditions, and a loop takes several times as long as the tests themselves.
    match tests:
        case [(a, b, c)]:
            return lambda state: ((state & a == b) is c,)
        case [(a, b, c), (d, e, f)]:
            return lambda state: ((state & a == b) is c, (state & d == e) is f)
        case [(a, b, c), (d, e, f), (g, h, i)]:
            return lambda state: ((state & a == b) is c, (state & d == e) is f, (state & g == h) is i)
    return lambda state: tuple([(state & mask == want) is positive for mask, want, positive in tests])


@dataclass(slots=True)
class _Layout:
    """Gives the gates of a circuit their bits: signal 2 k is bit k, and copies come after all signals."""

    circuit: Circuit
    steps: list[tuple[Test, int]] = field(default_factory=list)
    absent: int = 0
    _bits: int = 0

    def __post_init__(self) -> None:
        inputs, gates = self.circuit.inputs, self.circuit.gates
        self._bits = inputs + len(gates)
        read = {signal // 2 for gate in gates for signal in signals_of(gate)}
        for number, gate in enumerate(gates, start=inputs):
            # A conjunction that only outputs name is tested there.
            if number in read or not isinstance(gate, Conjunction):
                self.steps.append((self._test(gate), 1 << number))

    def output(self, signal: Signal) -> Output:
        """Returns the test of an output."""
        number = signal // 2 - self.circuit.inputs
        gate = self.circuit.gates[number] if number >= 0 else None
        test = self._conjunction(gate) if isinstance(gate, Conjunction) else _conjunction((signal & ~1,))
        return Output(test, not signal & 1)

    def _test(self, gate: Gate) -> Test:
        match gate:
            case Conjunction():
                return self._conjunction(gate)
            case Count(count=count, inputs=inputs):
                test = _conjunction(self._apart(inputs))
                return CountTest(test.mask, test.mask ^ test.want, count)
            case Table(count=count, cells=cells, matching=matching):
                width = len(cells[0]) if cells else 0
                return TableTest(self._in_a_row(cells), len(cells), width, count, matching)

    def _conjunction(self, gate: Conjunction) -> MaskTest:
        return _conjunction(self._apart(gate.inputs))

    def _apart(self, inputs: Sequence[Signal]) -> list[Signal]:
        """Returns the same signals, copied where two of them would share a bit."""
        seen: set[int] = set()
        apart: list[Signal] = []
        for signal in inputs:
            apart.append(signal if signal // 2 not in seen else self._copy(signal))
            seen.add(signal // 2)
        return apart

    def _in_a_row(self, cells: tuple[tuple[Signal | None, ...], ...]) -> int:
        """Returns the first of the bits that hold the cells row by row, copied there unless they stand so."""
        flat = [cell for row in cells for cell in row]
        if not flat:
            return 0
        start = flat[0]
        if start is not None and start & 1 == 0 and flat == list(range(start, start + 2 * len(flat), 2)):
            return start // 2
        first = self._bits
        for cell in flat:
            if cell is None:
                self.absent |= 1 << self._bits
                self._bits += 1
            else:
                self._copy(cell)
        return first

    def _copy(self, signal: Signal) -> Signal:
        """Returns a signal of the next free bit that is the same as the given one."""
        copy = self._bits
        self._bits += 1
        self.steps.append((_conjunction((signal,)), 1 << copy))
        return 2 * copy


def _conjunction(inputs: Sequence[Signal]) -> MaskTest:
    numbers = [signal // 2 for signal in inputs]
    return MaskTest(_bits_set(numbers), _bits_set([signal // 2 for signal in inputs if not signal & 1]))


def _bits_set(numbers: Sequence[int]) -> int:
    """Returns the number that has just these bits."""
    if not numbers:
        return 0
    # Counted from the lowest, so that it takes no longer in a goal of many atoms.
    low = min(numbers)
    flags = bytearray(max(numbers) - low + 1)
    for number in numbers:
        flags[number - low] = 1
    return packed(flags) << low
