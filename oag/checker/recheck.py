"""An independent check of certificates, from their own JSON and the primitive table alone.

It knows the language (`bddl`), the table of primitives with the facts that it is about, and which facts exclude each
other; it knows nothing of `verify`.

Source: docs/semantics.md, Certificates.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from oag.checker.cases import Place, Reader, Rejected, require, truth_by_cases, truth_of, with_values
from oag.checker.evidence import check_evidence
from oag.checker.form import form_check
from oag.checker.plan import PlanRun, check_form, is_link
from oag.checker.refutation import check_refutation, failing_place
from oag.model.facts import Fact, fact_text
from oag.table.invariants import with_consequences
from oag.table.library import Clause, Needed, library_sha

SCHEMA = "scene2demo-certificate/3"
NO_CERTIFICATE = (
    "there is no certificate: a report has none when its plan is not well formed, has a subtask without a flow that "
    "may have one, or was decided by more cases than can be listed; the report's diagnostics say which"
)
# A certificate that contains itself ends in a RecursionError either way.
_CANONICAL = json.JSONEncoder(sort_keys=True, separators=(",", ":"), check_circular=False)
_MALFORMED = (KeyError, TypeError, ValueError, IndexError, AttributeError, OverflowError, RecursionError)


@dataclass(frozen=True, slots=True)
class RecheckResult:
    """True when a certificate bears out its verdict; `reason` says what was confirmed, or what is wrong."""

    ok: bool
    reason: str

    def __bool__(self) -> bool:
        return self.ok


def recheck(certificate: Any) -> RecheckResult:
    """Decides whether a `Certificate`, or its JSON mapping, bears out its verdict; a malformed one is rejected.

    A `Report`, or the JSON of one, is taken for the certificate in it.
    """
    try:
        data: Any = certificate
        if type(data) is not dict or "schema" not in data:
            data = certificate_in(certificate)
        _check_envelope(data)
        confirmed = _confirm(data)
        # The links of a proof, of which there may be thousands, have been looked at one by one.
        place = form_check()({**data, "links": data["links"][:0]} if data["failure"] is None else data)
        require(place is None, f"malformed certificate: {place} has another form than documented, or does not belong")
        return RecheckResult(True, confirmed)
    except Rejected as problem:
        return RecheckResult(False, str(problem))
    except _MALFORMED as problem:
        form = f"a value has another form than expected ({problem})"
        if isinstance(problem, KeyError) and problem.args:
            form = f"nothing stands at {problem.args[0]!r}"
        elif isinstance(problem, RecursionError):
            form = "it is nested too deeply"
        return RecheckResult(False, f"malformed certificate: {form}")


def certificate_in(given: Any) -> Any:
    """Returns the JSON of the certificate that something which `recheck` accepts has in it.

    Raises:
        Rejected: There is none.
    """
    if not (given is None or isinstance(given, Mapping) or hasattr(given, "to_json")):
        raise Rejected(
            f"malformed certificate: expected a certificate, a report, or the JSON of one, got {given!r:.60}"
        )
    data = given if isinstance(given, Mapping | None) else given.to_json()
    if isinstance(data, Mapping) and "schema" not in data and "certificate" in data:
        data = data["certificate"]
    require(data is not None, NO_CERTIFICATE)
    return data


def _check_envelope(data: Mapping[str, Any]) -> None:
    """Checks what a certificate says of itself, and its measured probabilities, apart from what decides the verdict."""
    # Reasons are written only where they are needed: they would take a tenth of the time.
    if data["schema"] != SCHEMA:
        raise Rejected(f"it is written as {data['schema']!r}, and this checker reads {SCHEMA!r}")
    require(data["library_sha"] == library_sha(), "it was made with another table of primitives")
    for key, part in (("task_hash", data["plan"]), ("scene_sha", data["scene"])):
        digest = hashlib.sha256(_CANONICAL.encode(part).encode()).hexdigest()
        if data[key] != digest:
            raise Rejected(f"{key} is of something else")
    for entry in data["assumptions"]:
        said = entry["formula"] if "formula" in entry else fact_text(tuple(entry["fact"]), entry["value"])
        if entry.get("text", said) != said:
            raise Rejected(f"the text of an assumption should be {said!r}")
        if entry["kind"] not in ("reset", "assumed"):
            raise Rejected(f"no assumption is of the kind {entry['kind']!r}")
    check_evidence(data["evidence"])
    check_form(data)


def _confirm(data: Mapping[str, Any]) -> str:
    assumed = [entry for entry in data["assumptions"] if entry["kind"] == "assumed"]
    shown = "REFUTED" if data["failure"] is not None else "CONDITIONAL" if assumed else "PROVED"
    if data["verdict"] != shown:
        raise Rejected(f"the evidence is for {shown}, the verdict says {data['verdict']}")
    for entry in assumed:
        require("formula" not in entry, f"nothing shows that {entry.get('formula')} can hold, and that it need not")
    if shown == "REFUTED":
        kind, subtask, step = data["failure"]
        require(type(subtask) is type(step) is int, "the failure is of no place")
        check_refutation(data, (kind, subtask, step))
        return f"{(kind, subtask, step)} fails, as claimed"
    require(data["search"] is None, "a search shows that a subtask has no flow, and none is said to fail")
    confirmed = LinkedPlan(data, assumed).check()
    if shown == "PROVED":
        require(data["counterexample"] is None, "a run is given, and nothing is said to fail in it")
    else:
        missed = failing_place(data, data["counterexample"], None)
        require(missed is not None, "the run given meets everything, so nothing shows that anything has to be assumed")
    return confirmed


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
        self.links = [["", 0, 0, [], "", True, 0], *reversed(data["links"])]
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
        for place, wanted in self.run.places():
            if type(wanted) is not tuple or (cases and place in cases):
                self._settle(place, wanted)
                continue
            for clause in wanted:
                fact, value, positive, producer = self._link(place)
                if (fact, value, positive) not in clause:
                    raise Rejected(f"the links do not give {place}")
                if unneeded and (fact, producer) in self.said:
                    self._note(clause, fact, producer)
        if len(links) != 1:
            raise Rejected(f"a link is out of place: {links[-1]}")
        require(not (cases or self.run.given), "a case or an assumption is of no place")
        if unneeded:
            raise Rejected(f"it is assumed, and nothing needs it: {list(unneeded)}")
        return f"{self.count} link{'' if self.count == 1 else 's'} confirmed"

    def _link(self, place: Place) -> tuple[Fact, Any, Any, int]:
        """Returns the next link, which must be of this place and hold: fact, value, whether it is so, and producer."""
        kind, subtask, step, names, value, positive, producer = link = self.links.pop()
        if not is_link(link):
            raise Rejected(f"malformed certificate: {link!r:.80} is no link")
        fact = tuple(names)
        written, known = self.run.last(fact)
        if producer != written:
            raise Rejected(f"{place}: {fact} is written at {written}, not {producer}")
        if (kind, subtask, step) != place or known is None or (known == value) is not positive:
            raise Rejected(f"the links do not give {place}")
        return fact, value, positive, written

    def _note(self, clause: Clause, fact: Fact, producer: int) -> None:
        """Notes that an assumption is needed, when without it nothing that would do is known to hold."""
        assumption, said = self.said[fact, producer]
        without = self._without(self.run.value, assumption, said)
        if truth_of((clause,), without, self.objects) is not True:
            self.unneeded.pop(assumption, None)

    def _settle(self, place: Place, wanted: Needed) -> None:
        """Checks what takes more than a link for each clause: a formula, or a distinction of cases."""
        linked: dict[Fact, int] = {}
        while tuple(self.links[-1][:3]) == place:
            fact, _, _, producer = self._link(place)
            linked[fact] = producer
        tree, value = self.cases.pop(place, None), self.run.value
        require(tree != [], f"{place} was decided by a solver alone: it has too many cases to list")

        def read(fact: Fact) -> Any:
            return value(fact) if tree is not None or fact in linked else None

        require(self._truth(wanted, tree, read) is True, f"the links do not give {place}")
        for write in set(linked.items()) & self.said.keys() if self.unneeded else ():
            assumption, said = self.said[write]
            without = self._without(read, assumption, said)
            if assumption in self.unneeded and not self._holds_without(wanted, tree, without):
                del self.unneeded[assumption]

    def _without(self, read: Reader, assumption: _Write, said: tuple[Fact, ...]) -> Reader:
        """Return a reader to whom what an assumption says is what it was before."""
        run, time = self.run, assumption[1]
        return with_values(read, {fact: run.before[fact, time] for fact in said if run.last(fact)[0] == time})

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
