"""Property 25 and the paper's counts: measured probabilities, their bounds, and what they speak of."""

from __future__ import annotations

import json
import random
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import oag
from oag.evidence import lower_bound
from tests.oag.paper import scene, task_json, verify

# Counts of the paper's table: estimate, bound of the chain, bound of the product.
PAPER = {
    "T1": ([(20, 20), (20, 20), (9, 20), (8, 9)], 0.40, 0.217, 0.063),
    "T2": ([(10, 10), (10, 10), (4, 10), (3, 4)], 0.30, 0.087, 0.006),
    "T3": ([(10, 10), (7, 10)], 0.70, 0.393, 0.24),
    "T4": ([(10, 10), (7, 10)], 0.70, 0.393, 0.24),
}
pairs = st.integers(1, 200).flatmap(lambda n: st.tuples(st.integers(0, n), st.just(n)))


@st.composite
def chains(draw: st.DrawFn) -> list[tuple[int, int]]:
    """Count of whole runs: every subtask is tried as often as the one before succeeded."""
    trials = draw(st.integers(1, 60))
    counts = []
    for _ in range(draw(st.integers(1, 5))):
        successes = draw(st.integers(0, trials))
        counts.append((successes, trials))
        trials = successes
        if not successes:
            break
    return counts


@pytest.mark.parametrize(
    ("successes", "trials", "low", "high"),
    [(0, 10, 0.0, 0.3085), (10, 10, 0.6915, 1.0), (5, 10, 0.1871, 0.8129), (19, 20, 0.7513, 0.9987)],
)
def test_known_intervals(successes: int, trials: int, low: float, high: float) -> None:
    assert oag.clopper_pearson(successes, trials) == pytest.approx((low, high), abs=1e-4)


@given(pairs)
def test_the_rate_is_inside_and_failures_mirror_successes(pair: tuple[int, int]) -> None:
    successes, trials = pair
    low, high = oag.clopper_pearson(successes, trials)
    assert 0.0 <= low <= successes / trials <= high <= 1.0
    assert oag.clopper_pearson(trials - successes, trials) == pytest.approx((1 - high, 1 - low), abs=1e-9)


@pytest.mark.parametrize(("successes", "trials"), [(1, 0), (-1, 3), (4, 3)])
def test_impossible_counts_are_refused(successes: int, trials: int) -> None:
    with pytest.raises(ValueError, match="no interval"):
        oag.clopper_pearson(successes, trials)
    for measure in (oag.chain_evidence, oag.pooled_evidence):
        with pytest.raises(oag.EvidenceError, match="cannot be"):
            measure([(successes, trials)])


@pytest.mark.parametrize("name", sorted(PAPER))
def test_the_papers_counts(name: str) -> None:
    counts, estimate, chain, product = PAPER[name]
    evidence = oag.chain_evidence(counts)
    assert evidence.estimate == pytest.approx(estimate)
    assert evidence.lower == pytest.approx(chain, abs=5e-4)
    apart = oag.pooled_evidence(counts)
    assert apart.lower == pytest.approx(product, abs=6e-3 if name in ("T3", "T4") else 5e-4)
    assert apart.lower < evidence.lower


@given(chains())
def test_p25_rates_of_a_chain_telescope(counts: list[tuple[int, int]]) -> None:
    product = 1.0
    for successes, trials in counts:
        product *= successes / trials
    evidence = oag.chain_evidence(counts)
    assert evidence.estimate == pytest.approx(product)
    assert 0.0 <= oag.pooled_evidence(counts).lower <= evidence.lower <= evidence.estimate


@given(pairs, st.integers(2, 9))
def test_p25_bounds_grow_with_successes_and_shrink_with_choices(pair: tuple[int, int], choices: int) -> None:
    successes, trials = pair
    bounds = [oag.chain_evidence([(s, trials)]).lower for s in range(max(0, successes - 1), successes + 1)]
    assert bounds == sorted(bounds)
    chosen = oag.chain_evidence([pair], choices=choices).lower
    assert chosen <= bounds[-1] and (chosen == 0.0) is (successes == 0)
    assert chosen == pytest.approx(lower_bound(successes, trials, 0.05 / choices))


@pytest.mark.slow
@given(chains(), pairs, st.integers(2, 9))
@settings(max_examples=2000, deadline=None)
def test_p25_at_length(counts: list[tuple[int, int]], pair: tuple[int, int], choices: int) -> None:
    evidence = oag.chain_evidence(counts)
    assert 0.0 <= oag.pooled_evidence(counts).lower <= evidence.lower <= evidence.estimate <= 1.0
    successes, trials = pair
    assert oag.chain_evidence([pair], choices=choices).lower == pytest.approx(
        lower_bound(successes, trials, 0.05 / choices)
    )


def covered(rates: list[float], seed: int, runs: int, trials: int, *, chain: bool) -> float:
    """How often the bound lies at or below the true probability, in simulated experiments."""
    rng = random.Random(seed)
    truth, hits = 1.0, 0
    for rate in rates:
        truth *= rate
    for _ in range(runs):
        counts, tried = [], trials
        for rate in rates:
            successes = sum(rng.random() < rate for _ in range(tried))
            counts.append((successes, tried))
            tried = successes if chain else trials
        measured = oag.chain_evidence(counts) if chain else oag.pooled_evidence(counts)
        hits += measured.lower <= truth
    return hits / runs


