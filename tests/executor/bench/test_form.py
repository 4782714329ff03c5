"""What others write into a benchmark's folder is counted when it is a unit's result, and else left alone."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from executor.bench.folder import BenchFolder, is_result
from executor.bench.tables import write_results
from executor.bench.units import BenchSetting, Series, Unit
from oag.sizes import Resizing
from tests.executor.bench.invented_worker import FAIL, invented

SERIES = Series("T3", 1, 1, BenchSetting(), "v")


def result(unit: Unit, seed: int) -> dict[str, Any]:
    """Return what a unit's file holds."""
    wall = {"started_s": 1.7e9, "elapsed_s": 3.0, "worker": 7}
    scaled = [Resizing("apple_0", (0.62,) * 3, (0.08,) * 3, (0.05,) * 3).to_json()]
    told = {**invented(seed), **wall, "revisions": 1, "succeeded_at_once": False, "scaled": scaled}
    # As a file has it, where a tuple is a list.
    read: dict[str, Any] = json.loads(json.dumps({"id": unit.id("v"), "name": unit.name, **unit.to_json(), **told}))
    return read


@pytest.mark.parametrize("seed", [1, FAIL])
def test_a_result_is_one(seed: int) -> None:
    assert is_result(result(next(SERIES.units()), seed))


HOSTILE: list[object] = [None, "x", -1, 1e308, float("nan"), 10**400, [], {}, [None], {"a": 1}, True, [[]], {"kind": 1}]


def changes(value: Any) -> Iterator[Any]:
    """Yield the value with one of its parts replaced or left out."""
    yield from HOSTILE
    if isinstance(value, dict):
        for key, part in value.items():
            yield {name: other for name, other in value.items() if name != key}
            yield from ({**value, key: changed} for changed in changes(part))
    elif isinstance(value, list) and value:
        yield from ([changed, *value[1:]] for changed in changes(value[0]))


@pytest.mark.slow
def test_no_value_of_any_field_stops_the_table(tmp_path: Path) -> None:
    folder, unit = BenchFolder(tmp_path), next(SERIES.units())
    folder.add_series([SERIES])
    whole = result(unit, FAIL)
    place = folder.place(unit, "v")
    place.parent.mkdir()
    counted = set()
    for number, changed in enumerate(changes(whole)):
        # What is no result is passed over before a table is made: every tenth of it says so.
        if number % 10 and not is_result(changed):
            continue
        place.write_text(json.dumps(changed))
        (cell,) = write_results(folder)
        counted.add(len(cell.results))
    assert counted == {0, 1}


@pytest.mark.parametrize("content", ["[" * 100_000, "9" * 5_000, "\\ud800", "{}", "null", ""])
def test_what_is_no_result_is_not_there(tmp_path: Path, content: str) -> None:
    folder, unit = BenchFolder(tmp_path), next(SERIES.units())
    folder.add_series([SERIES])
    folder.write(unit, "v", result(unit, 1))
    assert folder.read(unit, "v") is not None
    folder.place(unit, "v").write_text(content)
    assert folder.read(unit, "v") is None
    assert write_results(folder)[0].results == []
