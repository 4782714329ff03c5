"""Stored episodes done again: the same states to the last bit, from what the robot was told alone."""

from __future__ import annotations

import numpy as np
import pytest

import oag
from executor.data import samples
from executor.data.store import EpisodeStore
from executor.records import FailureKind
from executor.rollouts.recording import repeat
from executor.rollouts.rollout import RunConditions, rollout
from executor.sim.engine import Physics

pytestmark = pytest.mark.physics


@pytest.mark.slow
def test_commands_give_the_same_states_again(made_store: EpisodeStore) -> None:
    episodes = list(made_store.demonstrations())
    assert len(episodes) == 2
    for episode in episodes:
        told = samples.commands(episode.arrays)
        again = repeat(episode.task, episode.scene, told, episode.meta["record_hz"])
        assert again.state_hash == episode.meta["state_hash"]
        assert all(reading.satisfied for reading in again.goal_readings)
        assert np.array_equal(again.trajectory.robot_qpos, episode.arrays["robot_qpos"])
        other = repeat(episode.task, episode.scene, [told[0][:3]], episode.meta["record_hz"])
        assert other.state_hash != again.state_hash


def test_what_is_stored_says_what_was_done(made_store: EpisodeStore) -> None:
    for episode in made_store.demonstrations():
        arrays, meta = episode.arrays, episode.meta
        assert len(arrays["time_s"]) == meta["samples"] == len(arrays["packed_states"])
        assert arrays["object_poses"].shape[1:] == (len(meta["object_ids"]), 7)
        assert oag.compose(episode.task, scene=episode.scene).verify() and meta["verdict"] == "PROVED"
        for index, subtask in enumerate(meta["subtasks"]):
            first, end = subtask["span"]
            assert np.all(arrays["subtask"][first:end] == index)
            for number, step in enumerate(subtask["steps"]):
                if step["span"] is not None:
                    assert np.all(arrays["step"][slice(*step["span"])] == number)


def test_a_motion_that_was_ended_early_is_done_again_as_it_was(made_store: EpisodeStore) -> None:
    # A weak hand loses the handle: the motion ends early, stops, and is settled.
    weak, (episode, *_) = Physics(grip_force=0.1), made_store.demonstrations()
    done = rollout(
        oag.compose(episode.task, scene=episode.scene),
        episode.scene,
        62990,
        vary=False,
        conditions=RunConditions(physics=weak),
    )
    assert done.failure is not None and done.failure.kind is FailureKind.SLIPPED
    told = [record.commands for record in done.subtasks]
    assert repeat(done.task, done.scene, told, done.record_hz, physics=weak).state_hash == done.state_hash


@pytest.mark.slow
def test_a_rollout_keeps_what_the_robot_was_told(made_store: EpisodeStore) -> None:
    episode = next(made_store.demonstrations())
    done = rollout(oag.compose(episode.task, scene=episode.scene), episode.scene, 62990, vary=False)
    told = [record.commands for record in done.subtasks]
    steps = sum(command.followed + command.held for given in told for command in given)
    assert steps <= round(done.simulated_s / 0.004) and all(len(given) > 3 for given in told)
    assert repeat(done.task, done.scene, told, done.record_hz).state_hash == done.state_hash
