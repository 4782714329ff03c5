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
from oag.facts import Fact, Value, condition_of, generalisations
from oag.library import RESTING, Effect

START = 0
# Producer of a fact that nothing ever wrote.
NEVER = -1


class Entry(NamedTuple):
    """A value and the time at which it was written."""

    value: Value
    time: int


UNWRITTEN = Entry(None, NEVER)


class Knowledge:
    """A partial valuation that grows by writes in order of time, and remembers them all."""

    __slots__ = ("_carried", "_latest", "_log")

    def __init__(self) -> None:
        self._latest: dict[Fact, Entry] = {}
        self._log: list[tuple[int, Fact, Value]] = []
        # Support -> facts about what was ever put on or in it, so that its cargo is found without a search.
        self._carried: dict[str, list[Fact]] = {}

    def write(self, fact: Fact, value: Value, time: int) -> None:
        """Records that a fact, or every fact matching a pattern, has a value from a time on."""
        self._latest[fact] = Entry(value, time)
        self._log.append((time, fact, value))
        if value is True and len(fact) == 3 and fact[0] in RESTING:
            self._carried.setdefault(fact[2], []).append(fact)

    def apply(self, effect: Effect, time: int) -> None:
        """Records all writes of one step."""
        for fact, value in effect:
            self.write(fact, value, time)

    def read(self, fact: Fact) -> Entry:
        """Returns the last write that covers a fact; of writes at one time the most specific one counts."""
        latest = self._latest
        best = UNWRITTEN
        for pattern in generalisations(fact):
            entry = latest.get(pattern)
            if entry is not None and entry.time > best.time:
                best = entry
        return best

    def value(self, atom: bddl.Atom) -> bool | None:
        """Returns whether a BDDL atom holds, None when unknown."""
        condition = condition_of(atom, True)
        return condition.grade(self.read(condition.fact).value)

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
        for time, pattern, value in self._log:
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

    def cargo(self, support: str) -> tuple[Fact, ...]:
        """Returns what is known to rest on or in something now, in order of first mention."""
        facts = dict.fromkeys(self._carried.get(support, ()))
        return tuple(fact for fact in facts if self.read(fact).value is True)

    def entries(self) -> Iterable[tuple[Fact, Entry]]:
        """Returns every fact or pattern written so far with its last write."""
        return self._latest.items()
