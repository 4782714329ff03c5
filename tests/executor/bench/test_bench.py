"""`scene2demo bench` with invented units: resuming, crashes, Ctrl-C, shards, the table, the report."""

from __future__ import annotations

import importlib
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from html.parser import HTMLParser
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from benchmarks.baselines import __main__ as baselines
from executor.bench.folder import BenchFolder, NotABench
from executor.bench.tables import write_results
from executor.bench.units import BenchSetting, Series
from executor.campaign import engine, versions
from executor.cli import app
from executor.cli.commands import bench
from executor.system.workers import WorkerOutcome
from tests.executor.bench.invented_worker import SLOW_S
from tests.executor.cli.conftest import environment

INVENTED = "tests.executor.bench.invented_worker"
# Seeds that end in 0, 1, 2, 3: three successes and a process that crashes.
SEED, EPISODES = 14000, 4
Bench = Callable[..., tuple[int, dict[str, Any]]]


@pytest.fixture
def run_bench(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Bench:
    """Run the command in this process, its units in invented workers; returns exit code and summary."""
    monkeypatch.setattr(bench, "WORKER", INVENTED)
    monkeypatch.setattr(versions, "outcome_version", lambda: "the version of a test")

    def run(*words: str | int, family: str = "T3") -> tuple[int, dict[str, Any]]:
        given = ["bench", family, "--out", str(tmp_path / "b"), "--workers", "1", "--json", *map(str, words)]
        code = app.run(given)
        return code, json.loads(capsys.readouterr().out)

    return run


@pytest.mark.physics
def test_a_worker_measures_nothing_for_a_program_that_it_does_not_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(versions, "outcome_version", lambda: "0123456789abcdef")
    given = ["bench", "T3", "--episodes", "2", "--workers", "1", "--out", str(tmp_path / "b")]
    assert app.run(given) == 1
    said = " ".join(capsys.readouterr().err.split())
    assert "the request is for version '0123456789abcdef'" in said and "start the same command again" in said
    assert not unit_files(tmp_path / "b")


def unit_files(folder: Path) -> dict[str, float]:
    return {path.name: path.stat().st_mtime_ns for path in (folder / "units").glob("*.json")}


def test_a_crash_costs_one_unit_and_is_counted(run_bench: Bench, tmp_path: Path) -> None:
    code, summary = run_bench("--seed", SEED, "--episodes", EPISODES)
    (cell,) = summary["cells"]
    assert code == 0 and cell["finished"] == EPISODES
    assert (cell["all"]["successes"], cell["all"]["trials"]) == (3, 4)
    assert cell["reasons"] == {"crashed": 1}
    assert [failed["unit"] for failed in summary["failed"]] == ["T3-014003-planned"]
    assert "status 11" in summary["failed"][0]["failure"]["message"]
    assert json.loads((tmp_path / "b" / "summary.json").read_text())["cells"] == summary["cells"]


def test_a_benchmark_in_which_nothing_succeeds_fails(run_bench: Bench) -> None:
    assert run_bench("--seed", 14005, "--episodes", 2)[0] == 1  # Seeds that end in 5 and 6.
    assert run_bench("--seed", 14005, "--episodes", 2)[0] == 1
    assert run_bench("--seed", 14006, "--episodes", 2)[0] == 0


def test_a_missing_unit_is_run_again_and_nothing_else(run_bench: Bench, tmp_path: Path) -> None:
    run_bench("--seed", SEED, "--episodes", EPISODES)
    before = unit_files(tmp_path / "b")
    lost = next(name for name in before if name.startswith("T3-014001"))
    broken = next(name for name in before if name.startswith("T3-014002"))
    (tmp_path / "b" / "units" / lost).unlink()
    (tmp_path / "b" / "units" / broken).write_text("{half a fi")
    _, summary = run_bench("--seed", SEED, "--episodes", EPISODES)
    after = unit_files(tmp_path / "b")
    assert set(after) == set(before) and summary["cells"][0]["finished"] == EPISODES
    assert {name for name in after if after[name] != before[name]} == {lost, broken}


def test_crashed_units_are_run_once_more_only_when_asked(run_bench: Bench, tmp_path: Path) -> None:
    run_bench("--seed", SEED, "--episodes", EPISODES)
    before = unit_files(tmp_path / "b")
    run_bench("--seed", SEED, "--episodes", EPISODES)
    assert unit_files(tmp_path / "b") == before
    run_bench("--seed", SEED, "--episodes", EPISODES, "--again")
    after = unit_files(tmp_path / "b")
    assert [name[:9] for name in after if after[name] != before[name]] == ["T3-014003"]


def test_more_episodes_go_on_from_fewer(run_bench: Bench, tmp_path: Path) -> None:
    run_bench("--seed", SEED, "--episodes", 2)
    before = unit_files(tmp_path / "b")
    _, summary = run_bench("--seed", SEED, "--episodes", 3)
    after = unit_files(tmp_path / "b")
    assert len(after) == 3 and before.items() <= after.items()
    assert summary["cells"][0]["all"]["trials"] == 3


def test_another_version_of_the_program_counts_for_itself(
    run_bench: Bench, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run_bench("--seed", SEED, "--episodes", 2)
    monkeypatch.setattr(versions, "outcome_version", lambda: "a later version")
    _, summary = run_bench("--seed", SEED, "--episodes", 1)
    assert summary["cells"][0]["all"]["trials"] == 1 and len(unit_files(tmp_path / "b")) == 3
    found = BenchFolder(tmp_path / "b").find("T3-014000-planned")
    assert found["version"] == "a later version"


def test_shards_fill_one_folder_together(run_bench: Bench) -> None:
    words = ("--seed", SEED, "--episodes", 3)
    first, second = (run_bench(*words, "--shard", f"{part}/2")[1] for part in (1, 2))
    assert first["cells"][0]["finished"] == 2 and second["cells"][0]["finished"] == 3


def test_rows_of_several_settings_stand_in_one_table(run_bench: Bench) -> None:
    run_bench("--seed", SEED, "--episodes", 1)
    _, summary = run_bench("--seed", SEED, "--episodes", 1, "--flows", "paper", "--evolve")
    rows = {row["method"]: row["T3"] for row in summary["table"]}
    assert rows["M1 paper (Primitive)"] == "40 / 70" and rows["M2 paper (Prim+Evo)"] == "70 / 93"
    assert rows["here: planned flows"] == rows["here: paper's flows + evo"] == "100 / 100"


class Page(HTMLParser):
    """Checks that tags are closed in order, and keeps the text."""

    VOID = frozenset({"meta", "br", "img", "link", "input"})

    def __init__(self, markup: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.words: list[str] = []
        self.addresses: list[str] = []
        self.feed(markup)
        assert not self.open

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.addresses += [value or "" for name, value in attrs if name in ("src", "href")]
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.words.append(data)


def test_the_report_lists_every_failure_with_the_command_that_shows_it(run_bench: Bench, tmp_path: Path) -> None:
    run_bench("--seed", SEED, "--episodes", 7)
    page = Page((tmp_path / "b" / "report.html").read_text())
    text = " ".join(page.words)
    failed = {f"#T3-{seed:06d}-planned" for seed in (14003, 14004, 14005, 14006)}
    assert set(page.addresses) == failed, "links lead to what failed; nothing was run again that could be shown"
    for seed in (14003, 14004, 14005, 14006):
        assert f"bench replay {tmp_path / 'b'} T3-{seed:06d}-planned" in text
    assert "the fingers closed on <nothing> & stayed shut" in text
    assert "no room could be made of this seed" in text and "status 11" in text
    assert "LIFT_EEF_DOWN 0.3" in text
    assert "3 of 7, 42.9 %" in text and "M4 RoboGen (Primitive)" in text


def test_what_was_run_again_is_linked_and_shown(run_bench: Bench, tmp_path: Path) -> None:
    run_bench("--seed", SEED, "--episodes", EPISODES)
    folder = BenchFolder(tmp_path / "b")
    name = "T3-014003-planned"
    folder.replay(name).mkdir(parents=True)
    for file in ("report.html", "video.mp4"):
        (folder.replay(name) / file).write_text("made again")
    write_results(folder)
    page = Page((tmp_path / "b" / "report.html").read_text())
    shown = [address for address in page.addresses if not address.startswith("#")]
    assert set(shown) == {f"replays/{name}/report.html", f"replays/{name}/video.mp4"}
    assert all((tmp_path / "b" / address).is_file() for address in shown)


@pytest.mark.parametrize(
    ("family", "ended", "baseline", "expected"),
    [
        ("T1", "failed", None, "bench replay b T1-000003-planned"),
        ("T7", "failed", None, "run 'pick up the mug' --scene t7-3 --keep-sizes --out FOLDER"),
        ("T7", "refused", None, "plan 'pick up the mug' --scene t7-3 --keep-sizes"),
        ("T3", "failed", "unchecked", ""),
    ],
)
def test_only_what_works_is_offered(family: str, ended: str, baseline: str | None, expected: str) -> None:
    result = {
        "name": f"{family}-000003-planned",
        "family": family,
        "seed": 3,
        "query": "pick up the mug",
        "ended": ended,
    }
    commands = list(BenchFolder(Path("b")).commands(result | {"setting": {"baseline": baseline}}))
    assert [command for _, command in commands] == [f"scene2demo {expected}"] * bool(expected)


@pytest.mark.parametrize(
    ("folder", "recorded", "expected"),
    [
        ("b", True, "--model replay:b/answers/W-01234567/exchanges.jsonl --temperature=0.5 --model-seed=7"),
        ("b c", True, "--model 'replay:b c/answers/W-01234567/exchanges.jsonl' --temperature=0.5 --model-seed=7"),
        ("b", False, ""),
        ("b,openai:gpt-5.2", True, ""),
    ],
)
def test_a_wish_that_a_model_planned_is_shown_by_its_answers(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, folder: str, recorded: bool, expected: str
) -> None:
    monkeypatch.chdir(tmp_path)
    model = {"name": "openai:gpt-5.2", "models": [], "temperature": 0.5, "seed": 7, "templates": "0" * 16}
    result = {"name": "W", "id": "0123456789", "family": "T7", "seed": 3, "query": "pick up the mug"}
    result |= {"setting": {"model": model}, "ended": "refused"}
    if recorded:
        BenchFolder(Path(folder)).answers(result).parent.mkdir(parents=True)
        BenchFolder(Path(folder)).answers(result).touch()
    commands = [command for _, command in BenchFolder(Path(folder)).commands(result)]
    wish = "scene2demo plan 'pick up the mug' --scene t7-3 --keep-sizes"
    assert commands == [f"{wish} {expected}"] * bool(expected)


def test_the_terminal_shows_the_table(
    run_bench: Bench, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    run_bench("--seed", SEED, "--episodes", EPISODES)
    assert app.run(["bench", "T3", "--out", str(tmp_path / "b"), "--seed", str(SEED), "--episodes", "4"]) == 0
    answer = capsys.readouterr()
    assert "here: planned flows" in answer.out and "38.8/82.1" in answer.out
    assert "3 of 4, 75 % (19.4 to 99.4)" in answer.out
    assert "at most 0.4 mm, deepest 0.7 mm (robot/finger and apple_0/apple)" in answer.out
    assert "1 crashed" in answer.out and "bench replay" in answer.out
    assert "4 of 4 units done already, 0 to run now" in answer.err


def test_a_baseline_is_a_row_of_its_own(
    run_bench: Bench, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(baselines, "WORKER", INVENTED)
    assert (
        baselines.main(["unchecked", "T3", "--seed", str(SEED), "--episodes", "2", "--out", str(tmp_path / "b")]) == 0
    )
    assert capsys.readouterr().err.count("succeeded") == 2
    _, summary = run_bench("--seed", SEED, "--episodes", EPISODES)
    cells = {cell["label"]: cell for cell in summary["cells"]}
    assert set(cells) == {"here: planned flows", "here: unchecked"}
    own = cells["here: unchecked"]
    assert own["all"]["successes"] == 2
    assert cells["here: planned flows"]["finished"] == EPISODES
    assert own["version"] != "the version of a test"
    assert app.run(["bench", "replay", str(tmp_path / "b"), "T3-014000-unchecked", "--out", str(tmp_path / "r")]) == 2
    assert "baselines are not shown again" in capsys.readouterr().err


@pytest.mark.parametrize("asked_by", [signal.SIGINT, pytest.param(signal.SIGTERM, marks=pytest.mark.slow)])
def test_being_asked_to_end_keeps_what_was_finished(tmp_path: Path, asked_by: signal.Signals) -> None:
    words = ["bench", "T3", "--out", "b", "--workers", "1", "--seed", str(SEED + 8), "--episodes", "2"]
    child = subprocess.Popen(
        [sys.executable, "-m", "tests.executor.bench.interrupted_bench", *words],
        cwd=tmp_path,
        env=environment(),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    units = tmp_path / "b" / "units"
    while not list(units.glob("T3-014008*.json")) and child.poll() is None:
        time.sleep(0.05)
    # The second unit is being worked on, for longer than this test lasts.
    os.kill(child.pid, asked_by)
    out, err = child.communicate(timeout=SLOW_S)
    assert child.returncode == 130 and "Traceback" not in err
    assert "interrupted; finished units are kept" in err and "1 of 1, 100 %" in out
    assert [path.name[:9] for path in units.glob("*.json")] == ["T3-014008"]
    assert not list(units.glob(".*"))
    assert json.loads((tmp_path / "b" / "summary.json").read_text())["cells"][0]["finished"] == 1


def test_two_runs_do_not_do_the_same_units_at_once(run_bench: Bench, tmp_path: Path) -> None:
    running = tmp_path / "b" / "running"
    running.mkdir(parents=True)
    # What a run that was killed leaves: its lock is gone, so nobody minds it.
    (running / "elsewhere-1.json").write_text("{}")
    words = ["bench", "T3", "--out", "b", "--workers", "1", "--seed", str(SEED + 9), "--episodes", "1"]
    first = subprocess.Popen(
        [sys.executable, "-m", "tests.executor.bench.interrupted_bench", *words],
        cwd=tmp_path,
        env=environment(),
        stderr=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
    )
    try:
        while not list(running.glob(f"*-{first.pid}.json")) and first.poll() is None:
            time.sleep(0.05)
        assert [path.stem.rpartition("-")[2] for path in running.glob("*.json")] == [str(first.pid)]
        code, told = run_bench("--seed", SEED + 8, "--episodes", 2)
        assert code == 2 and told["error"]["kind"] == "BenchBusy"
        assert f"process {first.pid} on " in told["error"]["message"]
        assert "works on 1 of these units in" in told["error"]["message"]
        # Other units of the same folder are nobody else's.
        assert run_bench("--seed", SEED, "--episodes", 2)[0] == 0
    finally:
        first.send_signal(signal.SIGINT)
        first.wait(timeout=SLOW_S)
    assert not running.exists()
    assert run_bench("--seed", SEED, "--episodes", 2)[0] == 0


def test_ctrl_c_before_anything_is_loaded(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    app.commands()  # Their options are known.
    load = importlib.import_module

    def interrupted(name: str) -> ModuleType:
        if name == "executor.cli.commands.bench":
            raise KeyboardInterrupt
        return load(name)

    monkeypatch.setattr(app, "import_module", interrupted)
    assert app.run(["bench", "T3", "--out", str(tmp_path / "b")]) == 130
    assert capsys.readouterr().err == "scene2demo: interrupted\n"


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--shard", "5/4"], "--shard 5/4"),
        (["--shard", "half"], "--shard half"),
        (["--workers", "0"], "--workers 0"),
        (["--episodes", "0"], "--episodes 0"),
        (["--limit-s", "0"], "--limit-s 0"),
        (["--limit-s", "nan"], "--limit-s nan"),
        (["--limit-s", "inf"], "--limit-s inf: expected a number of seconds above 0, at most 604800"),
    ],
)
def test_options_that_make_no_sense(
    words: list[str], message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert app.run(["bench", "T3", "--out", str(tmp_path / "b"), *words]) == 2
    assert message in capsys.readouterr().err
    assert not (tmp_path / "b").exists()


def test_a_bench_of_nothing_is_misuse(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert app.run(["bench", "--out", str(tmp_path / "b")]) == 2
    assert "at least one of T1, T2, T3, T4, T5, T6" in capsys.readouterr().err


def test_flows_that_the_paper_does_not_print_are_misuse(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert app.run(["bench", "T1", "T5", "--flows", "paper", "--out", str(tmp_path / "b")]) == 2
    assert "prints no flows" in capsys.readouterr().err


def _index_of(many: str) -> str:
    """Return the text of an index that lists one series of so many episodes."""
    return f'{{"series": [{{"family": "T1", "seed": 1, "episodes": {many}, "setting": {{}}, "version": "v"}}]}}'


@pytest.mark.parametrize(
    ("index", "message"),
    [
        ("{half", "its bench.json is not JSON"),
        ("[]", "its bench.json does not list series as one does"),
        ('{"a": 1}', "its bench.json does not list series as one does"),
        ('{"series": [{"family": "T9", "seed": 1, "episodes": 1, "setting": {}, "version": "v"}]}', "does not list"),
        ('{"series": [{"family": "T1", "seed": "x", "episodes": 1, "setting": {}, "version": "v"}]}', "does not list"),
        ('{"series": [{"family": "T1", "seed": 1, "episodes": 1, "setting": {"flows": "?"}, "version": "v"}]}', "list"),
        *((_index_of(many), "list") for many in ("-1", "true", "1e308", "1000000000000000000", "NaN", "null")),
        pytest.param("[" * 100_000, "its bench.json is not JSON (it is nested too deeply)", id="deep"),
        pytest.param(f"[{'9' * 5_000}]", "its bench.json is not JSON", id="digits"),
    ],
)
def test_a_folder_of_something_else_is_bad_input(
    index: str, message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "bench.json").write_text(index)
    assert app.run(["bench", "T3", "--out", str(tmp_path)]) == 2
    told = " ".join(capsys.readouterr().err.split())
    assert "is not a benchmark's folder" in told and message in told
    assert (tmp_path / "bench.json").read_text() == index and len(list(tmp_path.iterdir())) == 1


def test_a_file_is_no_folder(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "b").write_text("mine")
    assert app.run(["bench", "T3", "--out", str(tmp_path / "b")]) == 2
    assert "is not a benchmark's folder: it is a file" in " ".join(capsys.readouterr().err.split())


def test_results_of_something_else_are_not_replaced(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "report.html").write_text("of a run")
    assert app.run(["bench", "T3", "--out", str(tmp_path)]) == 2
    told = " ".join(capsys.readouterr().err.split())
    assert "it has report.html of something else; choose another folder with --out" in told
    assert (tmp_path / "report.html").read_text() == "of a run" and not (tmp_path / "bench.json").exists()


@pytest.mark.parametrize("content", ["{half", "{}", "[]", '{"name": "T3-000001-planned", "ended": "failed"}'])
def test_a_unit_that_cannot_be_read_cannot_be_replayed(
    content: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder, unit = BenchFolder(tmp_path), next(Series("T3", 1, 1, BenchSetting(), "v").units())
    folder.add_series([Series("T3", 1, 1, BenchSetting(), "v")])
    folder.write(unit, "v", {"ended": "succeeded"})
    folder.place(unit, "v").write_text(content)
    assert app.run(["bench", "replay", str(tmp_path), unit.name, "--out", str(tmp_path / "out")]) == 2
    assert "is not a unit of a benchmark" in " ".join(capsys.readouterr().err.split())


def test_a_result_that_cannot_be_kept_ends_the_processes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    ended: list[str] = []

    class Pool:
        def __init__(self, *_: Any, **__: Any) -> None: ...

        def run(self, requests: list[dict[str, Any]]) -> Iterator[WorkerOutcome]:
            try:
                for request in requests:
                    yield WorkerOutcome(request, "finished", {"ended": "succeeded"}, "", 0.0, 1.0, 1)
            finally:
                ended.append("closed")

    def full_disk(*_: object) -> None:
        raise OSError(28, "No space left on device", "units")

    monkeypatch.setattr(engine, "WorkerPool", Pool)
    units = [(unit, "v") for unit in Series("T3", 1, 2, BenchSetting(), "v").units()]
    # What the exception refers to keeps the iteration alive, so only closing it ends the processes.
    with pytest.raises(OSError, match="No space") as kept:
        engine.Campaign(BenchFolder(tmp_path), INVENTED, 1).run(units, full_disk)
    assert ended == ["closed"] and kept.tb is not None


def test_units_that_are_not_there(tmp_path: Path) -> None:
    folder = BenchFolder(tmp_path)
    with pytest.raises(NotABench, match=r"is not a benchmark's folder: its bench.json cannot be read \(No such file"):
        folder.series()
    series = Series("T3", 1, 3, BenchSetting(), "v")
    folder.add_series([series])
    with pytest.raises(NotABench, match="has no unit 'T3-000001'; it has 0"):
        folder.find("T3-000001")
    for unit in series.units():
        folder.write(unit, "v", {"ended": "succeeded"})
    assert folder.find("T3-000002")["seed"] == 2
    assert folder.find("units/T3-000003-planned.json")["seed"] == 3
    with pytest.raises(NotABench, match="is the beginning of 3 units"):
        folder.find("T3-00000")
