"""Measured probabilities in a certificate: what is accepted follows from the counts, and nothing better does."""

from __future__ import annotations

import copy
import json
from itertools import pairwise
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import beta

import oag
from oag.certificate.check import MEANINGS
from tests.forgeries import single_changes
from tests.oag.paper import task_json, verify
from tests.oag.test_evidence import PAPER, chains, pairs

_REPORT = verify(task_json("T1"), "T1")


def with_slot(slot: Any) -> dict[str, Any]:
    """A certificate with one piece of evidence, after a trip through JSON."""
    assert _REPORT.certificate is not None
    data: dict[str, Any] = json.loads(json.dumps({**_REPORT.certificate.to_json(), "evidence": [slot]}))
    return data


def exact_bound(slot: dict[str, Any]) -> float:
    """The bound that a slot's counts allow, by scipy's quantiles."""
    counts = slot["counts"]
    if slot["conditioning"] == "chain":
        counts = [(counts[-1][0], counts[0][1])]
    error = (1.0 - slot["confidence"]) / (len(counts) * slot["choices"])
    bound = 1.0
    for successes, trials in counts:
        bound *= float(beta.ppf(error, successes, trials - successes + 1)) if successes else 0.0
    return bound


@given(
    st.one_of(chains(), st.lists(pairs, min_size=1, max_size=4)),
    st.sampled_from(tuple(oag.Conditioning)),
    st.floats(0.001, 0.999),
    st.integers(1, 50),
)
@settings(max_examples=200, deadline=None)
def test_what_is_measured_is_confirmed_and_nothing_better(
    counts: Any, conditioning: oag.Conditioning, alpha: float, choices: int
) -> None:
    chained = all(after[1] == before[0] for before, after in pairwise(counts))
    if chained and conditioning is oag.Conditioning.CHAIN:
        slot = oag.chain_evidence(counts, alpha=alpha, choices=choices).to_json()
    elif conditioning is not oag.Conditioning.CHAIN:
        slot = oag.pooled_evidence(counts, conditioning, alpha=alpha, choices=choices).to_json()
    else:
        return
    data = with_slot(slot)
    result = oag.recheck(data)
    assert result, result.reason
    better = data["evidence"][0]
    better["lower_bound"] = exact_bound(better) + 1e-6
    assert not oag.recheck(data)


@pytest.mark.parametrize(("successes", "trials"), [(1, 100_000), (99_999, 100_000), (10**6, 10**6), (500_000, 10**6)])
def test_many_trials_are_checked_as_well(successes: int, trials: int) -> None:
    slot = oag.chain_evidence([(successes, trials)]).to_json()
    assert oag.recheck(with_slot(slot))
    assert not oag.recheck(with_slot({**slot, "lower_bound": exact_bound(slot) + 1e-7}))


@pytest.mark.parametrize("measure", [oag.chain_evidence, oag.pooled_evidence])
def test_a_slot_with_one_change_is_rejected_or_claims_no_more(measure: Any) -> None:
    original = measure(PAPER["T1"][0], choices=2).to_json()
    accepted = 0
    for changed in single_changes(json.loads(json.dumps(original))):
        if oag.recheck(with_slot(changed)):
            accepted += 1
            assert changed.keys() == original.keys()
            assert changed["speaks_of"] == MEANINGS[changed["conditioning"]]
            assert changed["lower_bound"] <= exact_bound(changed) + 1e-9
    # A bound of 0 is true whatever was counted; so is the bound for two choices when there was one.
    assert accepted


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"lower_bound": 0.99}, "the counts show no more than 0.217069, not 0.99"),
        ({"estimate": 0.9}, "the counts give the estimate 0.4, not 0.9"),
        ({"conditioning": "pool"}, "the evidence speaks of each subtask tried apart"),
        ({"counts": [[20, 20], [9, 10]]}, "the counts are no chain"),
        ({"counts": []}, "there are no counts"),
        ({"method": "by eye"}, "evidence of another kind cannot be checked"),
        ({"note": "?"}, "no evidence has this form"),
    ],
)
def test_what_is_wrong_with_evidence_is_said(change: dict[str, Any], said: str) -> None:
    slot = {**oag.chain_evidence(PAPER["T1"][0]).to_json(), **change}
    result = oag.recheck(with_slot(slot))
    assert not result and result.reason.startswith(said), result.reason


def test_evidence_that_is_no_list_is_rejected() -> None:
    data = copy.deepcopy(with_slot({}))
    data["evidence"] = {"lower_bound": 1.0}
    assert oag.recheck(data).reason == "its evidence is no list"
