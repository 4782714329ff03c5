"""Rigid transforms and hand orientations."""

from __future__ import annotations

import itertools

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from executor.geometry import (
    hand_rotation,
    interpolate_poses,
    inverse,
    nearest_turn,
    pitch_of,
    pose_vector,
    transform,
    transform_from_quaternion,
    wrap_angle,
)

angles = st.floats(-10.0, 10.0)
positions = st.tuples(*[st.floats(-3.0, 3.0)] * 3)
pitches = st.floats(-1.4, 1.4)


@given(angles, pitches, st.booleans(), st.booleans())
def test_a_hand_orientation_is_a_rotation_along_its_heading(
    yaw: float, pitch: float, flip: bool, upright: bool
) -> None:
    R = hand_rotation(yaw, pitch, flip=flip, upright=upright)
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(R) > 0
    np.testing.assert_allclose(R[:2, 2], np.cos(pitch) * np.array([np.cos(yaw), np.sin(yaw)]), atol=1e-12)
    level, vertical = (2, 0) if upright else (2, 1)
    closing = R[level, 1] if upright else R[vertical + 1, 1]
    assert abs(closing) > 0.1 if upright else abs(closing) < 1e-12


@given(positions, angles, pitches)
def test_inverse_and_quaternion_round_trips(position: tuple[float, ...], yaw: float, pitch: float) -> None:
    T = transform(hand_rotation(yaw, pitch), position)
    np.testing.assert_allclose(inverse(T) @ T, np.eye(4), atol=1e-9)
    vector = pose_vector(T)
    np.testing.assert_allclose(transform_from_quaternion(vector[:3], vector[3:]), T, atol=1e-9)
    assert abs(pitch_of(T) - pitch) < 1e-9


@given(angles, angles)
def test_the_nearest_turn_is_the_same_angle_and_near(angle: float, reference: float) -> None:
    found = nearest_turn(angle, reference)
    assert abs(wrap_angle(found - angle)) < 1e-9
    assert abs(found - reference) <= np.pi + 1e-9


@given(positions, positions, angles, pitches)
def test_interpolation_ends_where_it_should_in_small_steps(
    start: tuple[float, ...], end: tuple[float, ...], yaw: float, pitch: float
) -> None:
    T_start, T_end = transform(hand_rotation(0.0, 0.0), start), transform(hand_rotation(yaw, pitch), end)
    poses = [T_start, *interpolate_poses(T_start, T_end, step_m=0.05, step_rad=0.1)]
    np.testing.assert_allclose(poses[-1], T_end, atol=1e-6)
    steps = [np.linalg.norm(b[:3, 3] - a[:3, 3]) for a, b in itertools.pairwise(poses)]
    assert max(steps) <= 0.05 + 1e-9
