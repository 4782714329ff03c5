"""`scene2demo bench` end to end, in the physics: a unit, its numbers, and the same unit again."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.executor.cli.conftest import Command

pytestmark = [pytest.mark.physics, pytest.mark.slow]


def test_a_bench_and_one_of_its_units_again(command: Command, tmp_path: Path) -> None:
    """T3 is the shortest family: two subtasks, some twenty seconds simulated."""
    words = ("bench", "T3", "--seed", "14002", "--episodes", "1", "--workers", "1", "--out", "b")
    summary = command(*words, "--json").data
    (cell,) = summary["cells"]
    (path,) = (tmp_path / "b" / "units").glob("*.json")
    unit = json.loads(path.read_text())
    assert cell["finished"] == 1 and cell["all"]["successes"] == (unit["ended"] == "succeeded")
    assert unit["query"] == "put the apple into the bowl"
    assert len(unit["state_hash"]) == 64 and unit["simulated_s"] > 1.0 and unit["rss_mb"] > 50.0
    assert unit["wall_s"]["planning"] + unit["wall_s"]["physics"] <= unit["elapsed_s"]

    again = command("bench", "replay", "b", "T3-014002-planned", "--out", "again", "--no-video", "--json")
    assert again.code == 0 and again.data["same_states"] is True
    assert again.data["rollout"]["state_hash"] == unit["state_hash"]
    assert {"report.html", "rollout.json", "task.json"} <= {file.name for file in (tmp_path / "again").iterdir()}

    path.write_text(json.dumps({**unit, "state_hash": "0" * 64}))
    other = command("bench", "replay", "b", path.name, "--out", "other", "--no-video")
    assert other.code == 1 and "OTHER states than when it was measured" in other.out
