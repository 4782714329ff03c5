"""Which detector a folder holds: what lies in it decides."""

from __future__ import annotations

from pathlib import Path

from executor.photo.inputs.annotations import Detector
from executor.photo.perception.networks import CONFIG
from executor.photo.perception.packaged import packaged
from executor.photo.perception.zero_shot import zero_shot
from executor.photo.refusal import PhotoRefused


def detector_in(folder: Path, least_score: float | None = None) -> Detector:
    """Returns the detector in a folder.

    Args:
        folder: With `config.json` it is one for `transformers` (`executor.photo.perception.zero_shot`), with a graph of
            TensorFlow that of a package (`executor.photo.perception.packaged`).
        least_score: From which a box counts, 0 to 1; by default what is usual for the detector.

    Raises:
        PhotoRefused: It holds neither, or what it holds cannot be read.
        MissingExtra: What runs it is not installed.
    """
    if (folder / CONFIG).exists():
        return zero_shot(folder, least_score)
    if any(folder.glob("*.pb")):
        return packaged(folder, least_score)
    problem = "has no detector in it" if folder.is_dir() else "is no folder"
    hint = f"expected one with {CONFIG} and model.safetensors, or with a graph (.pb) and its text (.pbtxt)"
    raise PhotoRefused("weights", folder, problem, hint)
