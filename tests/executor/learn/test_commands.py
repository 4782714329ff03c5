"""`scene2demo train` and `evaluate` from end to end, and what they refuse."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from executor.campaign.versions import EVALUATION_VERSION, outcome_version
from executor.cli.app import run
from executor.cli.commands.evaluate import Options, command_with_videos, kind_of
from executor.cli.errors import BadOption
from executor.data.store import EpisodeStore
from executor.data.units import Origin, Variation
from executor.learn.acting import TrainedPolicy
from executor.learn.demonstrations import EpisodeKind
from executor.learn.evaluation import FAILURES, EpisodeOutcome, environment_for
from executor.learn.evaluation_units import _weights_key
from executor.learn.settings import PolicySettings, SettingsError, read_settings

pytestmark = pytest.mark.physics

TINY = """
[sees]
phase = true
[acts]
chunk = 4
execute = 2
[network]
width = 16
layers = 1
[training]
steps = 5
batch = 8
keep_every = 2
"""


def last_json(capsys: pytest.CaptureFixture[str]) -> dict[str, object]:
    """Return what was printed last."""
    found: dict[str, object] = json.loads(capsys.readouterr().out)
    return found


@pytest.mark.slow
def test_what_shows_the_same_counts_once_in_training(
    picked: EpisodeStore, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The copies say that other numbers asked for them, as one request had two ids once."""
    settings, store = tmp_path / "tiny.toml", tmp_path / "s"
    settings.write_text(TINY)
    shutil.copytree(picked.path, store)
    first, *_ = [episode.name for episode in picked.episodes()]
    again = store / "units" / f"{first[:-8]}0badc0de"
    shutil.copytree(store / "units" / first, again)
    meta = json.loads((again / "unit.json").read_text())
    (again / "unit.json").write_text(json.dumps({**meta, "id": "0badc0de" * 2, "query": "take the glass"}))
    train = ["train", str(settings), "--data", str(store), "--threads", "1"]
    assert run([*train, "--out", str(tmp_path / "p"), "--json"]) == 0
    told = last_json(capsys)
    assert told["demonstrations"] == 2
    ((repeated, counts),) = told["repeats"]  # type: ignore[misc, attr-defined]
    assert {"0badc0de" in repeated, "0badc0de" in counts} == {True, False}
    assert run([*train, "--out", str(tmp_path / "q"), "--episodes", "2"]) == 0
    assert f"1 demonstration left out: {repeated} repeats {counts}" in " ".join(capsys.readouterr().err.split())
    assert json.loads((tmp_path / "q" / "policy.json").read_text())["demonstrations"] == 2


def test_one_number_is_one_setting_however_it_is_typed(tmp_path: Path) -> None:
    def settings(text: str) -> PolicySettings:
        (tmp_path / "s.toml").write_text(f"{TINY}\n{text}")
        return read_settings(str(tmp_path / "s.toml"))

    texts = (
        "noise = 0\njitter_m = -0.0\nlearning_rate = 1",
        "noise = 0.0\nlearning_rate = 1.0",
        "noise = 0e0\nlearning_rate = 1e0",
    )
    assert len({json.dumps(settings(text).model_dump(mode="json")) for text in texts}) == 1
    with pytest.raises(SettingsError):
        settings("noise = false")


