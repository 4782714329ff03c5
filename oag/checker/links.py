"""The check of proofs, outright or on assumptions: all that the plan needs has a link, or a distinction of cases.

Part of the independent check: it knows the language and the table of primitives, and nothing of `verify`.

Source: docs/semantics.md, Certificates.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from oag.checker.cases import Place, Reader, Rejected, require, truth_by_cases, truth_of, with_values
from oag.checker.plan import PlanRun
from oag.exact.invariants import with_consequences
from oag.facts import Condition, Fact
from oag.library import Clause, Needed

# Named tuples made this way take half the time, and there is one for every link.
_made = tuple.__new__
# What was assumed, and when.
_Write = tuple[Fact, int]


class LinkedPlan:
    """A certificate whose plan is followed through, with a link for everything that it needs."""

    def __init__(self, data: Mapping[str, Any], assumed: list[Mapping[str, Any]]) -> None:
        given = [(entry["time"], entry["fact"], entry["value"]) for entry in assumed]
        self.run, self.objects, self.count = PlanRun(data, given), data["scene"]["objects"], len(data["links"])
        self.cases = {tuple(entry["consumer"]): entry["tree"] for entry in data["cases"]}
        require(len(self.cases) == len(data["cases"]), "two distinctions of cases are of one place")
        # The next link is the last one; the first stands for none.
        self.links = [("", 0, 0, (), None, True, 0), *reversed(data["links"])]
        # Everything that an assumption says, its consequences among it; and the assumptions that nothing needed yet.
        self.unneeded = {(fact, time): value for time, fact, value in self.run.given}
        require(len(self.unneeded) == len(given), "something is assumed twice")
        self.said: dict[_Write, tuple[_Write, tuple[Fact, ...]]] = {}
        for (fact, time), value in self.unneeded.items():
            facts = tuple(stated for stated, _ in with_consequences(fact, value))
            self.said |= {(stated, time): ((fact, time), facts) for stated in facts}

    def check(self) -> str:
        """Returns what was confirmed.

        Raises:
            Rejected: Something that is needed is not shown, or something is assumed or linked that is not needed.
        """
        for place, wanted in self.run.places():
            if type(wanted) is not tuple or place in self.cases:
                self._settle(place, wanted)
                continue
            for clause in wanted:
                condition, producer, holds = self._link(place)
                if not holds or condition not in clause:
                    raise Rejected(f"the links do not give {place}")
                if self.unneeded and (condition.fact, producer) in self.said:
                    self._note(clause, condition, producer)
        require(len(self.links) == 1, f"a link is out of place: {self.links[-1]}")
        require(not (self.cases or self.run.given), "a case or an assumption is of no place")
        require(not self.unneeded, f"it is assumed, and nothing needs it: {list(self.unneeded)}")
        return f"{self.count} links confirmed"

    def _link(self, place: Place) -> tuple[Condition, int, bool | None]:
        """Returns the condition of the next link, which must be of this place, its producer, and whether it holds."""
        kind, subtask, step, fact, value, positive, producer = self.links.pop()
        if (kind, subtask, step) != place:
            raise Rejected(f"the links do not give {place}")
        fact = tuple(fact)
        written, known = self.run.last(fact)
        if producer != written:
            raise Rejected(f"{place}: {fact} is written at {written}, not {producer}")
        holds = None if known is None else (known == value) is positive
        return _made(Condition, (fact, value, positive)), written, holds

    def _note(self, clause: Clause, condition: Condition, producer: int) -> None:
        """Notes that an assumption is needed, when without it nothing that would do is known to hold."""
        assumption, said = self.said[condition.fact, producer]
        without = with_values(self.run.value, dict.fromkeys(said))
        if truth_of((clause,), without, self.objects) is not True:
            self.unneeded.pop(assumption, None)

    def _settle(self, place: Place, wanted: Needed) -> None:
        """Checks what takes more than a link for each clause: a formula, or a distinction of cases."""
        linked: dict[Fact, int] = {}
        while tuple(self.links[-1][:3]) == place:
            condition, producer, holds = self._link(place)
            require(holds is True, f"{place}: a link says what is not so of {condition.fact}")
            linked[condition.fact] = producer
        tree, value = self.cases.pop(place, None), self.run.value
        require(tree != [], f"{place} was decided by a solver alone: it has too many cases to list")

        def read(fact: Fact) -> Any:
            return value(fact) if tree is not None or fact in linked else None

        require(self._truth(wanted, tree, read) is True, f"the links do not give {place}")
        for write in set(linked.items()) & self.said.keys() if self.unneeded else ():
            assumption, said = self.said[write]
            without = with_values(read, dict.fromkeys(said))
            if assumption in self.unneeded and not self._holds_without(wanted, tree, without):
                del self.unneeded[assumption]

    def _truth(self, wanted: Needed, tree: list[Any] | None, read: Reader) -> bool | None:
        """Returns whether a formula holds for a reader, by a distinction of cases if there is one."""
        if tree is None:
            return truth_of(wanted, read, self.objects)
        return truth_by_cases(wanted, tree, read, self.objects)

    def _holds_without(self, wanted: Needed, tree: list[Any] | None, read: Reader) -> bool:
        """True when a formula is shown for a reader that does not know what an assumption says."""
        try:
            return self._truth(wanted, tree, read) is True
        except Rejected:
            return False
