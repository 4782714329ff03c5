"""Noise in what the drives are told: how large, when, and the same again."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from executor.data.generation import series_of
from executor.data.units import DemoUnit
from executor.data.work import make_unit, noise_of, physics_of
from executor.records import Trajectory
from executor.rollouts.recording import repeat
from executor.skills.trajectories import MOST, RAD_PER_M, CommandNoise, speed_limits
from oag.model.robots import PAPER_ROBOT

DT_S = 0.004
FAST = speed_limits(PAPER_ROBOT)
NOISE = CommandNoise(0.01, 5)


def _offsets(noise: CommandNoise, count: int, *, subtask: int = 0, gripping: bool = False) -> np.ndarray:
    stream = noise.of_subtask(PAPER_ROBOT, subtask, DT_S)
    assert stream is not None
    return np.array([stream.offset(FAST, 9.0, gripping=gripping) for _ in range(count)])


def test_noise_has_the_deviation_that_was_asked_for_and_an_end() -> None:
    found = _offsets(NOISE, 60_000)
    expected = 0.01 * np.array([1.0, 1.0] + [RAD_PER_M] * 8)
    assert found.std(axis=0) == pytest.approx(expected, rel=0.2)
    assert (np.abs(found) <= MOST * expected + 1e-12).all()


def test_noise_is_slow_enough_to_be_followed() -> None:
    found = _offsets(NOISE, 5_000)[:, 0]
    assert np.abs(np.diff(found)).max() / DT_S < 0.3 * FAST[0]


def test_it_follows_from_seed_and_subtask() -> None:
    assert np.array_equal(_offsets(NOISE, 50), _offsets(NOISE, 50))
    assert not np.array_equal(_offsets(NOISE, 50), _offsets(NOISE, 50, subtask=1))
    assert not np.array_equal(_offsets(NOISE, 50), _offsets(replace(NOISE, seed=6), 50))


def test_a_robot_that_rests_or_is_about_to_is_told_the_truth_and_one_that_holds_something_nearly() -> None:
    stream = NOISE.of_subtask(PAPER_ROBOT, 0, DT_S)
    assert stream is not None
    assert not stream.offset(np.zeros(10), 9.0, gripping=False).any()
    assert not stream.offset(FAST, 0.0, gripping=False).any()
    assert _offsets(NOISE, 50, gripping=True) == pytest.approx(_offsets(NOISE, 50) / 4)


def test_without_a_deviation_there_is_none() -> None:
    assert CommandNoise(0.0, 5).of_subtask(PAPER_ROBOT, 0, DT_S) is None


def _unit(**wishes: object) -> DemoUnit:
    (series,) = series_of({"seed": 62100, "episodes": 1, **wishes, "sources": [{"families": ["T5"]}]})
    return next(series.units())


def test_axes_do_not_disturb_each_other() -> None:
    both, one = _unit(vary=["physics"], noise_m=0.01), _unit(vary=["physics"])
    assert physics_of(both) == physics_of(one)
    assert noise_of(both).seed == noise_of(_unit(noise_m=0.02)).seed


@pytest.mark.slow
@pytest.mark.physics
def test_an_episode_with_noise_and_other_physics_is_repeated_to_the_last_bit_and_records_clean_targets() -> None:
    unit = _unit(vary=["physics"], noise_m=0.01)
    done = make_unit(unit).rollout
    commands = [record.commands for record in done.subtasks]
    again = repeat(done.task, done.scene, commands, done.record_hz, physics=physics_of(unit), noise=noise_of(unit))
    assert again.state_hash == done.state_hash
    quiet = repeat(done.task, done.scene, commands, done.record_hz, physics=physics_of(unit))
    assert quiet.state_hash != done.state_hash
    assert _beside_m(done.trajectory, moving=True).max() > 3 * _beside_m(quiet.trajectory, moving=True).max()
    assert np.median(_beside_m(done.trajectory, moving=False)) < 0.002


def _beside_m(motion: Trajectory, *, moving: bool) -> NDArray[np.float64]:
    """How far the base is from where it was told to be, in the samples in which it moves or stands."""
    speed = np.abs(motion.robot_qvel[:, :3]).max(axis=1)
    off = np.abs(motion.robot_target[:, :2] - motion.robot_qpos[:, :2]).max(axis=1)
    return np.asarray(off[speed > 0.3 if moving else speed < 1e-3], dtype=float)
