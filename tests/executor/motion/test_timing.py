"""Timed paths keep the speed limits and end at rest at their end."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from executor.primitives.control import SPEED_LIMITS, time_path

waypoint = st.lists(st.floats(-2.0, 2.0), min_size=10, max_size=10)


@given(st.lists(waypoint, min_size=2, max_size=5), st.sampled_from([0.3, 1.0]))
def test_speed_limits_hold_and_the_end_is_reached(waypoints: list[list[float]], speed: float) -> None:
    path, dt_s = np.array(waypoints), 1 / 250
    positions, velocities = time_path(path, dt_s, speed)
    if len(positions) == 0:
        assert np.abs(np.diff(path, axis=0)).max() < 1e-5
        return
    np.testing.assert_allclose(positions[-1], path[-1], atol=1e-9)
    assert (np.abs(velocities) <= SPEED_LIMITS * speed * 1.001).all()
    np.testing.assert_allclose(positions[0] + np.sum(velocities[1:], axis=0) * dt_s, positions[-1], atol=1e-6)


def test_a_path_that_goes_nowhere_takes_no_time() -> None:
    positions, velocities = time_path(np.zeros((3, 10)), 1 / 250)
    assert positions.shape == velocities.shape == (0, 10)


def test_motion_starts_and_stops_gently() -> None:
    path = np.zeros((2, 10))
    path[1, 3] = 1.0
    _, velocities = time_path(path, 1 / 250)
    assert abs(velocities[0, 3]) < 0.05
    assert abs(velocities[-1, 3]) < 0.05
    assert np.abs(velocities).max() > 1.0
