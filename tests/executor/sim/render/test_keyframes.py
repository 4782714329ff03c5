"""L_j = min(ceil(t_j / p_2), 6), and which samples these are."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from executor.sim.render.frames import MOST_FRAMES, frame_count, key_samples, step_samples
from tests.executor.recordings import invented_rollout


@pytest.mark.parametrize(
    ("duration_s", "count"), [(0.0, 1), (0.2, 1), (1.0, 1), (1.01, 2), (3.0, 3), (5.5, 6), (6.0, 6), (40.0, 6)]
)
def test_counts_of_the_paper(duration_s: float, count: int) -> None:
    assert frame_count(duration_s) == count


@given(duration_s=st.floats(1e-3, 1e3), interval_s=st.floats(0.05, 10.0))
def test_never_more_than_six_and_never_none(duration_s: float, interval_s: float) -> None:
    count = frame_count(duration_s, interval_s)
    assert 1 <= count <= MOST_FRAMES
    assert count in (
        min(max(math.ceil(duration_s / interval_s), 1), MOST_FRAMES),
        min(max(math.ceil(duration_s / interval_s) - 1, 1), MOST_FRAMES),
    )


@given(interval_s=st.floats(0.02, 2.0))
def test_samples_are_spread_from_first_to_last(interval_s: float) -> None:
    rollout = invented_rollout()
    for subtask in rollout.subtasks:
        for step in subtask.steps:
            every = step_samples(rollout.trajectory, step)
            chosen = key_samples(rollout.trajectory, step, interval_s)
            assert list(chosen) == sorted(set(chosen)) and set(chosen) <= set(every)
            assert len(chosen) == min(frame_count(step.end_s - step.start_s, interval_s), len(every))
            assert chosen[-1] == every[-1]
            assert len(chosen) == 1 or chosen[0] == every[0]


def test_a_step_between_two_samples_has_no_picture() -> None:
    rollout = invented_rollout(samples=3)
    assert key_samples(rollout.trajectory, rollout.subtasks[0].steps[5]) == ()
