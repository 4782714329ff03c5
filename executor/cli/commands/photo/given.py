"""A photograph as the command line gives it, and the scene that `run` has made of one."""

from __future__ import annotations

from pathlib import Path

from executor.cli.errors import check
from executor.cli.output import tell
from executor.cli.words.shared import PhotoInputs
from executor.photo.folder import kept_scene, none_left, prepared, write_result
from executor.photo.inputs.annotations import Detector, boxes_in
from executor.photo.inputs.depth import DepthSource, depth_in
from executor.photo.perception.depth_network import guessed_depth
from executor.photo.perception.folders import detector_in
from executor.photo.pipeline import Given, GivenBeside, read_given, reconstructed
from executor.photo.refusal import RoomRefused
from executor.photo.space.floor import HEIGHTS_M


def read_photograph(picture: Path, beside: PhotoInputs, asked: Detector | None = None) -> Given:
    """Returns what a photograph's files say.

    Args:
        picture: The picture, or a recording.
        beside: What was typed beside it.
        asked: The model that is asked for boxes, where there is one.

    Raises:
        BadOption: There are two sources of boxes or depths, or a number is out of its range.
        PhotoRefused: A file cannot be used.
        ModelError, AnswersRefused: The model gives no usable answer.
    """
    height_m, (low, high) = beside.camera_height_m, HEIGHTS_M
    good = height_m is None or low <= height_m <= high
    check(good, "--camera-height-m", height_m, f"metres from {low:g} to {high:g}")
    return read_given(
        picture,
        GivenBeside(
            _detector(picture, beside, asked),
            _depth(beside),
            beside.camera,
            beside.frame,
            beside.length,
            beside.board,
            beside.camera_height_m,
            beside.find_more,
        ),
    )


def _detector(picture: Path, beside: PhotoInputs, asked: Detector | None) -> Detector | None:
    boxes, folder, least = beside.boxes, beside.detector, beside.least_score
    sources = [one for one in (boxes, folder, asked) if one is not None]
    check(len(sources) < 2, "--boxes", boxes or folder, "one of --boxes, --detector and --model, not two")
    check(least is None or folder is not None, "--least-score", least, "--detector beside it")
    check(least is None or 0.0 <= least <= 1.0, "--least-score", least, "a number from 0 to 1")
    if folder is not None:
        return detector_in(folder, least)
    return asked if boxes is None else boxes_in(boxes, picture.name)


def _depth(beside: PhotoInputs) -> DepthSource | None:
    unit_m = beside.depth_unit_m
    check(unit_m is None or 1e-6 <= unit_m <= 10.0, "--depth-unit-m", unit_m, "metres, such as 0.001 or 0.0002")
    twice = beside.depth is not None and beside.depth_model is not None
    check(not twice, "--depth-model", beside.depth_model, "one of --depth and --depth-model, not both")
    if beside.depth_model is not None:
        return guessed_depth(beside.depth_model)
    return None if beside.depth is None else depth_in(beside.depth, unit_m)


def scene_of_photograph(picture: Path, beside: PhotoInputs, folder: Path, *, quiet: bool) -> Path:
    """Returns the file of the scene that is in a photograph; one that was made of the same input is taken as it is.

    Args:
        picture: The picture, or a recording.
        beside: What was typed beside it.
        folder: Where the reconstruction is kept.
        quiet: Whether nobody is told how it goes on.

    Raises:
        BadOption, PhotoRefused: What is given makes no scene.
        RoomRefused: Physics refuses what was reconstructed.
    """
    given = read_photograph(picture, beside)
    kept = kept_scene(folder, given)
    if kept is not None:
        return kept
    prepared(folder, force=True)
    with none_left(folder):
        result = reconstructed(given, (lambda words: None) if quiet else (lambda words: tell(f"  {words}")))
    write_result(folder, result)
    if result.made.refused:
        raise RoomRefused(picture, result.made.refused, folder)
    return folder / "scene.json"
