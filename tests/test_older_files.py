"""Files that version 0.1.0 wrote are read, checked and continued."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

import oag
from executor.cli import app
from executor.data.store import EpisodeStore
from executor.envs.demonstration_replay import replay_episode
from oag.primitives.table import library_sha

WRITTEN = Path(__file__).parent / "data" / "written_by_0_1_0"


def test_a_certificate_is_confirmed() -> None:
    data = json.loads((WRITTEN / "certificate.json").read_text(encoding="utf-8"))
    assert oag.recheck(data).ok


def test_a_certificate_that_is_wrong_for_another_reason_is_refused_by_that_reason() -> None:
    data = json.loads((WRITTEN / "certificate.json").read_text(encoding="utf-8"))
    data["links"] = data["links"][:-1]
    result = oag.recheck(data)
    assert not result.ok and "0.1.0" in result.reason and "carries" not in result.reason
    data["library_sha"] = library_sha()
    assert result.reason.startswith(f"by the present table of primitives, {oag.recheck(data).reason}; ")


@pytest.mark.physics
def test_a_store_is_checked_and_exported(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("pyarrow")
    store = Path(shutil.copytree(WRITTEN / "store", tmp_path / "store"))
    assert app.run(["dataset", "check", str(store)]) == 0
    (episode,) = EpisodeStore(store).episodes()
    assert len(episode.arrays["robot_qpos"]) == episode.meta["samples"]
    assert app.run(["dataset", "export", str(store), "--out", str(tmp_path / "set")]) == 0
    assert json.loads((tmp_path / "set" / "meta" / "info.json").read_text())["total_episodes"] == 1
    capsys.readouterr()


@pytest.mark.physics
def test_corrections_of_a_policy_are_replayed_and_learned_from() -> None:
    """No command makes them any more; what there is of them stays a demonstration from a start of its own."""
    pytest.importorskip("torch")
    from executor.learn.demonstrations import read_demonstrations
    from executor.learn.settings import read_settings

    store = EpisodeStore(WRITTEN / "corrections")
    (episode,) = store.episodes()
    assert episode.start is not None and episode.meta["takeover"]["because"] == "anew"
    assert replay_episode(episode, "exact").good and replay_episode(episode, "joint_target").good
    settings = read_settings(str(WRITTEN / "small.toml"))
    both = read_demonstrations([WRITTEN / "store", store.path], settings)
    assert both.takeovers == 1 and len(both.names) == 2


@pytest.mark.physics
@pytest.mark.slow
def test_a_policy_is_evaluated_and_its_training_is_known(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("torch")
    policy = Path(shutil.copytree(WRITTEN / "policy", tmp_path / "policy"))
    about = json.loads((policy / "policy.json").read_text(encoding="utf-8"))
    (policy / "policy.json").write_text(json.dumps({**about, "of_another_version": [1]}), encoding="utf-8")
    assert app.run(["evaluate", str(policy), "--task", "T5", "--episodes", "1", "--seed", "95500", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["ok"]
    words = ["train", str(WRITTEN / "small.toml"), "--data", str(WRITTEN / "store"), "--out", str(policy)]
    assert app.run([*words, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["ok"]
