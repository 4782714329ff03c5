"""Exact confidence interval of a measured success rate, and certificates that carry no measured evidence."""

from __future__ import annotations

import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

import oag
from oag.measurements import clopper_pearson
from oag.model.diagnostics import EvidenceError
from tests.oag.paper import task_json, verify

pairs = st.integers(1, 200).flatmap(lambda n: st.tuples(st.integers(0, n), st.just(n)))


@pytest.mark.parametrize(
    ("successes", "trials", "low", "high"),
    [(0, 10, 0.0, 0.3085), (10, 10, 0.6915, 1.0), (5, 10, 0.1871, 0.8129), (19, 20, 0.7513, 0.9987)],
)
def test_known_intervals(successes: int, trials: int, low: float, high: float) -> None:
    assert clopper_pearson(successes, trials) == pytest.approx((low, high), abs=1e-4)


@given(pairs)
def test_the_rate_is_inside_and_failures_mirror_successes(pair: tuple[int, int]) -> None:
    successes, trials = pair
    low, high = clopper_pearson(successes, trials)
    assert 0.0 <= low <= successes / trials <= high <= 1.0
    assert clopper_pearson(trials - successes, trials) == pytest.approx((1 - high, 1 - low), abs=1e-9)


@pytest.mark.parametrize(("successes", "trials"), [(1, 0), (-1, 3), (4, 3)])
def test_impossible_counts_are_refused(successes: int, trials: int) -> None:
    with pytest.raises(ValueError, match="no interval"):
        clopper_pearson(successes, trials)


@pytest.mark.parametrize("confidence", [0.0, 1.0, -0.5, float("nan")])
def test_a_confidence_is_between_0_and_1(confidence: float) -> None:
    with pytest.raises(EvidenceError, match="confidence between 0 and 1"):
        clopper_pearson(3, 5, confidence)


def test_counts_of_an_interval_are_whole() -> None:
    with pytest.raises(EvidenceError, match="whole numbers"):
        clopper_pearson(2.5, 5)  # type: ignore[arg-type]


def test_a_certificate_with_evidence_is_rejected() -> None:
    certificate = verify(task_json("T1"), "T1").certificate
    assert certificate is not None
    data = json.loads(json.dumps(certificate.to_json()))
    assert data["evidence"] == [] and oag.recheck(data)
    data["evidence"] = [{"lower_bound": 1.0}]
    assert oag.recheck(data).reason.startswith("it lists evidence")
