"""The robot opens an imported cabinet by the handle that was inferred, and picks up an imported bottle."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from executor.assets.importers.importer import import_asset
from executor.assets.library import sample
from tests.executor.assets.importers.drawers import write_drawers
from tests.executor.assets.test_library_rollouts import TABLE_M, run

pytestmark = [pytest.mark.physics, pytest.mark.slow]


def test_it_is_opened_by_its_handle(cabinet: Path) -> None:
    fixture = import_asset(cabinet, "cabinet", height_m=1.2).as_object("cabinet_0")
    placed = replace(fixture, position=(0.75 + fixture.extent_m[0] / 2, 0.0, fixture.extent_m[2] / 2))
    objects = {"cabinet_0": placed}
    subtask = {
        "target": "cabinet_0",
        "init": "(not (open cabinet_0))",
        "goal": "(open cabinet_0)",
        "flow": [17, 1, 2, 3, {"4": None}, 5, 6],
    }
    assert run("open_it", objects, "(not (open cabinet_0))", subtask) == ""


def test_a_drawer_is_opened_by_its_handle(tmp_path: Path) -> None:
    fixture = import_asset(write_drawers(tmp_path / "45135"), "drawers").as_object("cabinet_0")
    placed = replace(fixture, position=(0.75 + fixture.extent_m[0] / 2, 0.0, fixture.extent_m[2] / 2))
    subtask = {
        "target": "cabinet_0",
        "init": "(not (open cabinet_0))",
        "goal": "(open cabinet_0)",
        "flow": [17, 1, 2, 3, {"4": None}, 5, 6],
    }
    assert run("open_it", {"cabinet_0": placed}, "(not (open cabinet_0))", subtask) == ""


def test_it_is_picked_up(bottle_mesh: Path) -> None:
    item = import_asset(bottle_mesh, "flask", category="bottle").as_object("bottle_0")
    table = sample("table_four_legs", 0, "table_0")
    objects = {
        "table_0": replace(table, bbox_extent=TABLE_M, position=(1.2, 0.0, TABLE_M[2] / 2)),
        "bottle_0": replace(item, position=(1.05, 0.0, TABLE_M[2] + item.extent_m[2] / 2)),
    }
    subtask = {
        "target": "bottle_0",
        "support_init": "table_0",
        "init": "(ontop bottle_0 table_0)",
        "goal": "(not (ontop bottle_0 table_0))",
        "flow": [17, 1, 2, 3, {"7": None}],
    }
    assert run("pick_it", objects, "(ontop bottle_0 table_0)", subtask) == ""
