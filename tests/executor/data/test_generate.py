"""`scene2demo generate` with invented units: counting, resuming, crashes, a full disk, Ctrl-C, kill -9."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from executor.campaign.versions import outcome_version
from executor.cli import app
from executor.cli.commands import generate as command
from executor.data.generation import Tally, series_of
from executor.data.store import EpisodeStore
from executor.data.units import DemoUnit, Origin
from executor.data.worker import run_unit
from executor.system.workers import HandoverRefused
from tests.executor.cli.conftest import environment
from tests.executor.data.invented_worker import MENDED, SLOW_S

KITCHEN = Path(__file__).resolve().parents[3] / "examples" / "policies" / "kitchen.json"
VERSION = "the version of a test"
INVENTED = "tests.executor.data.invented_worker"
Generate = Callable[..., tuple[int, dict[str, Any]]]


@pytest.fixture
def run_generate(folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Generate:
    """Run the command in this process, its units in invented workers; returns exit code and what it printed."""
    monkeypatch.setattr("executor.data.generation.WORKER", INVENTED)
    monkeypatch.setattr("executor.campaign.versions.outcome_version", lambda: VERSION)

    def run(*words: object) -> tuple[int, dict[str, Any]]:
        code = app.run(["generate", *map(str, words), "--out", str(folder), "--workers", "1", "--json"])
        return code, json.loads(capsys.readouterr().out)

    return run


def test_what_fails_is_counted_and_left_out(run_generate: Generate, folder: Path) -> None:
    code, said = run_generate("T1", "--seed", 0, "--episodes", 5)
    assert code == 0 and said["endings"] == {"succeeded": 3, "failed": 1, "crashed": 1}
    assert said["failures"] == {"slipped": 1, "crashed": 1} and said["kept"] == 3 and said["bytes_each"] == 133
    store = EpisodeStore.open(folder)
    assert [episode.meta["unit"]["seed"] for episode in store.demonstrations()] == [0, 1, 2]
    crashed = next(e for e in store.episodes() if e.meta["ended"] == "crashed")
    assert 0.0 < crashed.meta["wall_s"] < 600.0
    assert "status 11" in crashed.meta["failure"]["message"] or "-11" in crashed.meta["failure"]["message"]


@pytest.mark.slow
def test_how_many_are_made_is_told_line_by_line(
    run_generate: Generate, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run_generate("T1", "--seed", 0, "--episodes", 1)
    assert app.run(["generate", "T1", "--seed", "0", "--episodes", "4", "--workers", "1", "--out", str(folder)]) == 0
    lines = capsys.readouterr().err.splitlines()
    assert "1 of 4 episodes made already, 3 to make now" in lines[0]
    assert [line.split()[:4] for line in lines[1:]] == [[f"{k}", "of", "4", f"T1-00000{k - 1}"] for k in (2, 3, 4)]
    assert [line.split("s  ", 1)[1].split(":")[0] for line in lines[1:]] == ["succeeded", "succeeded", "slipped"]


def test_a_sentence_needs_no_quotes(run_generate: Generate, folder: Path) -> None:
    for sentence in (["open the refrigerator"], ["open", "the", "refrigerator"]):
        code, said = run_generate(*sentence, "--scene", "kitchen_t1", "--seed", 0, "--episodes", 1)
        assert code == 0 and said["endings"] == {"succeeded": 1}
    (request,) = EpisodeStore.open(folder).requests()
    assert "open the refrigerator" in json.dumps(request)


@pytest.mark.slow
def test_what_crashed_is_made_again_when_that_is_asked_for(run_generate: Generate, folder: Path) -> None:
    words = ("T1", "--seed", 3, "--episodes", 2)
    assert run_generate(*words)[1]["endings"] == {"failed": 1, "crashed": 1}
    folder.with_name(MENDED).touch()
    assert run_generate(*words)[1]["made"] == 0
    code, said = run_generate(*words, "--again")
    assert code == 0 and said["made"] == 1 and said["endings"] == {"failed": 1, "succeeded": 1}
    assert [episode.meta["ended"] for episode in EpisodeStore.open(folder).episodes()] == ["failed", "succeeded"]
    assert not list(folder.glob("units/.part-*"))


@pytest.mark.slow
def test_what_a_killed_run_had_begun_goes_when_it_is_made(run_generate: Generate, folder: Path) -> None:
    run_generate("T1", "--seed", 0, "--episodes", 1)
    (done,) = EpisodeStore.open(folder).episodes()
    units = [replace(DemoUnit.from_json(done.meta["unit"]), seed=seed) for seed in (1, 7)]
    mine, other = (folder / "units" / f".part-{unit.folder(VERSION)}-deadbeef" for unit in units)
    for path in (mine, other):
        path.mkdir()
    assert run_generate("T1", "--seed", 0, "--episodes", 2)[1]["made"] == 1
    # Another run, here or on another machine, may be at work on what this one does not make.
    assert not mine.exists() and other.exists()


def test_it_goes_on_where_it_ended(run_generate: Generate, folder: Path) -> None:
    run_generate("T1", "--seed", 0, "--episodes", 2)
    before = {path: path.stat().st_mtime_ns for path in folder.glob("units/*/unit.json")}
    code, said = run_generate("T1", "--seed", 0, "--episodes", 3)
    assert code == 0 and said["made"] == 1 and said["endings"] == {"succeeded": 3}
    assert all(path.stat().st_mtime_ns == when for path, when in before.items())


@pytest.mark.slow
@pytest.mark.parametrize("left", [0, 5, -1])
def test_what_was_cut_off_is_made_again(run_generate: Generate, folder: Path, left: int) -> None:
    run_generate("T1", "--seed", 7, "--episodes", 2)
    first, second = EpisodeStore.open(folder).episodes()
    whole, when = (first.path / "samples.xz").read_bytes(), (second.path / "unit.json").stat().st_mtime_ns
    (first.path / "samples.xz").write_bytes(whole[:left])
    code, said = run_generate("T1", "--seed", 7, "--episodes", 2)
    assert code == 0 and said["made"] == 1 and said["endings"] == {"succeeded": 2}
    assert (first.path / "samples.xz").read_bytes() == whole
    assert (second.path / "unit.json").stat().st_mtime_ns == when
    assert run_generate("T1", "--seed", 7, "--episodes", 2)[1]["made"] == 0


def test_a_plan_of_many_sources(run_generate: Generate, folder: Path, tmp_path: Path) -> None:
    plan = tmp_path / "plan.yaml"
    plan.write_text(
        "episodes: 1\nsources:\n  - families: [T1, T5]\n  - families: [T2]\n    episodes: 2\n    seed: 10\n"
    )
    code, said = run_generate(plan)
    assert code == 0 and said["made"] == 4
    names = [episode.meta["name"] for episode in EpisodeStore.open(folder).episodes()]
    assert names == ["T1-000000", "T2-000010", "T2-000011", "T5-000000-000"]


def test_what_a_plan_leaves_open_is_taken_from_the_command_line(
    run_generate: Generate, folder: Path, tmp_path: Path
) -> None:
    plan = tmp_path / "plan.yaml"
    plan.write_text("seed: 10\nsources:\n  - families: [T1]\n  - families: [T2]\n    episodes: 1\n")
    assert run_generate(plan, "--episodes", 2, "--seed", 0)[0] == 0
    names = [episode.meta["name"] for episode in EpisodeStore.open(folder).episodes()]
    assert names == ["T1-000010", "T1-000011", "T2-000010"]


@pytest.mark.parametrize(
    "plan",
    [
        "rate_hz: 10\nnoise_m: 0",
        "rate_hz: 10.0\nnoise_m: 0.0",
        "rate_hz: 1e1\nnoise_m: -0.0",
        "vary: []\nviews: []\nsize: [128, 128]\nstances: 1",
        "episodes: 1",
    ],
)
@pytest.mark.slow
def test_one_request_has_one_id_however_it_is_typed(run_generate: Generate, tmp_path: Path, plan: str) -> None:
    assert run_generate("T1", "--episodes", 1, "--rate-hz", "10")[1]["made"] == 1
    (tmp_path / "plan.yaml").write_text(f"{plan}\nsources:\n  - families: [T1]\n")
    assert run_generate(tmp_path / "plan.yaml", "--episodes", 1)[1]["made"] == 0
    assert run_generate("T1", "--episodes", 1, "--rate-hz", "1e1", "--noise-m", "-0.0")[1]["made"] == 0
    assert run_generate("T1", "--episodes", 1, "--rate-hz", "10.5")[1]["made"] == 1


@pytest.mark.slow
def test_a_scene_is_the_same_from_wherever_it_is_named(run_generate: Generate, tmp_path: Path) -> None:
    (tmp_path / "elsewhere").mkdir()
    for place in (tmp_path, tmp_path / "elsewhere"):
        (place / "room.json").write_text(KITCHEN.read_text())
    query = "open the refrigerator"
    assert run_generate(query, "--scene", tmp_path / "room.json", "--episodes", 1)[1]["made"] == 1
    plan = tmp_path / "elsewhere" / "plan.yaml"
    plan.write_text(f"episodes: 1\nsources:\n  - query: {query}\n    scene: room.json\n")
    assert run_generate(plan)[1]["made"] == 0
    other = json.loads(KITCHEN.read_text())
    other["robot"]["yaw"] = 0.1
    (tmp_path / "elsewhere" / "room.json").write_text(json.dumps(other))
    assert run_generate(plan)[1]["made"] == 1


@pytest.mark.slow
def test_shards_share_the_work(run_generate: Generate) -> None:
    assert run_generate("T1", "--episodes", 3, "--shard", "1/2")[1]["made"] == 2
    assert run_generate("T1", "--episodes", 3, "--shard", "2/2")[1]["made"] == 1


@pytest.mark.slow
def test_a_spent_budget_ends_it_and_the_rest_is_made_later(run_generate: Generate) -> None:
    code, said = run_generate("T1", "--episodes", 3, "--limit-gb", 1e-9)
    assert (code, said["made"], said["stopped_by"]) == (0, 1, "disk budget")
    assert run_generate("T1", "--episodes", 2, "--limit-gb", 1e-9)[1]["stopped_by"] == ""  # Nothing was left to make.
    assert run_generate("T1", "--episodes", 3)[1]["made"] == 1


def test_a_full_disk_is_one_message_and_what_was_made_stays(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("executor.data.generation.WORKER", INVENTED)
    words = ["generate", "T1", "--seed", "2", "--episodes", "4", "--out", str(folder), "--workers", "1"]
    assert app.run([*words[:-1], "1"]) == 3
    assert "make room" in capsys.readouterr().err
    assert [episode.meta["unit"]["seed"] for episode in EpisodeStore.open(folder).episodes()] == [2, 3, 4]
    assert not list(folder.glob("units/.part-*"))


@pytest.mark.parametrize(
    ("query", "scene", "said"),
    [
        ("dance a waltz", "kitchen_t1", 'cannot plan "dance a waltz": it does not know'),
        ("put the banana into the refrigerator", "kitchen_t1", "nothing in kitchen_t1 is called"),
        ("close the refrigerator", "kitchen_t1", "cannot plan"),
        ("dance a waltz", "t1", "it does not know"),
        ("open the refrigerator", "UNKNOWN", "the plan is not proved"),
    ],
)
def test_a_sentence_that_cannot_be_planned_is_refused_before_a_seed_is_tried(
    query: str, scene: str, said: str, folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    if scene == "UNKNOWN":
        open_world = {**json.loads(KITCHEN.read_text()), "closed": [], "facts": []}
        (tmp_path / "open.json").write_text(json.dumps(open_world))
        scene = str(tmp_path / "open.json")
    assert app.run(["generate", query, "--scene", scene, "--episodes", "5", "--out", str(folder)]) == 1
    printed = " ".join(capsys.readouterr().err.split())
    assert said in printed and "Traceback" not in printed and "unexpected" not in printed
    assert not folder.exists()


def test_a_plan_with_one_hopeless_source_makes_nothing(folder: Path, tmp_path: Path) -> None:
    plan = tmp_path / "plan.yaml"
    plan.write_text("sources:\n  - families: [T1]\n  - query: dance a waltz\n    scene: kitchen_t1\n")
    assert app.run(["generate", str(plan), "--out", str(folder)]) == 1
    assert not folder.exists()


@pytest.mark.slow
def test_what_only_another_room_could_have_is_left_to_the_seeds(run_generate: Generate) -> None:
    code, said = run_generate("put the banana into the refrigerator", "--scene", "t1", "--episodes", 1)
    assert (code, said["made"]) == (0, 1)  # By a worker that makes whatever it is asked for.


@pytest.mark.physics
def test_a_room_without_what_is_asked_for_is_a_failure_and_no_mistake_of_the_program(folder: Path) -> None:
    unit = DemoUnit(Origin(None, "put the banana into the refrigerator", "t1"), 12000)
    store = EpisodeStore(folder)
    found = run_unit(store, unit, outcome_version())
    assert (found["ended"], found["kind"]) == ("failed", "not-planned")
    assert [episode.meta["ended"] for episode in store.episodes()] == ["failed"]


@pytest.mark.physics
def test_a_scene_that_was_changed_meanwhile_is_not_taken_for_what_it_was(folder: Path, tmp_path: Path) -> None:
    scene = tmp_path / "room.json"
    scene.write_text(KITCHEN.read_text())
    (series,) = series_of({"episodes": 1, "sources": [{"query": "open the refrigerator", "scene": str(scene)}]})
    scene.write_text(json.dumps({**json.loads(KITCHEN.read_text()), "robot": {"position": [-0.4, 0, 0]}}))
    with pytest.raises(HandoverRefused, match="is not what it was when its episodes were asked for"):
        run_unit(EpisodeStore(folder), series.first, outcome_version())
    assert not list(folder.glob("units/*"))


@pytest.mark.slow
def test_a_run_that_made_nothing_fails(run_generate: Generate) -> None:
    code, said = run_generate("T1", "--seed", 3, "--episodes", 2)
    assert code == 1 and not said["ok"] and said["exit_code"] == 1
    assert run_generate("T1", "--seed", 3, "--episodes", 2)[0] == 1  # However often it is looked at.
    assert run_generate("T1", "--seed", 2, "--episodes", 2)[0] == 0
    assert run_generate("T1", "--seed", 2, "--episodes", 2)[0] == 0


@pytest.mark.parametrize(("endings", "code"), [([], 0), (["slipped"], 1), (["slipped", None], 0)])
def test_a_run_fails_where_nothing_of_it_succeeded(folder: Path, endings: list[str | None], code: int) -> None:
    tally = Tally()
    for kind in endings:
        tally.note("succeeded" if kind is None else "failed", kind)
    assert command.finished(EpisodeStore(folder), tally, interrupted=False, as_json=True) == code


ALIKE = "nothing will vary but the planner's choices"


@pytest.mark.parametrize(
    ("changes", "words", "told"),
    [
        ({"variation": {}}, [], True),
        ({"variation": {"objects": {"refrigerator_0": {"dx_m": [0.1, 0.1]}}}}, [], True),
        ({"variation": {}}, ["--vary", "surfaces"], True),
        ({}, [], False),
        ({"variation": {}}, ["--vary", "physics"], False),
        ({"variation": {}}, ["--noise-m", "0.005"], False),
        ({"variation": {}}, ["--episodes", "1"], False),
    ],
)
def test_it_says_when_all_episodes_will_start_alike(
    changes: dict[str, Any],
    words: list[str],
    told: bool,
    folder: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr("executor.data.generation.WORKER", INVENTED)
    scene = tmp_path / "room.json"
    scene.write_text(json.dumps({**json.loads(KITCHEN.read_text()), **changes}))
    asked = ["generate", "open the refrigerator", "--scene", str(scene), "--episodes", "2", "--out", str(folder)]
    assert app.run([*asked, "--workers", "1", *words]) == 0
    printed = " ".join(capsys.readouterr().err.split())
    assert (ALIKE in printed) == told
    if told:
        assert printed.index(ALIKE) < printed.index("succeeded")
        assert ("in pictures only" in printed) == bool(words)


@pytest.mark.physics
def test_a_worker_makes_nothing_for_a_program_that_it_does_not_run(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("executor.campaign.versions.outcome_version", lambda: VERSION)
    assert app.run(["generate", "T1", "--episodes", "2", "--out", str(folder), "--workers", "1"]) == 1
    said = " ".join(capsys.readouterr().err.split())
    assert f"the request is for version '{VERSION}'" in said and "start the same command again" in said
    store = EpisodeStore.open(folder)
    assert not list(store.episodes())
    # So does whoever hands a unit over in another way, such as to another machine.
    with pytest.raises(HandoverRefused):
        run_unit(store, DemoUnit(Origin("T1"), 0), VERSION)
    assert not list(folder.glob("units/*"))


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ([], "is missing"),
        (["T9"], "a sentence and --scene"),
        (["T1", "--scene", "kitchen_t1"], "none with families"),
        (["put the glass into the refrigerator"], "a sentence and --scene"),
        (["open the fridge", "--scene", "kitchen_t9"], "there is no scene 'kitchen_t9'"),
        (["T5", "--flows", "paper"], "the paper prints no flows for T5"),
        (["T1", "--views", "head", "head"], "a view is named twice"),
        (["T1", "--size", "127", "128"], "multiple of 2"),
        (["T1", "--rate-hz", "0"], "from 1 up"),
        (["T1", "--shard", "3/2"], "a part of a whole"),
        (["T1", "--limit-h", "0"], "a number above 0"),
        (["T1", "--episodes", "0"], "--episodes 0"),
        (["nothing.yaml"], "cannot be read"),
    ],
)
def test_wrong_words_are_one_clear_message(
    words: list[str], said: str, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert app.run(["generate", *words, "--out", str(folder)]) == 2
    printed = " ".join(capsys.readouterr().err.split())
    assert said in printed and "Traceback" not in printed
    assert not folder.exists()


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("sources: [", "line 1"),
        ("{}", "sources"),
        ("sources: []", "sources"),
        ("sources:\n  - families: [T7]\n", "sources[0].families[0]"),
        ("sources:\n  - query: open the fridge\n", "expected families, or a query and a scene"),
        ("sources:\n  - families: [T1]\n    episods: 3\n", "episods"),
        ("episodes: many\nsources:\n  - families: [T1]\n", "episodes"),
        ("!!python/object/apply:os.system ['true']", "is not YAML"),
    ],
)
def test_a_wrong_plan_says_where(text: str, said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    plan = tmp_path / "plan.yaml"
    plan.write_text(text)
    assert app.run(["generate", str(plan), "--out", str(tmp_path / "d")]) == 2
    assert said in " ".join(capsys.readouterr().err.split())


@pytest.mark.parametrize("signal_number", [signal.SIGINT, signal.SIGKILL])
@pytest.mark.slow
def test_however_it_ends_what_was_made_is_whole(folder: Path, signal_number: int) -> None:
    code = (
        f"import executor.data.generation as g; g.WORKER = '{INVENTED}'\n"
        "from executor.cli import app\n"
        f"app.main(['generate', 'T1', '--seed', '7', '--episodes', '4', '--workers', '1', '--out', '{folder}'])"
    )
    process = subprocess.Popen([sys.executable, "-c", code], env=environment(), start_new_session=True)
    # Seed 9 sleeps: 7 and 8 are done then. How long a busy machine takes to start is no matter.
    while len(list(folder.glob("units/T1*"))) < 2 and process.poll() is None:
        time.sleep(0.05)
    os.kill(process.pid, signal_number)
    ended = process.wait(timeout=SLOW_S)
    assert ended == (130 if signal_number == signal.SIGINT else -signal.SIGKILL)
    store = EpisodeStore.open(folder)
    assert [episode.meta["unit"]["seed"] for episode in store.episodes()] == [7, 8]
    assert all(
        episode.arrays["time_s"].shape == (seed,) for episode, seed in zip(store.episodes(), (7, 8), strict=True)
    )
