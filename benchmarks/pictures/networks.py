"""Measure networks of one's own on the real pictures: boxes and names, masks' boxes, depths, opening angles, seconds.

    python -m benchmarks.pictures.networks runs/pictures --half tuning --detector weights/grounding-dino-tiny
    python -m benchmarks.pictures.networks runs/pictures --half tuning --depth-model weights/depth-pro

A thing that a person boxed is found if a box of the detector overlaps its box by at least half (IoU), one to one, the
best pairs first; it is named if both names are of one category of the library. Boxes of nothing annotated are counted,
not judged: most pictures show more than what is boxed. Depths are compared with a sensor's, pixel by pixel.
"""

from __future__ import annotations

import argparse
import json
import math
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from executor.bench.photo.pictures import RealPicture, read_pictures
from executor.photo.errors import PhotoRefused
from executor.photo.inputs.annotations import Detection, Detector, category_named
from executor.photo.inputs.depth import DepthSource, read_depth
from executor.photo.inputs.picture import read_camera, read_picture
from executor.photo.networks.depth import guessed_depth
from executor.photo.networks.detect import detector_in
from executor.scenes.models import NoMatchingModel
from llm.vision import overlap

HERE = Path(__file__).parent
FOUND = 0.5
"""Least overlap of a found thing with its box."""


def detections(picture: RealPicture, detect: Detector) -> dict[str, Any]:
    """Return how many boxed things a detector finds and names."""
    began = time.process_time()
    found = detect(read_picture(picture.color))
    took_s = time.process_time() - began
    pairs = matched(picture, found.things)
    right = [i for i, j in pairs.items() if _same(str(picture.things[i]["label"]), found.things[j].label)]
    nameable = [i for i, thing in enumerate(picture.things) if _category(str(thing["label"])) is not None]
    return {
        "things": len(picture.things),
        "nameable": len(nameable),
        "found": len(pairs),
        "named": len(right),
        "other_boxes": len(found.things) - len(pairs),
        "no_model": len(found.left_out),
        "cpu_s": took_s,
    }


def matched(picture: RealPicture, things: Sequence[Detection]) -> dict[int, int]:
    """Return index of a boxed thing -> index of its detection, each once, the largest overlaps first."""
    overlaps = [
        (overlap(tuple(boxed["box"]), one.box_px), i, j)
        for i, boxed in enumerate(picture.things)
        for j, one in enumerate(things)
    ]
    pairs: dict[int, int] = {}
    for share, i, j in sorted(overlaps, reverse=True):
        if share >= FOUND and i not in pairs and j not in pairs.values():
            pairs[i] = j
    return pairs


def _category(label: str) -> str | None:
    try:
        return category_named(label)
    except NoMatchingModel:
        return None


def _same(label: str, other: str) -> bool:
    return label == other or (_category(label) is not None and _category(label) == _category(other))


def depths(picture: RealPicture, guess: DepthSource) -> dict[str, Any]:
    """Return how far a guessed depth is from the sensor's, and a guessed opening angle from the calibrated one."""
    shown = read_picture(picture.color)
    camera = read_camera(str(picture.camera), shown)
    began = time.process_time()
    guessed = guess(shown, camera)
    record: dict[str, Any] = {"cpu_s": time.process_time() - began}
    if picture.depth is not None:
        measured = read_depth(picture.depth, shown.size_px, picture.depth_unit_m).z_m
        both = (measured > 0.0) & (guessed.z_m > 0.0)
        ratio = guessed.z_m[both] / measured[both]
        record |= {"scale": float(np.median(ratio)), "off": float(np.median(np.abs(ratio - 1.0)))}
        record["off_scaled"] = float(np.median(np.abs(ratio / np.median(ratio) - 1.0)))
    if guessed.camera is not None:
        alone = guess(shown, None).camera
        if alone is not None:
            angles = (math.degrees(2 * math.atan(shown.size_px[0] / 2 / one.fx)) for one in (alone, camera))
            record["hfov_off_deg"] = float(np.subtract(*angles))
    return record


def main() -> None:
    """Measure what the command line names, and print a line a picture and the sums."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("pictures", type=Path, help="folder that benchmarks.pictures.fetch filled")
    parser.add_argument("--half", choices=("tuning", "judging"), default="tuning")
    parser.add_argument("--detector", type=Path, help="folder with a detector's weights")
    parser.add_argument("--least-score", type=float)
    parser.add_argument("--depth-model", type=Path, help="folder with the weights of a network that guesses depths")
    typed = parser.parse_args()
    detect = None if typed.detector is None else detector_in(typed.detector, typed.least_score)
    guess = None if typed.depth_model is None else guessed_depth(typed.depth_model)
    records = []
    for picture in read_pictures(HERE, typed.pictures, typed.half, ()):
        record: dict[str, Any] = {"picture": picture.name}
        try:
            record |= {} if detect is None else detections(picture, detect)
            record |= {} if guess is None else depths(picture, guess)
        except PhotoRefused as problem:
            record["refused"] = str(problem)
        records.append(record)
        print(json.dumps(record), flush=True)
    numbers = {key for record in records for key, value in record.items() if isinstance(value, int | float)}
    middle = {key: float(np.median([one[key] for one in records if key in one])) for key in sorted(numbers)}
    sums = {key: sum(one.get(key, 0) for one in records) for key in sorted(numbers)}
    print(json.dumps({"pictures": len(records), "sum": sums, "median": middle}))


if __name__ == "__main__":
    main()
