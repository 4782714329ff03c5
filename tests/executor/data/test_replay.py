"""Stored demonstrations come out again: the same states by the command log, success through the environment."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from executor.cli.app import run
from executor.data import samples
from executor.data.store import SAMPLES, EpisodeStore
from executor.envs.demonstration_replay import replay_actions
from executor.envs.hand_control import Elbow, HandFollower
from executor.sim.robot.actions import hand_actions
from oag.model.robots import PAPER_ROBOT
from tests.executor.helpers import MakeWorld

pytestmark = pytest.mark.physics


@pytest.mark.parametrize(
    "options",
    [
        [],
        ["--through", "env"],
        pytest.param(["--through", "env", "--actions", "paper"], marks=pytest.mark.slow),
        pytest.param(["--workers", "2"], marks=pytest.mark.slow),
    ],
)
def test_demonstrations_come_out_again(
    made_store: EpisodeStore, options: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["replay", str(made_store.path), "--json", *options]) == 0
    told = json.loads(capsys.readouterr().out)
    assert (told["replayed"], told["good"], told["failed"]) == (2, 2, [])
    assert told["interval"][0] < 1.0 == told["interval"][1]


def test_other_commands_are_seen(made_store: EpisodeStore, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    store = EpisodeStore(Path(shutil.copytree(made_store.path, tmp_path / "s")))
    episode = next(store.demonstrations())
    arrays = dict(episode.arrays)
    arrays["command_path"] = arrays["command_path"] + 1e-4
    (episode.path / SAMPLES).write_bytes(samples.packed(arrays))
    assert run(["replay", str(store.path), "--episodes", "1"]) == 1
    out = capsys.readouterr()
    assert "0 of 1 gave the same states" in out.out and episode.name in out.err


@pytest.mark.slow
def test_what_a_process_cannot_read_is_one_clear_message(
    made_store: EpisodeStore, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    store = EpisodeStore(Path(shutil.copytree(made_store.path, tmp_path / "s")))
    episode = next(store.demonstrations())
    (episode.path / SAMPLES).write_bytes(b"none")
    assert run(["replay", str(store.path), "--workers", "2"]) == 2
    assert str(episode.path / SAMPLES) in capsys.readouterr().err


def test_a_robot_that_does_nothing_does_not_succeed(made_store: EpisodeStore) -> None:
    episode = next(made_store.demonstrations())
    still = np.repeat(episode.arrays["robot_target"][:1], 5, axis=0)
    found = replay_actions(episode.name, episode.task, episode.scene, still, 10.0, "joint_target")
    assert not found.good and found.progress < 1.0


def test_hand_actions_lead_the_hand_where_joint_targets_do(made_store: EpisodeStore, make_world: MakeWorld) -> None:
    for episode in made_store.demonstrations():
        targets = episode.arrays["robot_target"].astype(float)
        reached, follower = targets[0], HandFollower(PAPER_ROBOT, targets[0], 0.1, Elbow(make_world(episode.scene)))
        for action in hand_actions(PAPER_ROBOT, targets[:-1], targets[1:]):
            reached = follower.joint_target(reached, action)
        # From where the demonstration ends, what is left to do is nothing.
        left = hand_actions(PAPER_ROBOT, reached[None], targets[-1:])[0]
        assert np.abs(left[:6]).max() < 2e-3 and np.abs(left[7:]).max() < 1e-6


def test_a_folder_without_demonstrations_is_refused(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    EpisodeStore(folder).add_requests([])
    assert run(["replay", str(folder)]) == 2
    assert "nothing can be done again" in capsys.readouterr().err
