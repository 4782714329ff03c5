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

import bddl
from oag.checker.cases import Rejected, require
from oag.checker.evidence import check_evidence
from oag.checker.form import check_form
from oag.checker.links import LinkedPlan
from oag.checker.refutation import check_refutation, failing_place
from oag.model.facts import fact_text
from oag.table.library import library_sha

SCHEMA = "scene2demo-certificate/3"
NO_CERTIFICATE = (
    "there is no certificate: a report has none when its plan is not well formed, has a subtask without a flow that "
    "may have one, or was decided by more cases than can be listed; the report's diagnostics say which"
)
# A certificate that contains itself ends in a RecursionError either way.
_CANONICAL = json.JSONEncoder(sort_keys=True, separators=(",", ":"), check_circular=False)
_MALFORMED = (
    KeyError,
    TypeError,
    ValueError,
    IndexError,
    AttributeError,
    OverflowError,
    RecursionError,
    bddl.BDDLError,
)


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
        return RecheckResult(True, _confirm(data))
    except Rejected as problem:
        return RecheckResult(False, str(problem))
    except _MALFORMED as problem:
        return RecheckResult(False, f"malformed certificate: {_form_of(problem)}")


def _form_of(problem: Exception) -> str:
    """Returns what is wrong with a certificate's form, in words."""
    if isinstance(problem, KeyError) and problem.args:
        return f"nothing stands at {problem.args[0]!r}"
    if isinstance(problem, RecursionError):
        return "it is nested too deeply"
    return f"a value has another form than expected ({problem})"


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
    """Returns what was confirmed of a certificate whose envelope is right, or raises Rejected."""
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
