"""Independent check of certificates, from their own JSON and the table of primitives alone.

It knows the language (`bddl`), the table of primitives with its facts, and which facts exclude each other. It knows
nothing of `verify` or of the writer of certificates.

Links are followed one by one. A refutation is checked in two parts: one run reaches the place and fails there, and no
run gets past it.

Source: docs/semantics.md, Certificates.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

from oag.certificate.check_plan import (
    Given,
    Impossible,
    Place,
    PlanRun,
    Reader,
    Rejected,
    check_contents,
    domain_of,
    is_link,
    require,
    truth_by_cases,
    truth_of,
    with_values,
)
from oag.certificate.schema import schema_check
from oag.model.symbols import HAND, ROBOT_FACTS, Fact, Value, fact_text, generalisations
from oag.primitives.table import Clause, Effect, Needed, Rows, library_sha, requirements, with_consequences

# Kind of the place where a plan without a flow ends.
_NO_FLOW = "no-flow"
# Most facts and places visited for all cases together.
_MOST_LOOKED = 2_000_000


def find_failing_place(data: Mapping[str, Any], given: Sequence[Any], stop: Place | None) -> Place | None:
    """Return the first place that one complete run does not meet; None when it meets all.

    In the run, what `given` does not say of unknown facts is false. A `no-flow` place at which to `stop` only has to be
    reached. Raises Rejected when the run is invalid, or leaves a place open.
    """
    run = PlanRun(data, given, complete=True)
    for place, wanted in run.places():
        if place == stop and place[0] == _NO_FLOW:
            return place
        truth = truth_of(wanted, run.value, data["scene"]["objects"])
        require(truth is not None, f"the run leaves {place} open")
        if truth is False:
            return place
    return None


def check_refutation(data: Mapping[str, Any], stop: Place) -> None:
    """Check that one run reaches a place and fails there, and that every run fails there or before.

    Assumptions on the way must be forced: without it, the place where an assumption is made would be false.
    """
    failing = find_failing_place(data, data["counterexample"], stop)
    require(failing == stop, f"from the counterexample's start, {failing} fails, and not {stop}")
    assumed = [(e["time"], tuple(e["fact"]), e["value"]) for e in data["assumptions"] if e["kind"] == "assumed"]
    cases, search = data["cases"], data["search"]
    if cases:
        require(not assumed and search is None and len(cases) == 1, "cases are distinguished of more than the failure")
        require(tuple(cases[0]["consumer"]) == stop, "the cases are of another place than the failure")
        _check_cases(data, cases[0]["tree"], stop)
    run = PlanRun(data)
    for place, wanted in run.places():
        _take_forced(run, wanted, assumed, data["scene"]["objects"])
        if place == stop:
            break
    _check_links(data, run, stop)
    if cases:
        return
    require(not assumed, f"nothing that the plan needs forces what is assumed: {assumed}")
    if stop[0] == _NO_FLOW:
        require(search["subtask"] == stop[1], "the search is of another subtask")
        check_search(search, run, wanted, data["scene"]["objects"])
        return
    shown = truth_of(wanted, run.value, data["scene"]["objects"])
    require(search is None and shown is False, f"{stop} is not shown to be false")


def is_forced(wanted: Needed, fact: Fact, value: bool, read: Reader, objects: Mapping[str, str]) -> bool:
    """Decide whether clauses or a formula can only hold if a fact has a value, by what is known otherwise."""
    otherwise = with_values(read, dict(with_consequences(fact, not value)))
    return truth_of(wanted, otherwise, objects) is False


def _take_forced(run: PlanRun, wanted: Needed, assumed: list[Given], objects: Mapping[str, str]) -> None:
    """Make the assumptions of a place in order, and remove them from the list, as long as the place forces them."""
    while assumed and assumed[0][0] == run.time:
        time, fact, value = assumed[0]
        if not is_forced(wanted, fact, value, run.value, objects):
            return
        run.take(time, fact, value)
        del assumed[0]


def _check_cases(data: Mapping[str, Any], tree: list[Any], stop: Place) -> None:
    """Check a distinction of cases in each of which some place is false, the failing one or one before it."""
    require(bool(tree), f"{stop} was decided by a solver alone: it has too many cases to list")
    pending: list[tuple[Given, ...]] = [()]
    looked = 0
    for split in tree:
        require(bool(pending), "a case distinction has too many cases")
        case = pending.pop()
        if split is None:
            looked += _check_case(data, case, stop)
            require(looked <= _MOST_LOOKED, "the cases take too long to look at")
        else:
            time, fact = split
            pending += [(*case, (time, tuple(fact), value)) for value in (False, True)]
    require(not pending, "a case of a distinction is missing")


def _check_case(data: Mapping[str, Any], case: tuple[Given, ...], stop: Place) -> int:
    """Check that a place up to a failure is false in a case, or that the case has no state; return the work done."""
    run, looked = PlanRun(data, case), 0

    def read(fact: Fact) -> Value:
        nonlocal looked
        looked += 1
        return run.value(fact)

    try:
        for place, wanted in run.places():
            looked += 1
            if place[0] != _NO_FLOW and truth_of(wanted, read, data["scene"]["objects"]) is False:
                return looked
            require(place != stop, f"in the case {list(case)}, nothing up to {stop} is false")
    except Impossible:
        return looked
    raise Rejected(f"the plan does not come to {stop}")


def _check_links(data: Mapping[str, Any], run: PlanRun, stop: Place) -> None:
    """Check that every link belongs to the failing place and names the last write of its fact."""
    for kind, subtask, step, fact, value, positive, producer in data["links"]:
        written, known = run.last(tuple(fact))
        require((kind, subtask, step) == stop, f"a link is out of place: {(kind, subtask, step)}")
        require(producer == written, f"{stop}: {tuple(fact)} is written at {written}, not {producer}")
        require(known is not None and type(positive) is bool and value is not None, f"a link of {stop} says nothing")


_State = tuple[Value, ...]


def check_search(search: Mapping[str, Any], run: PlanRun, goal: Needed, objects: Mapping[str, str]) -> None:
    """Check that no flow of a subtask reaches its goal.

    A state gives a value, or null for unknown, to every fact listed; it stands for all complete states that agree. The
    robot's three facts are among them, and `start` is the state where the subtask starts.
    """
    facts = [tuple(fact) for fact in search["facts"]]
    states = {tuple(state) for state in search["states"]}
    require(set(ROBOT_FACTS) <= set(facts), "a search leaves out a variable of the robot")
    require(all(len(state) == len(facts) for state in states), "a state of a search has too few or too many values")
    start = tuple(map(run.value, facts))
    require(start == tuple(search["start"]) and start in states, "the start is not among the states of the search")
    context, legal, rows = run.context, run.legal(), Rows(run.context)
    for state in states:
        known = dict(zip(facts, state, strict=True))
        require(truth_of(goal, known.get, objects) is False, f"a state of the search may meet the goal: {known}")
        for primitive in legal:
            if truth_of(requirements(primitive, context, known[HAND]), known.get, objects) is not False:
                after = _after(known, rows.written(primitive, known[HAND], None, known.get))
                require(after in states, f"{primitive.name} leads out of the states of the search")


def _after(known: dict[Fact, Value], written: Effect) -> _State:
    """Return the state after an effect, whose most specific write to a fact counts."""
    writes = dict(written)
    return tuple(
        next((writes[pattern] for pattern in generalisations(fact) if pattern in writes), value)
        for fact, value in known.items()
    )


SCHEMA = "scene2demo-certificate/3"
# Digests of earlier tables with the version that wrote them: what holds by the present table too is confirmed.
EARLIER = {"71f0b2b678d7351c1a171c473e463b7edb558221b0777065a7547613f3172a48": "0.1.0"}
NO_CERTIFICATE = (
    "there is no certificate: a report has none when its plan is not well formed, has a subtask without a flow that "
    "may have one, or was decided by more cases than can be listed; the report's diagnostics say which"
)
# A certificate that contains itself ends in a RecursionError either way.
_CANONICAL = json.JSONEncoder(sort_keys=True, separators=(",", ":"), check_circular=False)
_MALFORMED = (KeyError, TypeError, ValueError, IndexError, AttributeError, OverflowError, RecursionError)


@dataclass(frozen=True, slots=True)
class RecheckResult:
    """Result of a recheck: true when a certificate shows its verdict; `reason` says what was confirmed or is wrong."""

    ok: bool
    reason: str

    def __repr__(self) -> str:
        return f"<RecheckResult {'confirmed' if self.ok else 'rejected'}: {self.reason[:160]}>"

    def __bool__(self) -> bool:
        return self.ok


def recheck(certificate: Any) -> RecheckResult:
    """Decide whether a `Certificate`, or its JSON mapping, shows its verdict; a malformed one is rejected.

    A `Report`, or the JSON of one, is taken for the certificate in it.
    """
    try:
        data: Any = certificate
        if type(data) is not dict or "schema" not in data:
            data = certificate_in(certificate)
        _check_envelope(data)
        earlier = EARLIER.get(data["library_sha"])
        try:
            confirmed = _confirm(data)
        except Rejected as problem:
            if earlier is None:
                raise
            raise Rejected(_outdated(earlier, problem)) from problem
        # The links of a proof, of which there may be thousands, were checked one by one.
        place = schema_check()({**data, "links": data["links"][:0]} if data["failure"] is None else data)
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


def _outdated(version: str, problem: Rejected) -> str:
    return (
        f"by the present table of primitives, {problem}; version {version} wrote it with an earlier table: "
        "verify the plan again"
    )


def certificate_in(given: Any) -> Any:
    """Return the JSON of the certificate in anything that `recheck` accepts; raises Rejected when there is none."""
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
    """Check the hashes and the texts: all that does not decide the verdict."""
    # Reasons are written only where they are needed: they would take a tenth of the time.
    if data["schema"] != SCHEMA:
        raise Rejected(f"it is written as {data['schema']!r}, and this checker reads {SCHEMA!r}")
    earlier = data["library_sha"] in EARLIER and "domain" not in data
    known = earlier or data["library_sha"] == library_sha(domain_of(data))
    require(known, "it was made with another table of primitives")
    for key, part in (("task_hash", data["plan"]), ("scene_sha", data["scene"])):
        digest = hashlib.sha256(_CANONICAL.encode(part).encode()).hexdigest()
        if data[key] != digest:
            raise Rejected(f"{key} is of something else")
    for entry in data["assumptions"]:
        text = entry["formula"] if "formula" in entry else fact_text(tuple(entry["fact"]), entry["value"])
        if entry.get("text", text) != text:
            raise Rejected(f"the text of an assumption should be {text!r}")
        if entry["kind"] not in ("reset", "assumed"):
            raise Rejected(f"no assumption is of the kind {entry['kind']!r}")
    require(data["evidence"] == [], "it lists evidence, and no evidence is known that could be checked")
    check_contents(data)


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
        missed = find_failing_place(data, data["counterexample"], None)
        require(missed is not None, "the run given meets everything, so nothing shows that anything has to be assumed")
    return confirmed


# What was assumed, and when.
_Write = tuple[Fact, int]


class LinkedPlan:
    """A certificate's plan followed to its end, with a link for every need."""

    def __init__(self, data: Mapping[str, Any], assumed: list[Mapping[str, Any]]) -> None:
        given = [(entry["time"], entry["fact"], entry["value"]) for entry in assumed]
        self.run, self.objects, self.count = PlanRun(data, given), data["scene"]["objects"], len(data["links"])
        self.cases = {tuple(entry["consumer"]): entry["tree"] for entry in data["cases"]}
        require(len(self.cases) == len(data["cases"]), "two distinctions of cases are of one place")
        # The next link is the last one; the first stands for none.
        self.links = [["", 0, 0, [], "", True, 0], *reversed(data["links"])]
        # `unneeded`: assumptions that nothing needed yet. Below: the facts of each, consequences included.
        self.unneeded = {(fact, time): value for time, fact, value in self.run.given}
        require(len(self.unneeded) == len(given), "something is assumed twice")
        self.statements: dict[_Write, tuple[_Write, tuple[Fact, ...]]] = {}
        for (fact, time), value in self.unneeded.items():
            facts = tuple(stated for stated, _ in with_consequences(fact, value))
            self.statements |= {(stated, time): ((fact, time), facts) for stated in facts}

    def check(self) -> str:
        """Return what was confirmed; raises Rejected for a need not shown, and for a needless assumption or link."""
        links, cases, unneeded = self.links, self.cases, self.unneeded
        for place, wanted in self.run.places():
            if type(wanted) is not tuple or (cases and place in cases):
                self._settle(place, wanted)
                continue
            for clause in wanted:
                fact, value, positive, producer = self._link(place)
                if (fact, value, positive) not in clause:
                    raise Rejected(f"the links do not give {place}")
                if unneeded and (fact, producer) in self.statements:
                    self._note(clause, fact, producer)
        if len(links) != 1:
            raise Rejected(f"a link is out of place: {links[-1]}")
        require(not (cases or self.run.given), "a case or an assumption is of no place")
        if unneeded:
            raise Rejected(f"it is assumed, and nothing needs it: {list(unneeded)}")
        return f"{self.count} link{'' if self.count == 1 else 's'} confirmed"

    def _link(self, place: Place) -> tuple[Fact, Any, Any, int]:
        """Return the next link, which must belong to this place and hold: fact, value, sign, and producer."""
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
        """Note that an assumption is needed, if without it no alternative of the clause is known to hold."""
        assumption, statements = self.statements[fact, producer]
        without = self._without(self.run.value, assumption, statements)
        if truth_of((clause,), without, self.objects) is not True:
            self.unneeded.pop(assumption, None)

    def _settle(self, place: Place, wanted: Needed) -> None:
        """Check a need that takes more than one link a clause: a formula, or a distinction of cases."""
        linked: dict[Fact, int] = {}
        while tuple(self.links[-1][:3]) == place:
            fact, _, _, producer = self._link(place)
            linked[fact] = producer
        tree, value = self.cases.pop(place, None), self.run.value
        require(tree != [], f"{place} was decided by a solver alone: it has too many cases to list")

        def read(fact: Fact) -> Any:
            return value(fact) if tree is not None or fact in linked else None

        require(self._truth(wanted, tree, read) is True, f"the links do not give {place}")
        for write in set(linked.items()) & self.statements.keys() if self.unneeded else ():
            assumption, statements = self.statements[write]
            without = self._without(read, assumption, statements)
            if assumption in self.unneeded and not self._holds_without(wanted, tree, without, statements):
                del self.unneeded[assumption]

    def _without(self, read: Reader, assumption: _Write, statements: tuple[Fact, ...]) -> Reader:
        """Return a reader in which the facts of an assumption are what they were before it."""
        run, time = self.run, assumption[1]
        return with_values(read, {fact: run.before[fact, time] for fact in statements if run.last(fact)[0] == time})

    def _truth(
        self, wanted: Needed, tree: list[Any] | None, read: Reader, ignored: tuple[Fact, ...] = ()
    ) -> bool | None:
        if tree is None:
            return truth_of(wanted, read, self.objects)
        return truth_by_cases(wanted, tree, read, self.objects, partial(self.run.excludes, ignored=ignored))

    def _holds_without(self, wanted: Needed, tree: list[Any] | None, read: Reader, left_out: tuple[Fact, ...]) -> bool:
        try:
            return self._truth(wanted, tree, read, left_out) is True
        except Rejected:
            return False
