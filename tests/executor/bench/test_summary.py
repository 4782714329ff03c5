"""The numbers of a table, against the paper's formulas written out a second time."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import binomtest

from executor.bench.tables import (
    DASH,
    SCALE_ROW,
    Cell,
    busy_s,
    detail_rows,
    main_rows,
    subtask_score,
)
from executor.bench.units import BenchSetting, Series
from executor.campaign.planning_model import PlanningModel
from executor.campaign.rate import Rate

SERIES = Series("T1", 0, 1, BenchSetting(), "v")


def unit(done: int, of: int, *, started_s: float = 0.0, elapsed_s: float = 1.0) -> dict[str, Any]:
    """A result whose first `done` of `of` subtasks succeeded; the next one failed, and later ones did not run."""
    ran = [{"name": f"s{k}", "succeeded": k < done} for k in range(min(done + 1, of))]
    ended = "succeeded" if done == of else "failed"
    return {
        "name": "u",
        "ended": ended,
        "subtask_names": [f"s{k}" for k in range(of)],
        "subtasks": ran,
        "failure": None if done == of else {"kind": ("slipped", "stalled")[done % 2], "message": ""},
        "started_s": started_s,
        "elapsed_s": elapsed_s,
    }


def test_what_was_scaled_has_a_row() -> None:
    scaled = [{"object_id": "glass_0", "factors": [factor] * 3} for factor in (0.71, 0.25)]
    results = [unit(4, 4) | {"seed": 0, "scaled": found} for found in (scaled[:1], scaled[1:], [])]
    assert dict(detail_rows(Cell(SERIES, results)))["things scaled to fit the gripper"] == "in 2 units, by 0.25 to 0.71"
    assert "things scaled to fit the gripper" not in dict(detail_rows(Cell(SERIES, results[2:])))


def test_the_scale_stands_below_the_rate() -> None:
    scaled = [{"object_id": "glass_0", "factors": [factor] * 3} for factor in (0.71, 0.6)]
    found = [unit(4, 4) | {"seed": 0, "scaled": [change]} for change in scaled]
    rows = {row[0]: row[1] for row in main_rows([Cell(SERIES, found)])}
    assert rows["here: planned flows"] == "100 / 100" and rows[SCALE_ROW] == "0.6-0.71"
    own = Cell(SERIES, [*found, unit(4, 4) | {"seed": 1, "scaled": []}])
    assert own.scales == (0.6, 1.0) and own.to_json()["scales"] == (0.6, 1.0)
    assert dict((row[0], row[1]) for row in main_rows([Cell(SERIES, [unit(4, 4)])]))[SCALE_ROW] == DASH


def test_what_was_taken_twice_and_what_stood_beside_are_counted() -> None:
    results = [unit(4, 4) | {"seed": k, "taken_twice": int(k == 1), "bystanders_moved_m": 0.001 * k} for k in range(3)]
    rows = dict(detail_rows(Cell(SERIES, results)))
    assert rows["a thing was taken twice"] == "in 1 unit"
    assert rows["things beside"] == "moved by 2 mm at most; a failure from 50 mm or 37 degrees on"
    data = Cell(SERIES, results).to_json()
    assert data["taken_twice"] == 1
    assert data["bystanders"] == {"moved_at_most_m": 0.002, "a_failure_from_m": 0.05, "or_tipped_by_deg": 37.0}
    assert "a thing was taken twice" not in dict(detail_rows(Cell(SERIES, results[:1])))


def test_proved_counts_the_units_that_say_it() -> None:
    asked = Series("T7", 0, 5, BenchSetting(model=PlanningModel("openai:gpt-5.2")), "v")
    proved = {**unit(0, 1), "proved": True, "stage": "geometry"}
    refused = {"name": "u", "ended": "refused", "proved": False, "stage": "proof"}
    others = [{"name": "u", "ended": ended} for ended in ("crashed", "timed-out", "not-drawn")]
    assert Cell(asked, [proved, refused, *others]).proved == Rate(1, 2)
    assert Cell(SERIES, [proved]).proved is None


units_of_four = st.lists(st.builds(unit, st.integers(0, 4), st.just(4)), min_size=1, max_size=40)


def score_by_the_paper(reach: Sequence[Sequence[int]], success: Sequence[Sequence[int]]) -> float:
    """The appendix's formula, sum by sum: rows are demonstrations, columns subtasks."""
    total, subtasks = 0.0, len(reach[0])
    for k in range(subtasks):
        above = sum(r[k] * s[k] for r, s in zip(reach, success, strict=True))
        below = sum(r[k] for r in reach)
        total += above / below if below else 0.0
    return total / subtasks * 100.0


