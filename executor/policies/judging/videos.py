"""Videos of episodes of an evaluation, drawn from their states afterwards."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path

from executor.datasets.footage import Look, film, footage_path
from executor.datasets.units import Recording, View
from executor.pictures.overview import cameras_for
from executor.pictures.stage import Draughtsman
from executor.policies.judging.evaluation import Footage

VIEW: View = "global"


def draw_video(draughtsman: Draughtsman, footage: Footage, folder: Path, size: tuple[int, int], rate_hz: float) -> Path:
    """Draws an episode as the global camera sees it, and returns the video's path.

    Args:
        draughtsman: What draws.
        footage: The episode, its states kept.
        folder: Where the video goes; it is made.
        size: Width and height.
        rate_hz: Pictures a second, one an action: the video is as long as the episode.

    Raises:
        VideoFailed: An encoder refuses.
        OSError: The folder cannot be written.
    """
    folder.mkdir(parents=True, exist_ok=True)
    cameras = cameras_for(footage.scene, (VIEW,), aspect=size[0] / size[1], task=footage.task)
    recording = Recording(views=(VIEW,), size=size, depth=False, segmentation=False)
    rate = Fraction(rate_hz).limit_denominator(1000)
    film(draughtsman, folder, footage.scene, footage.states, Look(cameras), recording, rate)
    return footage_path(folder, VIEW)
