"""An independent check of certificates, from their own JSON and the primitive table alone.

It follows the plan itself, and checks that each thing needed has a link to the write that last gave the fact its value,
and that the value will do. It knows the language and the table of primitives, and nothing of `verify`.

Source: docs/semantics.md, Certificates.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import bddl
from oag.checker.cases import Place, Rejected, check_counterexample, require, truth_by_cases, truth_of
from oag.checker.plan import PlanRun, check_form
from oag.checker.search import check_search
from oag.facts import Fact, fact_text
from oag.library import Needed, library_sha

SCHEMA = "scene2demo-certificate/2"
# A fact, a value, and whether it must have it or must not; equal to a `Condition`.
_Condition = tuple[Fact, Any, Any]
_MALFORMED = (KeyError, TypeError, ValueError, IndexError, AttributeError, RecursionError, bddl.BDDLError)


@dataclass(frozen=True, slots=True)
class RecheckResult:
    """True when a certificate bears out its verdict; `reason` says what was confirmed, or what is wrong."""

    ok: bool
    reason: str

    def __bool__(self) -> bool:
        return self.ok


def recheck(certificate: Any) -> RecheckResult:
    """Decides whether a `Certificate`, or its JSON mapping, bears out its verdict; a malformed one is rejected."""
    try:
        data = certificate if isinstance(certificate, Mapping) else certificate.to_json()
        _check_envelope(data)
        return RecheckResult(True, _Checker(data).check())
    except Rejected as problem:
        return RecheckResult(False, str(problem))
    except _MALFORMED as problem:
        return RecheckResult(False, f"malformed certificate: {type(problem).__name__}: {problem}")


def _check_envelope(data: Mapping[str, Any]) -> None:
    """Checks what a certificate says of itself, apart from the evidence."""
    require(data["schema"] == SCHEMA, f"it is written as {data['schema']!r}, and this checker reads {SCHEMA!r}")
    require(data["library_sha"] == library_sha(), "it was made with another table of primitives")
    for key, part in (("task_hash", data["plan"]), ("scene_sha", data["scene"])):
        text = json.dumps(part, sort_keys=True, separators=(",", ":"))
        require(data[key] == hashlib.sha256(text.encode()).hexdigest(), f"{key} is of something else")
    for entry in data["assumptions"]:
        said = entry["formula"] if "formula" in entry else fact_text(tuple(entry["fact"]), entry["value"])
        require(entry.get("text", said) == said, f"the text of an assumption should be {said!r}")
        require(entry["kind"] in ("reset", "assumed"), f"no assumption is of the kind {entry['kind']!r}")
    require(type(data["evidence"]) is list, "its evidence is no list")


class _Checker:
    """A certificate whose plan is followed through, with a link for everything that it needs."""

    def __init__(self, data: Mapping[str, Any]) -> None:
        assumed = [entry for entry in data["assumptions"] if entry["kind"] == "assumed"]
        shown = "REFUTED" if data["failure"] is not None else "CONDITIONAL" if assumed else "PROVED"
        require(data["verdict"] == shown, f"the evidence is for {shown}, the verdict says {data['verdict']}")
        self.data, self.objects = data, data["scene"]["objects"]
        self.run = PlanRun(data, [(e["time"], e["fact"], e["value"]) for e in assumed if "formula" not in e])
        self.formulas = {tuple(e["consumer"]): e["formula"] for e in assumed if "formula" in e}
        self.cases = {tuple(entry["consumer"]): entry["tree"] for entry in data["cases"]}
        # The next link is the last one; the first stands for none.
        self.links = [("", 0, 0, (), None, True, 0), *reversed(data["links"])]

    def check(self) -> str:
        """Returns what was confirmed, or raises Rejected."""
        stop, cases = self.data["failure"] and tuple(self.data["failure"]), self.cases
        require(stop is None or type(stop[1]) is type(stop[2]) is int, "the failure is of no place")
        for place, wanted in self.run.places():
            if place == stop:
                self._fail(place, wanted)
                return f"{place} fails, as claimed"
            if type(wanted) is not tuple or place in cases:
                self._settle(place, wanted)
                continue
            for clause in wanted:
                condition, holds = self._link(place)
                if not holds or condition not in clause:
                    raise Rejected(f"the links do not give {place}")
        require(stop is None, "the obligation said to fail does not exist")
        require(self.data["counterexample"] is self.data["search"] is None, "what is shown to fail is not named")
        self._nothing_left()
        return f"{len(self.data['links'])} links confirmed"

    def _link(self, place: Place) -> tuple[_Condition, bool | None]:
        """Returns the condition of the next link, which must be of this place, and whether it holds."""
        kind, subtask, step, fact, value, positive, producer = self.links.pop()
        if (kind, subtask, step) != place:
            raise Rejected(f"the links do not give {place}")
        fact = tuple(fact)
        written, known = self.run.last(fact)
        if producer != written:
            raise Rejected(f"{place}: {fact} is written at {written}, not {producer}")
        return (fact, value, positive), None if known is None else (known == value) is positive

    def _settle(self, place: Place, wanted: Needed) -> None:
        """Checks what takes more than a link for each clause: a formula, or a distinction of cases."""
        said = self.formulas.pop(place, None)
        require(said in (None, str(wanted)), f"{place} is assumed in other words than the plan's")
        truth = self._truth(place, wanted)
        require(truth is True or (truth is None and said is not None), f"the links do not give {place}")

    def _truth(self, place: Place, wanted: Needed) -> bool | None:
        """Returns what the links of a place, or its distinction of cases, make of what it needs."""
        linked: set[Fact] = set()
        while tuple(self.links[-1][:3]) == place:
            condition, holds = self._link(place)
            asked = isinstance(wanted, tuple) and any(condition in clause for clause in wanted)
            require(asked or holds is True, f"{place}: a link says what is not so of {condition[0]}")
            linked.add(condition[0])
        value, tree = self.run.value, self.cases.pop(place, None)
        if tree is not None:
            require(bool(tree), f"{place} was decided by a solver alone: it has too many cases to list")
            return truth_by_cases(wanted, tree, value, self.objects)
        return truth_of(wanted, lambda fact: value(fact) if fact in linked else None, self.objects)

    def _fail(self, place: Place, wanted: Needed) -> None:
        """Checks that a place fails in every state, and in the complete one that is given."""
        search, example = self.data["search"], self.data["counterexample"]
        if place[0] == "no-flow":
            require(search["subtask"] == place[1], "the search is of another subtask")
            check_search(search, self.run.context, wanted, self.run.value, self.objects)
        else:
            require(search is None and self._truth(place, wanted) is False, f"{place} is not shown to be false")
        self._nothing_left()
        check_form(self.data["plan"])
        if example is not None:
            run = PlanRun(self.data, example, lenient=True)
            check_counterexample(run.places(), place, run.value, self.objects)

    def _nothing_left(self) -> None:
        """Checks that all links, cases and assumptions were used."""
        require(len(self.links) == 1, f"a link is out of place: {self.links[-1]}")
        require(not (self.cases or self.formulas or self.run.given), "a case or an assumption is of no place")