@given(units_of_four)
def test_rates_scores_and_intervals(results: list[dict[str, Any]]) -> None:
    cell = Cell(SERIES, results)
    done = [sum(s["succeeded"] for s in r["subtasks"]) for r in results]
    assert cell.all == Rate(sum(d == 4 for d in done), len(results))
    reach = [[int(d >= k) for k in range(4)] for d in done]
    success = [[int(d > k) for k in range(4)] for d in done]
    assert cell.subtask_score == pytest.approx(score_by_the_paper(reach, success))
    exact = binomtest(cell.all.successes, cell.all.trials).proportion_ci(0.95, method="exact")
    assert cell.all.interval_percent == pytest.approx((100 * exact.low, 100 * exact.high))
    assert sum(cell.reasons.values()) == len(cell.failed) == cell.all.trials - cell.all.successes


def test_a_layout_that_is_run_again_is_no_new_trial() -> None:
    """Three wishes in each of 20 layouts, one failure: as exact as 20 trials, not as 60, however often it is drawn."""
    results = [{**unit(4 - (k == 7), 4), "index": k} for k in range(60)]
    cell = Cell(SERIES, results)
    assert (cell.all.successes, cell.all.trials, cell.all.clusters) == (59, 60, 20)
    twice = Cell(SERIES, [*results, *results])
    assert twice.all.clusters == 20 and twice.all.interval_percent == cell.all.interval_percent
    low, high = cell.all.interval_percent or (0.0, 0.0)
    # 19 2/3 of 20: at least as wide as the intervals of 19 and of 20 successes reach.
    assert low == pytest.approx(100 * binomtest(19, 20).proportion_ci(0.95, method="exact").low)
    assert high == 100.0
    assert str(cell.all) == f"59 of 60, 98.3 % ({low:.1f} to 100.0, by 20 layouts)"
    once = Cell(SERIES, results[::3])
    assert once.all.clusters is None


@pytest.mark.parametrize(
    ("done", "of", "expected"),
    [
        # The paper's M1 row: T1 gets through two subtasks and never through the third; T3 places 4 of 10.
        ([2] * 10, 4, (0, 50)),
        ([1] * 6 + [2] * 4, 2, (40, 70)),
        # Its M2 row for T1, from its table of subtasks: of 20 demonstrations 9 get through subtask 3, 8 through 4.
        ([2] * 11 + [3] + [4] * 8, 4, (40, 83.47)),
    ],
)
def test_the_papers_own_rows(done: list[int], of: int, expected: tuple[float, float]) -> None:
    cell = Cell(SERIES, [unit(d, of) for d in done])
    assert cell.all.percent == pytest.approx(expected[0])
    assert cell.subtask_score == pytest.approx(expected[1], abs=0.01)


def test_a_process_that_died_failed_its_first_subtask() -> None:
    crashed = {"name": "u", "ended": "crashed", "failure": {"kind": "crashed", "message": ""}}
    cell = Cell(SERIES, [unit(2, 2), unit(2, 2), unit(2, 2), crashed])
    assert cell.all == Rate(3, 4)
    assert [(r.successes, r.trials) for r in cell.subtasks] == [(3, 4), (3, 3)]
    assert cell.reasons == {"crashed": 1}


def test_nothing_run_yet() -> None:
    cell = Cell(SERIES, [])
    assert cell.all.percent is None and cell.all.interval_percent is None and cell.demos_per_hour is None
    assert subtask_score([]) is None
    assert cell.to_json()["finished"] == 0


spans = st.lists(st.tuples(st.integers(0, 60), st.integers(0, 12)), max_size=15)


@given(spans)
def test_pauses_do_not_count_and_overlaps_count_once(times: list[tuple[int, int]]) -> None:
    results = [unit(4, 4, started_s=float(start), elapsed_s=float(length)) for start, length in times]
    seconds = {second for start, length in times for second in range(start, start + length)}
    assert busy_s(results) == pytest.approx(len(seconds))


def test_throughput_counts_successes_over_busy_time() -> None:
    results = [
        unit(4, 4, started_s=0, elapsed_s=10),
        unit(4, 4, started_s=0, elapsed_s=10),
        unit(1, 4, started_s=100, elapsed_s=10),
    ]
    assert Cell(SERIES, results).demos_per_hour == pytest.approx(2 * 3600 / 20)
