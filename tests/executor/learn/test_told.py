"""What data sets say of their demonstrations and robots is believed only where it is whole and fits together."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from executor.campaign.versions import outcome_version
from executor.cli.app import run
from executor.data.formats.export import write_set
from executor.data.formats.lerobot import LINES
from executor.data.formats.selection import NothingToExport
from executor.data.formats.store_reader import stream_of
from executor.data.generation import series_of
from executor.data.store import EpisodeStore, NotADataset
from executor.data.worker import run_unit
from executor.learn.action_chunks import hand_poses, to_hand_frame
from executor.learn.demonstrations import learned_from, read_demonstrations
from executor.learn.evaluation import environment_for
from executor.learn.policy_record import PolicyRecord
from oag.model.robots import FULL_SIZE
from tests.executor.learn.conftest import KITCHEN, PLAN, small
from tests.executor.learn.test_commands import last_json

pytestmark = pytest.mark.physics


@pytest.fixture(scope="module")
def full_size(tmp_path_factory: pytest.TempPathFactory) -> EpisodeStore:
    """Return a store with a demonstration of a scene whose own robot is of full size."""
    folder = tmp_path_factory.mktemp("full")
    scene = json.loads(KITCHEN.read_text())
    scene["robot"]["scale"] = FULL_SIZE.scale
    (folder / "kitchen.json").write_text(json.dumps(scene))
    sources = [{"query": "pick up the glass", "scene": str(folder / "kitchen.json")}]
    store, (series,) = EpisodeStore(folder / "s"), series_of({**PLAN, "episodes": 1, "sources": sources})
    store.add_requests([series.to_json()])
    run_unit(store, series.first, outcome_version())
    return store


def test_a_scenes_own_robot_of_full_size_is_what_is_learned_from_and_acted_with(full_size: EpisodeStore) -> None:
    data = read_demonstrations([full_size.path], small(acts={"hand": True}))
    record = PolicyRecord.of(small(acts={"hand": True}), 0, data)
    assert record.robot is FULL_SIZE and learned_from(full_size.path).kinds == data.kinds
    now, wanted = (hand_poses(rows, record.robot) for rows in (data.qpos, data.actions))
    moved_m, seen_m = now[:, :3, 3] - now[0, :3, 3], data.numbers[:, 8:11] - data.numbers[0, 8:11]
    assert np.abs(seen_m).max() > 0.2 and np.allclose(moved_m, seen_m, atol=1e-3)
    assert data.hands is not None and np.allclose(data.hands[:, 0], to_hand_frame(now, wanted), atol=1e-6)
    actor = type("Acts", (), {"record": record, "picture_size": None, "home": False})()
    env = environment_for(actor, record.kinds[0])  # type: ignore[arg-type]
    env.reset(seed=62985)
    assert env.episode.scene.robot.model is FULL_SIZE
    env.close()


def test_robots_of_two_scales_are_refused(picked: EpisodeStore, full_size: EpisodeStore) -> None:
    words = r"different robots \(.*: paper, .*: panda\); a policy has one robot"
    with pytest.raises(NothingToExport, match=words):
        read_demonstrations([picked.path, full_size.path], small())


def test_an_episode_counts_once(picked: EpisodeStore, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_set(stream_of(picked), "lerobot", tmp_path / "z")
    twice = [str(picked.path), str(tmp_path / "z")]
    assert run(["train", "state", "--data", *twice, "--out", str(tmp_path / "p"), "--json"]) == 2
    error = str(last_json(capsys)["error"])
    assert f"{tmp_path / 'z'} has the episode " in error and "name each store once" in error


def without(name: str) -> Callable[[dict[str, Any]], object]:
    """Return what takes a key away."""
    return lambda about: about.pop(name)


@pytest.mark.parametrize(
    "spoil, words",
    [
        (without("unit"), "it lacks 'unit'"),
        (without("id"), "it lacks 'id'"),
        (lambda about: about["unit"].update(seed="x"), r"unit\.seed: Input should be"),
        (lambda about: about.update(unit=3), "unit: "),
        (
            lambda about: about.update(kind="film"),
            "kind is 'film', expected 'demonstration', 'correction' or 'failure'",
        ),
        (lambda about: about.update(takeover={"why": "x"}), "it lacks 'subtask'"),
    ],
)
def test_what_an_export_says_of_an_episode_is_checked(
    picked: EpisodeStore, tmp_path: Path, spoil: Callable[[dict[str, Any]], object], words: str
) -> None:
    write_set(stream_of(picked), "lerobot", tmp_path / "z")
    path = tmp_path / "z" / LINES
    lines = [json.loads(line) for line in path.read_text().splitlines()]
    spoil(lines[1])
    path.write_text("".join(json.dumps(line) + "\n" for line in lines))
    for read in (learned_from, lambda folder: read_demonstrations([folder], small())):
        with pytest.raises(NotADataset, match=rf"z cannot be learned from: what it says of episode 1 .*: {words}"):
            read(tmp_path / "z")


def test_a_set_of_failures_alone_is_not_learned_from(picked: EpisodeStore, monkeypatch: pytest.MonkeyPatch) -> None:
    stream = stream_of(picked)
    failed = [replace(one, about={**one.about, "kind": "correction"}) for one in stream.episodes()]
    monkeypatch.setattr(
        "executor.learn.demonstrations.open_set", lambda *given: replace(stream, episodes=lambda: failed)
    )
    for read in (learned_from, lambda folder: read_demonstrations([folder], small())):
        with pytest.raises(NothingToExport, match="has no demonstrations"):
            read(picked.path)
    robotless = replace(stream, found=replace(stream.found, robot={}))
    monkeypatch.setattr("executor.learn.demonstrations.open_set", lambda *given: robotless)
    with pytest.raises(NotADataset, match=r"what it says of the robot .*: it lacks 'scale'"):
        read_demonstrations([picked.path], small())
