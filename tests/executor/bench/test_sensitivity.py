"""The table of sensitivities: every setting is in it, rows count what the files say, one file an episode."""

from __future__ import annotations

import json
from dataclasses import fields
from pathlib import Path

import pytest

from benchmarks.audit import units
from benchmarks.sensitivity import SEED, USUAL, VALUES, cells, path_of, physics_of, run, table
from executor.sim.engine import STANDARD, Physics


def test_every_setting_is_changed_alone_and_never_to_its_usual_value() -> None:
    assert set(VALUES) == {field.name for field in fields(Physics)}
    tried = [physics_of(cell) for cell in cells(list(VALUES))]
    assert tried[0] == STANDARD and STANDARD not in tried[1:]
    for physics in tried[1:]:
        assert sum(getattr(physics, name) != getattr(STANDARD, name) for name in VALUES) == 1


def test_rows_count_episodes_with_exact_intervals(tmp_path: Path) -> None:
    drawn = list(units(4, SEED))
    for cell, failures in (((USUAL, 1.0), 0), (("grip_force", 0.5), 6)):
        for index, unit in enumerate(drawn):
            failure = {"kind": "slipped"} if index < failures else None
            kept = {"unit": unit.to_json(), "factor": cell[0], "value": cell[1], "failure": failure}
            path = path_of(tmp_path, cell, unit)
            path.parent.mkdir(exist_ok=True)
            path.write_text(json.dumps({**kept, "succeeded": failure is None}))
    rows = table(tmp_path).splitlines()[2:]
    assert rows == [
        "| usual | 1 | 24 | 24 | 86 to 100 % | 4/4 | 4/4 | 4/4 | 4/4 | 4/4 | 4/4 | - |",
        "| grip_force | 0.5 | 24 | 18 | 53 to 90 % | 0/4 | 2/4 | 4/4 | 4/4 | 4/4 | 4/4 | 6 slipped |",
    ]


@pytest.mark.slow
@pytest.mark.physics
def test_a_run_goes_on_where_it_was_and_a_hand_without_strength_fails(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(VALUES, "grip_force", (0.002,))  # type: ignore[arg-type]
    monkeypatch.setattr("benchmarks.sensitivity.units", lambda count, seed: list(units(count, seed))[5:6])
    run(tmp_path, ["grip_force"], 1, 62001)
    files = sorted(tmp_path.glob("*/*.json"))
    ended = {path.parent.name: json.loads(path.read_text()) for path in files}
    assert ended["usual-1"]["succeeded"] and not ended["grip_force-0.002"]["succeeded"]
    times = [path.stat().st_mtime_ns for path in files]
    run(tmp_path, ["grip_force"], 1, 62001)
    assert [path.stat().st_mtime_ns for path in files] == times
