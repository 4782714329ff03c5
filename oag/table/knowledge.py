"""What is known of the state while a plan is followed, with who wrote each fact when.

Time counts in half steps: 0 is the start state S_0, step n of the flattened plan (from 1) writes at 2n, and an
assumption that step n needs is written at 2n - 1. An absent fact is unknown (open world).

Source: docs/semantics.md, Knowledge; the progression is the 0-approximation of Son and Baral (Artificial
Intelligence, 2001).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import NamedTuple

import bddl
from oag.model.facts import ANY, HAND, Fact, Value, condition_of, generalisations
from oag.table.library import RESTING, Effect

START = 0
# Producer of a fact that nothing ever wrote.
NEVER = -1


class Entry(NamedTuple):
    """A value and the time at which it was written."""

    value: Value
    time: int


UNWRITTEN = Entry(None, NEVER)
# A value and its time as they are kept: there is one for every write, and a plain tuple costs a fifth of an `Entry`.
Written = tuple[Value, int]
_UNWRITTEN: Written = (None, NEVER)


class Knowledge:
    """A partial valuation that grows by writes in order of time, and remembers them all."""

    __slots__ = ("_carried", "_latest", "_log", "_shapes")

    def __init__(self) -> None:
        self._latest: dict[Fact, Written] = {}
        # Times and effects in turn, which takes a quarter of the room that pairs would.
        self._log: list[int | Effect] = []
        # Support -> facts about what was ever put on or in it, so that its cargo is found without a search.
        self._carried: dict[str, list[Fact]] = {}
        # Predicate -> which arguments are open in the patterns that were ever written: the first, the last.
        self._shapes: dict[str, tuple[tuple[bool, bool], ...]] = {}

    def write(self, fact: Fact, value: Value, time: int) -> None:
        """Records that a fact, or every fact matching a pattern, has a value from a time on."""
        self.apply(((fact, value),), time)

    def apply(self, effect: Effect, time: int) -> None:
        """Records all writes of one step."""
        latest, shapes = self._latest, self._shapes
        for fact, value in effect:
            latest[fact] = (value, time)
            if ANY in fact:
                shape = (fact[1] == ANY, fact[-1] == ANY)
                known = shapes.get(fact[0], ())
                if shape not in known:
                    # The more specific first: of writes at one time they count.
                    shapes[fact[0]] = tuple(sorted((*known, shape)))
            elif value is True and len(fact) == 3 and fact[0] in RESTING:
                self._carried.setdefault(fact[2], []).append(fact)
        self._log += (time, effect)

    def read(self, fact: Fact) -> Entry:
        """Returns the last write that covers a fact; of writes at one time the most specific one counts."""
        return Entry(*self.last(fact))

    def last(self, fact: Fact) -> Written:
        """Returns what `read` returns, as a plain pair."""
        latest = self._latest
        best = latest.get(fact, _UNWRITTEN)
        for any_first, any_last in self._shapes.get(fact[0], ()):
            if len(fact) == 3:
                pattern: Fact = (fact[0], ANY if any_first else fact[1], ANY if any_last else fact[2])
            else:
                pattern = (fact[0], ANY)
            written = latest.get(pattern, _UNWRITTEN)
            if written[1] > best[1]:
                best = written
        return best

    @property
    def hand(self) -> Value:
        """What the hand does."""
        return self._latest.get(HAND, _UNWRITTEN)[0]

    def at_start(self, fact: Fact) -> Value:
        """Returns what a fact was known to be at the start."""
        first = next(self.history(fact), UNWRITTEN)
        return first.value if first.time == START else None

    def value(self, atom: bddl.Atom) -> bool | None:
        """Returns whether a BDDL atom holds, None when unknown."""
        condition = condition_of(atom, True)
        return condition.grade(self.last(condition.fact)[0])

    def since(self, fact: Fact, truth_value: bool | str, until: int | None = None) -> Entry:
        """Returns the write that began the unbroken run of one answer to "has the fact this value?".

        Args:
            fact: Which fact.
            truth_value: The value asked about; runs of any other value count as one answer.
            until: Look at the fact as it was at this time; None for now.
        """
        began = UNWRITTEN
        answer: bool | None = None
        for entry in self.history(fact):
            if until is not None and entry.time > until:
                break
            now = None if entry.value is None else entry.value == truth_value
            if began is UNWRITTEN or now is not answer:
                began, answer = entry, now
        return began

    def history(self, fact: Fact) -> Iterator[Entry]:
        """Yields the writes that covered a fact, in order; of those at one time only the most specific one."""
        patterns = {pattern: rank for rank, pattern in enumerate(generalisations(fact))}
        pending: tuple[int, int, Value] | None = None
        for time, effect in self._writes():
            for pattern, value in effect:
                rank = patterns.get(pattern)
                if rank is None:
                    continue
                if pending is not None and pending[0] != time:
                    yield Entry(pending[2], pending[0])
                    pending = None
                if pending is None or rank <= pending[1]:
                    pending = (time, rank, value)
        if pending is not None:
            yield Entry(pending[2], pending[0])

    def _writes(self) -> Iterator[tuple[int, Effect]]:
        """Yields every effect with its time, in order."""
        for time, effect in zip(self._log[::2], self._log[1::2], strict=True):
            if isinstance(time, int) and isinstance(effect, tuple):
                yield time, effect

    def cargo(self, support: str) -> tuple[Fact, ...]:
        """Returns what is known to rest on or in something now, in order of first mention."""
        facts = dict.fromkeys(self._carried.get(support, ()))
        return tuple(fact for fact in facts if self.last(fact)[0] is True)

    def entries(self) -> Iterable[tuple[Fact, Entry]]:
        """Returns every fact or pattern written so far with its last write."""
        return ((fact, Entry(*written)) for fact, written in self._latest.items())
