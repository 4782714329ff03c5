"""From a recorded rollout to pictures of every sample."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from executor.pictures.cameras import VIEWS, cameras_for
from executor.pictures.render.frames import Frames, frames_path
from executor.pictures.render.job import write_job
from executor.pictures.render.pool import Progress, RenderPool
from executor.records.rollout import Rollout

DEFAULT_SIZE = (224, 224)
SMALLEST_SIDE, LARGEST_SIDE = 32, 2048


class BadPictureSize(ValueError):
    """Pictures of this size cannot be drawn or encoded."""

    def __init__(self, size: tuple[int, int]) -> None:
        super().__init__(
            f"pictures of {size[0]} x {size[1]} pixels are not possible: "
            f"both sides must be even numbers from {SMALLEST_SIDE} to {LARGEST_SIDE}"
        )


def check_size(size: tuple[int, int]) -> tuple[int, int]:
    """Returns the size of pictures when it can be drawn and encoded.

    Raises:
        BadPictureSize: When it cannot.
    """
    if any(side % 2 or not SMALLEST_SIDE <= side <= LARGEST_SIDE for side in size):
        raise BadPictureSize(size)
    return size


def render(
    rollout: Rollout,
    out_dir: Path | str,
    *,
    views: Sequence[str] = VIEWS,
    size: tuple[int, int] = DEFAULT_SIZE,
    shadows: bool = True,
    listen: Progress | None = None,
    pool: RenderPool | None = None,
) -> Frames:
    """Returns pictures of every recorded sample, drawn from the packed physical states.

    Args:
        rollout: What was recorded; its scene rebuilds the world.
        out_dir: Folder for the arrays (about 1 MB a sample at the default size); it is made when absent.
        views: Names out of `executor.pictures.cameras.VIEWS`.
        size: Width and height of the robot's own views; the overview is drawn twice as large.
        shadows: Whether to draw shadows.
        listen: Told how many samples are done, and of how many.
        pool: Worker processes to reuse; without one, they are started and ended here.

    Raises:
        RendererNotFound: When nothing on this machine can draw.
        RenderFailed: When drawing failed.
        BadPictureSize: When the size cannot be drawn.
        ValueError: When a view is unknown or nothing was recorded.
    """
    width, height = check_size(size)
    folder = Path(out_dir)
    folder.mkdir(parents=True, exist_ok=True)
    states = rollout.trajectory.packed_states
    cameras = cameras_for(rollout.scene, views, aspect=width / height, task=rollout.task)
    write_job(folder, rollout.scene, cameras, states, size, shadows=shadows)
    if pool is not None:
        pool.draw(folder, len(states), listen)
        words = pool.renderer.why
    else:
        with RenderPool() as own:
            own.draw(folder, len(states), listen)
            words = own.renderer.why
    pictures = {view: np.load(frames_path(folder, view), mmap_mode="r") for view in views}
    return Frames(pictures, size, words)
