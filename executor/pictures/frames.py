"""Pictures of a whole rollout as memory-mapped arrays, one file a view, and which of them stand for a step.

Source: the paper's L_j = min(ceil(t_j / p_2), 6), where t_j is an action's duration and p_2 the sampling interval.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from executor.records.rollout import StepRecord, Trajectory

Picture = NDArray[np.uint8]
GLOBAL_FACTOR = 2
"""The overview is drawn this many times larger than the robot's own views: people look at it, and detail is small."""

MOST_FRAMES = 6  # The paper's.
SAMPLING_INTERVAL_S = 1.0  # The paper's p_2.


@dataclass(frozen=True, slots=True)
class Frames:
    """What the cameras saw.

    Attributes:
        views: View name -> (N, H, W, 3) uint8 RGB; row i belongs to row i of the trajectory.
        size: Width and height of the robot's own views.
        renderer: What drew them, in words.
    """

    views: Mapping[str, Picture]
    size: tuple[int, int]
    renderer: str = ""

    @property
    def count(self) -> int:
        """Number of pictures of each view."""
        return min((len(pictures) for pictures in self.views.values()), default=0)

    def at_size(self, view: str, indices: slice | None = None) -> Picture:
        """Returns a view's pictures at the common size; larger ones are averaged down over whole blocks of pixels.

        Args:
            view: View name.
            indices: Which pictures; all of them by default.
        """
        pictures = self.views[view][indices or slice(None)]
        return shrink(pictures, pictures.shape[2] // self.size[0])


def view_size(view: str, size: tuple[int, int]) -> tuple[int, int]:
    """Returns the width and height at which a view is drawn, given those of the robot's own views."""
    factor = GLOBAL_FACTOR if view == "global" else 1
    return size[0] * factor, size[1] * factor


def frames_path(folder: Path, view: str) -> Path:
    """Returns where a view's array lies in a job's folder."""
    return folder / f"{view}.npy"


def shrink(pictures: Picture, factor: int) -> Picture:
    """Returns (N, H, W, 3) pictures averaged over blocks of factor x factor pixels; factor 1 changes nothing."""
    if factor <= 1:
        return pictures
    count, height, width, channels = pictures.shape
    smaller = np.empty((count, height // factor, width // factor, channels), dtype=np.uint8)
    for index, picture in enumerate(pictures):
        blocks = picture.reshape(height // factor, factor, width // factor, factor, channels)
        smaller[index] = (blocks.sum(axis=(1, 3), dtype=np.uint32) + factor * factor // 2) // (factor * factor)
    return smaller


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