@pytest.mark.slow
def test_train_goes_on_and_evaluate_counts(
    picked: EpisodeStore, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    settings, out = tmp_path / "tiny.toml", tmp_path / "p"
    settings.write_text(TINY)
    train = ["train", str(settings), "--data", str(picked.path), "--out", str(out), "--threads", "1", "--json"]
    train += ["--keep-every", "3"]
    assert run(train) == 0
    told = last_json(capsys)
    assert told["steps"] == 5 and told["demonstrations"] == 2
    assert sorted(path.stem for path in (out / "steps").iterdir()) == ["000003"]
    before = (out / "weights.safetensors").read_bytes()
    assert run(train) == 0  # All is done already.
    capsys.readouterr()
    assert (out / "weights.safetensors").read_bytes() == before
    assert run([*train, "--seed", "1"]) == 2
    assert "--force begins again" in str(last_json(capsys)["error"])

    monkeypatch.setattr("executor.learn.evaluation.MOST_S", 0.5)
    results = tmp_path / "r"
    evaluate = ["evaluate", str(out), "--episodes", "2", "--seed", "62985", "--json"]
    assert run([*evaluate, "--out", str(results)]) == 0
    found = last_json(capsys)
    (policy,) = found["policies"].values()  # type: ignore[attr-defined]
    assert policy["success_once"]["trials"] == 2 and policy["success_once"]["successes"] == 0
    assert [episode["seed"] for episode in policy["episodes"]] == [62985, 62986]
    assert found["kind"]["variation"]["target"] is True  # type: ignore[index]
    assert json.loads((results / "evaluation.json").read_text())["policies"] == found["policies"]
    assert found["version"] == outcome_version(EVALUATION_VERSION)
    assert run(["evaluate", str(out), "--episodes", "3", "--seed", "62979", "--json"]) == 2
    assert "which are from 62980 to 62981" in str(last_json(capsys)["error"])
    asked = ["evaluate", str(out), "--task", "T1", "--episodes", "1", "--seed", "62981", "--json"]
    assert run(asked) == 2
    assert "whatever the task, the same seed may draw the same room" in str(last_json(capsys)["error"])
    assert run([*evaluate, "--execute", "5"]) == 2
    assert "--execute 5: expected 1 to 4" in str(last_json(capsys)["error"])
    assert run([*evaluate, "--videos"]) == 2
    assert "--out with it" in str(last_json(capsys)["error"])

    # The same episodes as units of a campaign, in two parts and by a whole run that finds them done.
    monkeypatch.setattr("executor.learn.evaluation_units.WORKER", "tests.executor.learn.short_worker")
    shared = [*evaluate, "--out", str(tmp_path / "shared")]
    assert run([*shared, "--shard", "1/2"]) == 0
    assert len(list((tmp_path / "shared" / "units").iterdir())) == 1
    capsys.readouterr()
    assert run(["status", str(tmp_path / "shared"), "--json"]) == 0
    assert (told := last_json(capsys))["done"] == 1 and told["asked"] == 2 and told["kind"] == "evaluation"
    assert run([*shared, "--workers", "2"]) == 0
    assert last_json(capsys)["policies"] == found["policies"]
    assert run([*evaluate, "--workers", "2"]) == 2
    capsys.readouterr()
    # Where no episode comes to an end, nothing is measured.
    monkeypatch.setattr("executor.learn.evaluation_units.WORKER", "tests.executor.campaign.stub_worker")
    assert run([*evaluate, "--out", str(tmp_path / "none"), "--workers", "2"]) == 1
    told = last_json(capsys)
    assert told["ok"] is False and "0 of 2 did not run" in str(told["problem"])


def test_an_evaluation_is_of_the_weights_that_act(tmp_path: Path) -> None:
    def keys() -> list[str]:
        training = SimpleNamespace(training=SimpleNamespace(steps=5))
        actors: list[Any] = [
            SimpleNamespace(folder=str(tmp_path), step=step, record=SimpleNamespace(settings=training))
            for step in (3, 5)
        ]
        return [_weights_key(actor) for actor in actors]

    (tmp_path / "steps").mkdir()
    for name in ("policy.json", "weights.safetensors", "steps/000003.safetensors"):
        (tmp_path / name).write_text("a")
    before = keys()
    for name in ("evaluation.json", "evaluation-units.json", "resume.safetensors"):
        (tmp_path / name).write_text("a")
    assert keys() == before
    (tmp_path / "steps" / "000003.safetensors").write_text("b")
    early, last = keys()
    assert early != before[0] and last == before[1]
    (tmp_path / "weights.safetensors").write_text("b")
    assert keys()[0] == early and keys()[1] != last


@pytest.mark.slow
def test_results_are_seen_even_if_they_cannot_be_written(
    picked: EpisodeStore, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    settings, out, results = tmp_path / "tiny.toml", tmp_path / "p", tmp_path / "r"
    settings.write_text(TINY)
    assert run(["train", str(settings), "--data", str(picked.path), "--out", str(out), "--threads", "1"]) == 0
    monkeypatch.setattr("executor.learn.evaluation.MOST_S", 0.5)
    evaluate = ["evaluate", str(out), "--episodes", "1", "--seed", "62985"]

    def full(path: Path, _: object) -> None:
        raise OSError(28, "No space left on device", str(path))

    with monkeypatch.context() as patched:
        patched.setattr("executor.cli.commands.evaluate.write_json", full)
        capsys.readouterr()
        assert run([*evaluate, "--out", str(results)]) == 3
    told = capsys.readouterr()
    assert "0 of 1" in told.out and "No space left on device" in told.err

    def invented(
        actors: list[TrainedPolicy], kind: object, seeds: range, told: Callable[..., None], **_: object
    ) -> object:
        ends = [
            EpisodeOutcome(seed, good, good, "" if good else FAILURES[0], 1.0, {})
            for seed, good in zip(seeds, (True, False), strict=True)
        ]
        for end in ends:
            told(actors[0], end, None)
        return {actors[0].name: ends}

    with monkeypatch.context() as patched:
        patched.setattr("executor.learn.evaluation.evaluate", invented)
        assert run(["evaluate", str(out), "--episodes", "2", "--seed", "62985"]) == 0
    lines = capsys.readouterr().err.splitlines()
    assert [line.split("seed ")[1] for line in lines] == ["62985: succeeded", f"62986: {FAILURES[0]}"]

    def never(*_: object, **__: object) -> None:
        raise AssertionError("an episode began")

    monkeypatch.setattr("executor.learn.evaluation.evaluate", never)
    assert run([*evaluate, "--out", str(settings), "--json"]) == 2
    assert f"the output folder {settings} cannot be used: File exists" in str(last_json(capsys)["error"])
    assert run([*evaluate, "--out", str(settings / "r"), "--json"]) == 2
    assert "cannot be used: Not a directory" in str(last_json(capsys)["error"])


def test_what_cannot_be_trained_on_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["train", "state", "--data", str(tmp_path), "--out", str(tmp_path / "p"), "--json"]) == 2
    assert "is no store of episodes, nor a LeRobot data set" in str(last_json(capsys)["error"])
    assert run(["train", "stat", "--data", str(tmp_path), "--out", str(tmp_path / "p"), "--json"]) == 2
    assert "cloud, ensemble, paper, rooms, state" in str(last_json(capsys)["error"])
    assert run(["evaluate", str(tmp_path / "p"), "--json"]) == 2
    assert f"{tmp_path / 'p'}: No such file or directory" in str(last_json(capsys)["error"])
    (tmp_path / "p").mkdir()
    assert run(["evaluate", str(tmp_path / "p"), "--json"]) == 2
    assert "holds no policy" in str(last_json(capsys)["error"])


def test_demonstrations_of_several_kinds_want_a_family() -> None:
    kinds = tuple(EpisodeKind(Origin(family="T1"), Variation(surfaces=surfaces)) for surfaces in (False, True))
    with pytest.raises(BadOption, match="the demonstrations are of T1, varied in several ways"):
        kind_of(None, [SimpleNamespace(kinds=kinds)])  # type: ignore[list-item]
    other = EpisodeKind(Origin(family="T2"))
    with pytest.raises(BadOption, match="several things: T1, T2"):
        kind_of(None, [SimpleNamespace(kinds=(kinds[0], other))])  # type: ignore[list-item]


def test_the_next_command_runs_the_same_episodes() -> None:
    given = Options((Path("p"),), data=Path("d"), episodes=7, seed=9, steps=(1, 2), execute=3, workers=4)
    words = "scene2demo evaluate p --data d --episodes 7 --seed 9 --execute 3 --steps 1 2 --out FOLDER --videos"
    assert command_with_videos(given) == words


@pytest.mark.parametrize(("home", "pictures"), [(True, (64, 48)), (False, (64, 48)), (False, None)])
def test_policies_see_homes_where_their_training_data_show_them(
    monkeypatch: pytest.MonkeyPatch, home: bool, pictures: tuple[int, int] | None
) -> None:
    monkeypatch.setattr("executor.learn.evaluation.SceneEnvironment", lambda **given: given)
    record = SimpleNamespace(settings=PolicySettings(), rate_hz=10.0)
    policy = SimpleNamespace(record=record, picture_size=pictures, home=home)
    made: Any = environment_for(policy, EpisodeKind(Origin(family="T1")))  # type: ignore[arg-type]
    assert made["plain"] is not home and made.get("size") == pictures