@pytest.mark.parametrize("chain", [True, False])
@given(rates=st.lists(st.floats(0.05, 0.99), min_size=1, max_size=4), seed=st.integers(0, 2**32))
@settings(max_examples=8)
def test_p25_simulated_coverage(chain: bool, rates: list[float], seed: int) -> None:
    # The bound is exact, so over 400 experiments fewer than 92 % would be a deviation of more than 2.7 sigma.
    assert covered(rates, seed, 400, 20, chain=chain) >= 0.92


@pytest.mark.slow
@pytest.mark.parametrize("chain", [True, False])
@pytest.mark.parametrize("rates", [[0.4], [0.95, 0.5], [1.0, 0.9, 0.45, 0.9], [0.99] * 4])
def test_p25_simulated_coverage_at_length(rates: list[float], chain: bool) -> None:
    # 20,000 experiments have a standard deviation of 0.15 %.
    assert covered(rates, 11, 20_000, 20, chain=chain) >= 0.95 - 0.005


@given(chains(), chains(), st.integers(1, 5))
@settings(max_examples=300)
def test_p25_holds_for_every_pair_of_counts(one: list[tuple[int, int]], other: list[tuple[int, int]], m: int) -> None:
    for counts in (one, other, one + other):
        apart = oag.pooled_evidence(counts, oag.Conditioning.POOL, choices=m)
        assert 0.0 <= apart.lower <= apart.estimate <= 1.0
        assert (apart.lower == 0.0) is any(successes == 0 for successes, _ in counts)


def test_no_success_shows_nothing() -> None:
    evidence = oag.chain_evidence([(10, 10), (0, 10)])
    assert evidence.lower == evidence.estimate == 0.0


def test_counts_that_do_not_chain_are_refused() -> None:
    with pytest.raises(oag.EvidenceError, match="no chain of whole runs"):
        oag.chain_evidence([(9, 10), (9, 10)])
    with pytest.raises(oag.EvidenceError, match="use chain_evidence"):
        oag.pooled_evidence([(9, 10)], oag.Conditioning.CHAIN)
    with pytest.raises(oag.EvidenceError, match="nothing to conclude"):
        oag.chain_evidence([])


def test_certificates_keep_the_measured_apart_from_the_proved() -> None:
    certificate = verify(task_json("T1"), "T1").certificate
    assert certificate is not None
    hopeless = oag.chain_evidence([(0, 20)])
    extended = certificate.with_evidence(hopeless.to_json(), oag.pooled_evidence([(3, 4)]).to_json())
    written = json.loads(json.dumps(extended.to_json()))
    assert written["verdict"] == "PROVED" and oag.recheck(written)
    assert [slot["conditioning"] for slot in written["evidence"]] == ["chain", "saved_state"]
    assert {key: value for key, value in written.items() if key != "evidence"} == {
        key: value for key, value in certificate.to_json().items() if key != "evidence"
    }
    assert scene("T1").name


def test_evidence_reads_as_a_sentence() -> None:
    text = str(oag.chain_evidence(PAPER["T1"][0]))
    assert text == "0.400, at least 0.217 with confidence 0.95 (20/20, 20/20, 9/20, 8/9; chain)"


@pytest.mark.parametrize(
    ("counts", "options", "said"),
    [
        ([(2.5, 5)], {}, "expected whole numbers"),
        ([(True, 5)], {}, "expected whole numbers"),
        ([(2, 5)], {"choices": 1.5}, "at least 1 choice"),
        ([(2, 5)], {"choices": 0}, "at least 1 choice"),
        ([(2, 5)], {"alpha": 0.0}, "an error between 0 and 1"),
        ([(0, 5), (5, 0)], {}, "5 successes in 0 trials cannot be"),
    ],
)
@pytest.mark.parametrize("measure", [oag.chain_evidence, oag.pooled_evidence])
def test_what_cannot_have_been_counted_is_refused(measure: Any, counts: Any, options: Any, said: str) -> None:
    with pytest.raises(oag.EvidenceError, match=said):
        measure(counts, **options)


def test_a_subtask_that_was_not_tried_counts_in_a_pool() -> None:
    """A chain ends where nothing succeeded; trials apart owe a count for every subtask."""
    assert oag.chain_evidence([(0, 5), (0, 0)]).counts == (oag.Count(0, 5),)
    with pytest.raises(oag.EvidenceError, match="0 successes in 0 trials"):
        oag.pooled_evidence([(0, 5), (0, 0)])


@pytest.mark.parametrize("confidence", [0.0, 1.0, -0.5, float("nan")])
def test_a_confidence_is_between_0_and_1(confidence: float) -> None:
    with pytest.raises(oag.EvidenceError, match="confidence between 0 and 1"):
        oag.clopper_pearson(3, 5, confidence)


def test_counts_of_an_interval_are_whole() -> None:
    with pytest.raises(oag.EvidenceError, match="whole numbers"):
        oag.clopper_pearson(2.5, 5)  # type: ignore[arg-type]


def test_evidence_needs_no_json_to_be_added() -> None:
    certificate = verify(task_json("T1"), "T1").certificate
    assert certificate is not None
    evidence = oag.chain_evidence([(3, 4)])
    assert certificate.with_evidence(evidence) == certificate.with_evidence(evidence.to_json())
    with pytest.raises(oag.EvidenceError, match=r"expected what oag\.chain_evidence"):
        certificate.with_evidence([evidence])  # type: ignore[arg-type]
