"""The check of proofs, outright or on assumptions: all that the plan needs has a link, or a distinction of cases.

Part of the independent check: it knows the language and the table of primitives, and nothing of `verify`.

Source: docs/semantics.md, Certificates.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from oag.checker.cases import Place, Reader, Rejected, require, truth_by_cases, truth_of, with_values
from oag.checker.plan import NEVER, PlanRun
from oag.model.facts import Fact
from oag.table.invariants import with_consequences
from oag.table.library import Clause, Needed

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
        links, cases, unneeded = self.links, self.cases, self.unneeded
        last, latest = self.run.last, self.run.latest
        for place, wanted in self.run.places():
            if type(wanted) is not tuple or (cases and place in cases):
                self._settle(place, wanted)
                continue
            for clause in wanted:
                # What `_link` does, written out: this is where the time goes.
                kind, subtask, step, names, value, positive, producer = links.pop()
                fact = tuple(names)
                # The robot's variables, of which most is needed, have no patterns.
                written, known = last(fact) if len(fact) > 1 else latest.get(fact, NEVER)
                if producer != written:
                    raise Rejected(f"{place}: {fact} is written at {written}, not {producer}")
                holds = known is not None and (known == value) is positive
                if not holds or (kind, subtask, step) != place or (fact, value, positive) not in clause:
                    raise Rejected(f"the links do not give {place}")
                if unneeded and (fact, written) in self.said:
                    self._note(clause, fact, written)
        if len(links) != 1:
            raise Rejected(f"a link is out of place: {links[-1]}")
        require(not (cases or self.run.given), "a case or an assumption is of no place")
        if unneeded:
            raise Rejected(f"it is assumed, and nothing needs it: {list(unneeded)}")
        return f"{self.count} link{'' if self.count == 1 else 's'} confirmed"

    def _link(self, place: Place) -> tuple[Fact, int]:
        """Returns the fact of the next link, which must be of this place and hold, and its producer."""
        *linked, names, value, positive, producer = self.links.pop()
        fact = tuple(names)
        written, known = self.run.last(fact)
        require(producer == written, f"{place}: {fact} is written at {written}, not {producer}")
        require(tuple(linked) == place, f"the links do not give {place}")
        require(known is not None and (known == value) is positive, f"{place}: a link says what is not so of {fact}")
        return fact, written

    def _note(self, clause: Clause, fact: Fact, producer: int) -> None:
        """Notes that an assumption is needed, when without it nothing that would do is known to hold."""
        assumption, said = self.said[fact, producer]
        without = with_values(self.run.value, dict.fromkeys(said))
        if truth_of((clause,), without, self.objects) is not True:
            self.unneeded.pop(assumption, None)

    def _settle(self, place: Place, wanted: Needed) -> None:
        """Checks what takes more than a link for each clause: a formula, or a distinction of cases."""
        linked: dict[Fact, int] = {}
        while tuple(self.links[-1][:3]) == place:
            fact, producer = self._link(place)
            linked[fact] = producer
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
