"""Successes and widths as limits: units that are not wanted any more do not begin, and what is there counts."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from executor.bench.units import BenchSetting, Series, Unit
from executor.cli import app
from executor.cli.commands.bench import _Narrow
from executor.cli.output import Pace, span_text
from executor.data.store import EpisodeStore

DATA, BENCH = "tests.executor.data.invented_worker", "tests.executor.bench.invented_worker"
Run = Callable[..., tuple[int, dict[str, Any]]]


@pytest.fixture
def run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Run:
    """Run a command in this process, its units in invented workers; returns exit code and what it printed."""
    monkeypatch.setattr("executor.data.generation.WORKER", DATA)
    monkeypatch.setattr("executor.cli.commands.bench.WORKER", BENCH)

    def run(command: str, *words: object) -> tuple[int, dict[str, Any]]:
        code = app.run([command, *map(str, words), "--out", str(tmp_path / command), "--workers", "1", "--json"])
        return code, json.loads(capsys.readouterr().out)

    return run


def test_generate_ends_with_the_successes_that_are_wanted(run: Run, tmp_path: Path) -> None:
    code, said = run("generate", "T1", "--seed", 0, "--successes", 2)
    assert code == 0 and said["endings"] == {"succeeded": 2}
    assert [one.meta["unit"]["seed"] for one in EpisodeStore(tmp_path / "generate").episodes()] == [0, 1]
    # The same request has its successes; one that wants more goes on.
    assert run("generate", "T1", "--seed", 0, "--successes", 2)[1]["made"] == 0
    code, said = run("generate", "T1", "--seed", 0, "--successes", 3)
    assert said["made"] == 1 and said["endings"]["succeeded"] == 3


def test_generate_gives_up_after_the_episodes_that_may_be_tried(run: Run) -> None:
    # Seeds that end in 3 fail, those in 4 crash.
    code, said = run("generate", "T1", "--seed", 2, "--successes", 3, "--episodes", 3)
    assert code == 0 and said["endings"] == {"succeeded": 1, "failed": 1, "crashed": 1}


def test_lines_count_what_is_wanted_and_the_last_one_is_the_next_command(
    run: Run, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    generate = ["generate", "T1", "--seed", "1", "--successes", "3", "--episodes", "4"]
    for words, lines in (
        (generate, ["1 of 3 successes, 1 tried", "2 of 3 successes, 2 tried", "2 of 3 successes, 3 tried"]),
        (["bench", "T3", "--episodes", "3"], ["1 of 3 ", "2 of 3 ", "3 of 3 "]),
    ):
        assert app.run([*words, "--out", str(tmp_path / words[0]), "--workers", "1"]) == 0
        said = capsys.readouterr()
        assert all(line in said.err for line in lines), said.err
        assert said.out.splitlines()[-1].startswith("next") and "scene2demo " in said.out.splitlines()[-1]


def test_status_of_a_store_with_its_successes_wants_no_more(
    run: Run, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run("generate", "T1", "--seed", 0, "--successes", 2)
    run("generate", "T1", "--seed", 3, "--episodes", 2)
    assert app.run(["status", str(tmp_path / "generate"), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["asked"] == found["done"] == 4 and found["failures"] == {"slipped": 1, "crashed": 1}
    assert found["running"] == found["lost"] == 0 and found["runs"] == []


@pytest.mark.parametrize(("until", "units"), [(75, 3), (70, 8), (1, 9)])
def test_bench_ends_when_the_interval_is_narrow_enough(
    until: float, units: int, run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # Three successes in three leave 71 points, four in eight 69; in between five endings widen the interval.
    monkeypatch.setattr("executor.cli.commands.bench.LEAST_UNITS", 3)
    assert run("bench", "T3", "--seed", 0, "--episodes", 9, "--until", until)[0] == 0
    assert len(list((tmp_path / "bench" / "units").iterdir())) == units
    # What is done already counts.
    assert run("bench", "T3", "--seed", 0, "--episodes", 9, "--until", until)[0] == 0
    assert len(list((tmp_path / "bench" / "units").iterdir())) == units


def test_a_repeated_unit_counts_once_for_a_width() -> None:
    unit = Unit("T3", 0, None, BenchSetting())
    series = [Series("T3", 0, 9, BenchSetting(), "v")]

    class Folder:
        def results(self, _: Series) -> list[dict[str, str]]:
            return [{"id": "a", "ended": "crashed"}, {"id": "b", "ended": "succeeded"}]

    narrow = _Narrow(Folder(), series, 70.0)  # type: ignore[arg-type]
    narrow.note(unit, {"id": "a", "ended": "succeeded"})
    cell = narrow._cells["T3"]
    assert sorted(result["id"] for result in cell.results) == ["a", "b"] and not cell.failed


def test_a_part_ends_with_an_error_only_where_none_of_its_units_came_to_an_end(run: Run) -> None:
    # Seed 3 crashes, 5 fails.
    assert run("bench", "T3", "--seed", 3, "--episodes", 1, "--shard", "1/2")[0] == 1
    assert run("bench", "T3", "--seed", 3, "--episodes", 1, "--shard", "2/2")[0] == 0
    assert run("bench", "T3", "--seed", 5, "--episodes", 1, "--shard", "1/2")[0] == 0


def test_status_of_a_store_with_a_request_that_is_none(
    run: Run, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    EpisodeStore(tmp_path / "s").add_requests([{}])
    assert app.run(["status", str(tmp_path / "s"), "--json"]) == 2
    assert json.loads(capsys.readouterr().out)["error"]["kind"] == "NotADataset"


def test_limits_of_outcomes_are_no_matter_of_parts(run: Run) -> None:
    for words in (
        ("bench", "T3", "--until", 14, "--shard", "1/2"),
        ("bench", "T3", "--until", 140),
        ("generate", "T3", "--successes", 2, "--shard", "1/2"),
        ("generate", "T3", "--successes", 0),
        ("generate", "T3", "--successes", 2, "--slurm", "job.sh"),
        ("bench", "T3", "--ray", "auto", "--slurm", "job.sh"),
    ):
        code, said = run(*words)
        assert code == 2 and said["error"]["kind"] == "BadOption", words


def test_a_pace_tells_rate_and_time_left() -> None:
    pace = Pace(20, 5)
    assert pace.text(5) == "no rate yet"
    pace._began -= 60.0
    assert pace.text(8) == "180 an hour, 4 min left" and pace.text(25).endswith("0 s left")
    assert [span_text(seconds) for seconds in (0.4, 99, 101, 5990, 6100)] == [
        "0 s",
        "99 s",
        "2 min",
        "100 min",
        "1.7 h",
    ]
