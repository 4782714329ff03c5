"""Units have names for people, and ids that change when anything that decides their outcome does."""

from __future__ import annotations

import json
from collections import Counter
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from benchmarks.baselines.methods import BASELINES
from executor.bench.tables import main_table
from executor.bench.units import BenchSetting, Series, Unit
from executor.campaign import versions
from executor.campaign.engine import Shard
from executor.campaign.versions import UNORDERED_VERSION
from executor.scenes.generators import household
from executor.scenes.generators.families import (
    FAMILIES,
    HOUSEHOLD,
    LONG_HORIZON,
    NoPaperFlow,
    families_with_flows,
    with_paper_flows,
)
from oag import Task
from oag.model.actions import flow_to_json

DATA = Path(__file__).resolve().parents[2] / "data"
SETTINGS = st.builds(BenchSetting, st.sampled_from(["planned", "paper"]), st.booleans(), st.booleans())
LONG_UNITS = st.builds(Unit, st.sampled_from(LONG_HORIZON), st.integers(0, 10**6), st.none(), SETTINGS)
HOUSE_UNITS = st.builds(Unit, st.sampled_from(HOUSEHOLD), st.integers(0, 10**6), st.integers(0, 101), SETTINGS)
UNITS = LONG_UNITS | HOUSE_UNITS


@given(UNITS, UNITS)
def test_other_units_have_other_names_and_ids(a: Unit, b: Unit) -> None:
    assert (a == b) == (a.name == b.name) == (a.id("v") == b.id("v"))
    assert a.id("v") != a.id("w")
    assert Unit.from_json(json.loads(json.dumps(a.to_json()))) == a


def test_every_baseline_has_a_name_of_its_own() -> None:
    series = [Series("T2", 1, 1, BenchSetting(baseline=baseline), "v") for baseline in BASELINES]
    assert len({one.setting.name for one in series} - {BenchSetting().name}) == len(BASELINES)
    assert [Series.from_json(one.to_json()) for one in series] == series


def test_long_horizon_series_count_seeds_up() -> None:
    series = Series("T2", 14000, 3, BenchSetting(), "v")
    assert [unit.name for unit in series.units()] == ["T2-014000-planned", "T2-014001-planned", "T2-014002-planned"]
    assert Series.from_json(json.loads(json.dumps(series.to_json()))) == series


@pytest.mark.parametrize(("family", "count"), [("T5", 36), ("T6", 66)])
def test_household_series_go_through_whole_sets(family: str, count: int) -> None:
    units = list(Series(family, 14000, 3 * count, BenchSetting(), "v").units())
    assert Counter(unit.seed for unit in units) == {14000: count, 14001: count, 14002: count}
    assert len({(unit.seed, unit.index) for unit in units}) == 3 * count
    first = [unit.index for unit in units[:count]]
    assert first == sorted(first) and all(index is not None and 0 <= index < household.COUNT for index in first)


def test_the_two_household_families_share_a_set_without_rest() -> None:
    both = [
        unit.index
        for family, count in (("T5", 36), ("T6", 66))
        for unit in Series(family, 0, count, BenchSetting(), "v").units()
    ]
    assert sorted(both) == list(range(household.COUNT))


@given(st.integers(1, 9), st.integers(0, 60))
def test_every_unit_belongs_to_exactly_one_shard(parts: int, units: int) -> None:
    owners = [[n for n in range(1, parts + 1) if Shard(n, parts).has(place)] for place in range(units)]
    assert all(len(found) == 1 for found in owners)


def test_constants_and_libraries_decide_the_version(monkeypatch: pytest.MonkeyPatch) -> None:
    version = versions.outcome_version.__wrapped__
    distinct = {version(), version(1), version(2)}
    assert version() == version()
    monkeypatch.setattr(versions, "OUTCOME_VERSION", 0)
    distinct.add(version())
    monkeypatch.setattr(versions.metadata, "version", lambda library: "0")
    assert len(distinct | {version()}) == 5


@pytest.mark.parametrize("family", LONG_HORIZON)
def test_the_papers_flows_are_those_of_its_tasks(family: str) -> None:
    task = Task.from_json(DATA / f"{family}.json")
    bare = replace(task, subtasks=tuple(replace(subtask, flow=None) for subtask in task.subtasks))
    filled = with_paper_flows(bare, family)
    assert [flow_to_json(s.flow or ()) for s in filled.subtasks] == [flow_to_json(s.flow or ()) for s in task.subtasks]
    assert filled == task


def test_flows_that_the_paper_does_not_print_are_refused() -> None:
    task = Task.from_json(DATA / "T1.json")
    assert families_with_flows() == LONG_HORIZON
    with pytest.raises(NoPaperFlow, match="prints no flows for T5; it does for T1, T2, T3, T4"):
        with_paper_flows(task, "T5")
    with pytest.raises(NoPaperFlow, match="T3 has 2 subtasks, but put_glass_into_refrigerator was decomposed into 4"):
        with_paper_flows(task, "T3")


def test_the_papers_table_is_as_printed() -> None:
    table = {row.method.split()[0]: row.cells for row in main_table()}
    assert table["M1"] == {
        "T1": (0, 50),
        "T2": (0, 50),
        "T3": (40, 70),
        "T4": (0, 50),
        "T5": (66.7, 66.7),
        "T6": (74.2, 74.2),
    }
    assert table["M2"] == {"T1": (40, 84), "T2": (30, 79), "T3": (70, 93), "T4": (70, 85)}
    assert table["M3"]["T6"] == (38.8, 82.1) and table["M4"]["T2"] == (0, 46.5)
    assert all(set(cells) <= set(FAMILIES) for cells in table.values())


def test_what_keeps_no_order_has_a_version_of_its_own(monkeypatch: pytest.MonkeyPatch) -> None:
    def ids() -> list[str]:
        settings = (("T3", ""), ("T3", "panda"), ("T7", ""), ("T3", "panda-lift"))
        return [Unit(family, 0, None, BenchSetting(robot=robot)).id("v") for family, robot in settings]  # type: ignore[arg-type]

    before = ids()
    monkeypatch.setattr("executor.bench.units.UNORDERED_VERSION", UNORDERED_VERSION + 1)
    assert [one == two for one, two in zip(before, ids(), strict=True)] == [True, True, False, False]
