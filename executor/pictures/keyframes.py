"""Which recorded samples stand for a step: at most six, evenly spread.

Source: the paper's L_j = min(ceil(t_j / p_2), 6), where t_j is the action's duration and p_2 the sampling interval.
"""

from __future__ import annotations

import math

import numpy as np

from executor.records.rollout import StepRecord, Trajectory

MOST_FRAMES = 6
SAMPLING_INTERVAL_S = 1.0


def step_samples(trajectory: Trajectory, step: StepRecord) -> tuple[int, ...]:
    """Returns the indices of the samples that were recorded while a step ran, in order."""
    mask = (trajectory.subtask == step.subtask) & (trajectory.step == step.step)
    return tuple(int(index) for index in np.flatnonzero(mask))


def frame_count(duration_s: float, interval_s: float = SAMPLING_INTERVAL_S) -> int:
    """Returns L_j: how many pictures an action of a duration gets, from 1 to 6."""
    # A duration that is a whole number of intervals must not gain a picture by rounding.
    return max(1, min(math.ceil(duration_s / interval_s - 1e-9), MOST_FRAMES))


def key_samples(trajectory: Trajectory, step: StepRecord, interval_s: float = SAMPLING_INTERVAL_S) -> tuple[int, ...]:
    """Returns the indices of the samples that stand for a step; none when it ended between two samples.

    The last sample is always among them, since it shows the result; with two or more, the first one is as well, so
    that the change from beginning to end can be seen.
    """
    samples = step_samples(trajectory, step)
    if not samples:
        return ()
    count = min(frame_count(step.end_s - step.start_s, interval_s), len(samples))
    if count == 1:
        return (samples[-1],)
    return tuple(samples[round(place)] for place in np.linspace(0, len(samples) - 1, count))
