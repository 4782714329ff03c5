"""Properties 12 to 14: certificates pass the independent check, survive JSON, and cannot be bent."""

from __future__ import annotations

import hashlib
import json
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import oag
from tests.bruteforce import run
from tests.json_edits import altered
from tests.properties.plans import KINDS, Case, cases

FEW = settings(max_examples=120, deadline=None)
REPLACEMENTS: tuple[Any, ...] = (
    None,
    True,
    False,
    0,
    1,
    2,
    7,
    -1,
    "",
    "cup_0",
    "open",
    "PROVED",
    "REFUTED",
    [],
    {},
    [1],
)


def certificate_of(case: Case) -> dict[str, Any]:
    """The certificate of a case after a trip through JSON."""
    certificate = oag.compose(case.task()).verify().certificate
    assert certificate is not None
    data: dict[str, Any] = json.loads(json.dumps(certificate.to_json()))
    return data


@given(cases())
@FEW
def test_p12_certificates_pass_and_survive_json(case: Case) -> None:
    report = oag.compose(case.task()).verify()
    result = oag.recheck(certificate_of(case))
    assert result, result.reason
    assert report.certificate is not None and oag.recheck(report.certificate) == result


def paths(value: Any, prefix: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """The place of every value inside JSON data."""
    found = [prefix] if prefix else []
    if isinstance(value, dict):
        for key, part in value.items():
            found += paths(part, (*prefix, key))
    elif isinstance(value, list):
        for index, part in enumerate(value):
            found += paths(part, (*prefix, index))
    return found


def rehashed(data: dict[str, Any]) -> dict[str, Any]:
    """The data with its hashes made right, as somebody would who wants it to pass."""
    for key, part in (("task_hash", "plan"), ("scene_sha", "scene")):
        text = json.dumps(data.get(part), sort_keys=True, separators=(",", ":"))
        data[key] = hashlib.sha256(text.encode()).hexdigest()
    return data


def same(left: Any, right: Any) -> bool:
    """Equality of JSON texts, in which 1 and true differ."""
    return json.dumps(left, sort_keys=True) == json.dumps(right, sort_keys=True)


@given(cases(most_unknown=2), st.data())
@settings(FEW, max_examples=200)
def test_p13_an_altered_certificate_is_rejected_or_still_true(case: Case, data: st.DataObject) -> None:
    original = certificate_of(case)
    path = data.draw(st.sampled_from(paths(original)))
    changed = altered(original, path, data.draw(st.sampled_from((*REPLACEMENTS, ...))))
    if oag.recheck(changed):
        # It speaks of the same plan and scene and says the same of them, so it is still true.
        assert all(same(changed[key], original[key]) for key in ("verdict", "plan", "scene", "failure"))


def check_forgery(case: Case, data: st.DataObject) -> None:
    """14: whatever passes as PROVED is so, also after a change with hashes made right again."""
    original = certificate_of(case)
    path = data.draw(
        st.sampled_from([p for p in paths(original) if p[0] in ("assumptions", "links", "verdict", "failure")])
    )
    forged = altered(original, path, data.draw(st.sampled_from((*REPLACEMENTS, ...))))
    forged["verdict"] = data.draw(st.sampled_from(("PROVED", forged.get("verdict"))))
    if data.draw(st.booleans()):
        forged["failure"] = None
    if oag.recheck(rehashed(forged)) and forged["verdict"] == "PROVED":
        assert all(run(start, case.parts, case.goal, KINDS) is None for start in case.starts())


@given(cases(), st.data())
@settings(FEW, max_examples=200)
def test_p14_what_passes_as_proved_is_so(case: Case, data: st.DataObject) -> None:
    check_forgery(case, data)


@pytest.mark.slow
@given(cases(most_unknown=6), st.data())
@settings(max_examples=2000, deadline=None)
def test_p14_at_length(case: Case, data: st.DataObject) -> None:
    check_forgery(case, data)


@given(cases(most_unknown=0), st.data())
@settings(FEW, max_examples=100)
def test_p14_a_proof_of_one_plan_is_none_of_another(case: Case, data: st.DataObject) -> None:
    """Links taken from one plan and put under another, hashes made right, pass only if that plan is right too."""
    other = data.draw(cases(most_unknown=0))
    forged = certificate_of(case)
    forged["plan"], forged["scene"] = certificate_of(other)["plan"], certificate_of(other)["scene"]
    if oag.recheck(rehashed(forged)) and forged["verdict"] == "PROVED":
        assert all(run(start, other.parts, other.goal, KINDS) is None for start in other.starts())
