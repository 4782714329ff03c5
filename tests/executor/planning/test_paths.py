"""Elementary paths: dense enough, rigid about the pivot, along the heading."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from executor.planning.paths import (
    ARM_STEP_RAD,
    BASE_STEP_M,
    arc_about,
    base_move,
    base_turn,
    polyline,
    segment,
    spread_out,
)
from oag.model.robots import PAPER_ROBOT

small = st.floats(-2.0, 2.0)
configuration = st.lists(small, min_size=10, max_size=10).map(np.array)


@given(configuration, configuration)
def test_segments_are_dense_and_end_exactly(a: np.ndarray, b: np.ndarray) -> None:
    rows = np.vstack([a, segment(PAPER_ROBOT, a, b)])
    np.testing.assert_allclose(rows[-1], b, atol=1e-12)
    steps = np.abs(np.diff(rows, axis=0)).max(axis=0)
    assert steps[:2].max() <= BASE_STEP_M + 1e-9
    assert steps[3:].max() <= ARM_STEP_RAD + 1e-9


@given(st.integers(0, 400))
def test_indices_are_spread_out_and_complete(count: int) -> None:
    order = spread_out(count)
    assert sorted(order) == list(range(count))
    if count > 2:
        assert order[0] == count - 1
        assert abs(order[1] - (count - 1) / 2) <= count / 4 + 1


@given(configuration, st.tuples(small, small), st.floats(-2.0, 2.0))
def test_an_arc_keeps_the_robot_rigid_about_the_pivot(q: np.ndarray, pivot: tuple[float, float], angle: float) -> None:
    path = arc_about(q, np.array(pivot), angle, 12)
    radii = np.hypot(*(path[:, :2] - pivot).T)
    np.testing.assert_allclose(radii, radii[0], atol=1e-9)
    np.testing.assert_allclose(path[:, 3:], np.tile(q[3:], (13, 1)))
    assert abs(path[-1, 2] - q[2] - angle) < 1e-12


@given(configuration, st.floats(0.0, 2.0), st.floats(-3.0, 3.0))
def test_a_base_move_goes_along_the_heading_and_a_turn_stays(q: np.ndarray, distance_m: float, heading: float) -> None:
    move = base_move(q, distance_m, heading)
    np.testing.assert_allclose(
        move[1, :2] - q[:2], distance_m * np.array([np.cos(heading), np.sin(heading)]), atol=1e-12
    )
    turn = base_turn(q, heading)
    np.testing.assert_allclose(np.delete(turn[1] - q, 2), np.zeros(9))
    assert len(polyline(PAPER_ROBOT, np.stack([q, move[1], turn[1]]))) >= 2
