"""Timed paths keep the limits of speed and acceleration, go round corners slowly, and end at rest at their end."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from executor.skills.trajectories import (
    BLEND_S,
    STOPS,
    acceleration_limits,
    corner_steps,
    speed_limits,
    stop_path,
    time_path,
)
from oag.model.robots import PAPER_ROBOT

DT_S = 1 / 250
CUT_M = 0.002
SPEED_LIMITS, ACCELERATION_LIMITS = speed_limits(PAPER_ROBOT), acceleration_limits(PAPER_ROBOT)
STOP_LIMITS, CORNER_STEPS = STOPS * ACCELERATION_LIMITS, corner_steps(PAPER_ROBOT)
waypoint = st.lists(st.floats(-2.0, 2.0), min_size=10, max_size=10)


def accelerations(velocities: np.ndarray) -> np.ndarray:
    """Return (T + 1, 10), the start and the stop among them."""
    still = np.zeros((1, velocities.shape[1]))
    return np.diff(np.concatenate([still, velocities, still]), axis=0) / DT_S


@given(st.lists(waypoint, min_size=2, max_size=5), st.sampled_from([0.3, 1.0]))
def test_limits_hold_and_the_end_is_reached(waypoints: list[list[float]], speed: float) -> None:
    path = np.array(waypoints)
    positions, velocities = time_path(PAPER_ROBOT, path, DT_S, speed)
    if len(positions) == 0:
        assert np.abs(np.diff(path, axis=0)).max() < 1e-5
        return
    np.testing.assert_allclose(positions[-1], path[-1], atol=1e-9)
    assert (np.abs(velocities) <= SPEED_LIMITS * speed * 1.001).all()
    assert (np.abs(accelerations(velocities)) <= ACCELERATION_LIMITS * 1.01).all()
    np.testing.assert_allclose(positions[0] + np.sum(velocities[1:], axis=0) * DT_S, positions[-1], atol=1e-6)


def test_a_path_that_goes_nowhere_takes_no_time() -> None:
    positions, velocities = time_path(PAPER_ROBOT, np.zeros((3, 10)), DT_S)
    assert positions.shape == velocities.shape == (0, 10)


def test_motion_starts_and_stops_gently() -> None:
    path = np.zeros((2, 10))
    path[1, 3] = 1.0
    _, velocities = time_path(PAPER_ROBOT, path, DT_S)
    assert abs(velocities[0, 3]) < 0.05
    assert abs(velocities[-1, 3]) < 0.05
    assert np.abs(velocities).max() > 1.0


def test_a_drive_slows_down_before_a_corner_and_cuts_it_by_millimetres() -> None:
    path = np.zeros((4, 10))
    path[1:, 0] = 1.0
    path[2:, 1] = 1.0
    path[3, 2] = np.pi / 2
    positions, velocities = time_path(PAPER_ROBOT, path, DT_S)
    corner = int(np.argmin(np.linalg.norm(positions - path[1], axis=1)))
    off_m = float(np.linalg.norm(positions[corner] - path[1]))
    assert 0.0 < off_m < CUT_M
    assert np.abs(velocities[corner, :2]).max() <= CORNER_STEPS[0]
    # Within the time of the blend the step is a ramp; nowhere is it a jump.
    assert np.abs(np.diff(velocities, axis=0)).max(axis=0)[:2] == pytest.approx(0.01, abs=0.01)
    assert velocities[:corner, 0].max() == pytest.approx(SPEED_LIMITS[0], rel=1e-6)
    # Between corners it is on the path.
    straight = positions[: corner - round(BLEND_S / DT_S)]
    np.testing.assert_allclose(straight[:, 1:], 0.0, atol=1e-9)


def test_many_small_corners_add_up_to_no_more() -> None:
    angles = np.linspace(0.0, np.pi, 200)
    path = np.zeros((200, 10))
    path[:, 0], path[:, 1], path[:, 2] = 0.05 * np.cos(angles), 0.05 * np.sin(angles), angles
    _, velocities = time_path(PAPER_ROBOT, path, DT_S)
    assert (np.abs(accelerations(velocities)) <= ACCELERATION_LIMITS * 1.01).all()


@given(waypoint, st.lists(st.floats(-1.0, 1.0), min_size=10, max_size=10))
@example([0.0] * 10, [0.0] * 9 + [0.03125])  # Less than a tick.
def test_a_stop_slows_down_evenly_within_its_limits(position: list[float], share: list[float]) -> None:
    start, velocity = np.array(position), np.array(share) * SPEED_LIMITS
    positions, velocities = stop_path(PAPER_ROBOT, start, velocity, DT_S)
    if not len(positions):
        assert np.abs(velocity / STOP_LIMITS).max() < 1e-9
        return
    np.testing.assert_allclose(velocities[-1], 0.0, atol=1e-9)
    changes = np.diff(np.concatenate([velocity[None], velocities]), axis=0) / DT_S
    assert (np.abs(changes) <= STOP_LIMITS * 1.001).all()
    along = np.diff(np.concatenate([start[None], positions]), axis=0)
    assert (along * np.sign(velocity) >= -1e-12).all()
    assert len(positions) * DT_S <= 0.1 + DT_S, "nothing needs longer than a tenth of a second"


def test_a_robot_that_stands_is_stopped_already() -> None:
    positions, velocities = stop_path(PAPER_ROBOT, np.ones(10), np.zeros(10), DT_S)
    assert positions.shape == velocities.shape == (0, 10)
