"""Household rooms seen by a camera, with boxes of a mocked detector, rebuilt and compared.

In track B the camera measures noisy depth. In track D it does not, and all that gives the scale is its own height.

Each room is one file, so that a measurement that was ended goes on where it was.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

import bddl
from executor.assets.library import LIBRARY
from executor.bench.photo.score import compared, in_level_frame, support_counts
from executor.bench.photo.sensor import MOCKED, Detector, mocked_boxes, noisy
from executor.bench.photo.truth import Shot, photograph, photographer
from executor.geometry import Array
from executor.machine.files import read_json, write_json
from executor.photo.inputs.camera import Intrinsics
from executor.photo.inputs.depth import Depth
from executor.photo.inputs.picture import Exif, Photograph
from executor.photo.pipeline import Given, Result, reconstructed
from executor.photo.refusal import PhotoRefused
from executor.photo.space.level import find_upright, levelled_by_height
from executor.scenes import household
from oag import Scene

Track = Literal["B", "D"]
SCHEMA = "scene2demo-photo-room/1"
_STREAM = 180  # Keeps these draws apart from those of the rooms.


def pairs_of(seed: int, rooms: int) -> list[int]:
    """Returns which of a seed's household pairs are measured: the first of a fixed shuffle."""
    order = np.random.default_rng([seed, _STREAM]).permutation(household.COUNT)
    return [int(number) for number in order[:rooms]]


def measure(
    folder: Path,
    seed: int,
    rooms: int,
    detector: Detector,
    told: Callable[[Mapping[str, Any]], None],
    track: Track = "B",
) -> Iterator[dict[str, Any]]:
    """Yields the result of every room, measured where it has no file yet.

    Args:
        folder: Where the files of the rooms are.
        seed: Of the rooms, the cameras and the noise.
        rooms: How many.
        detector: The quality of the mocked detector.
        told: Is told of every room.
        track: What the camera measures.
    """
    with photographer():
        for number in pairs_of(seed, rooms):
            path = folder / f"room-{track}-{seed}-{number:03d}.json"
            result = read_json(path) if path.is_file() else _room(seed, number, detector, track)
            if not path.is_file():
                write_json(path, result)
            told(result)
            yield result


def _room(seed: int, number: int, detector: Detector, track: Track) -> dict[str, Any]:
    pair = household.pair(seed, number)
    shot = photograph(pair.scene, seed + number)
    rng = np.random.default_rng([seed, number, _STREAM])
    masks = shot.visible()
    categories = {name: LIBRARY[shot.scene.objects[name].model].category for name in masks}
    boxes = mocked_boxes(masks, categories, detector, rng)
    given = Given(
        pair.id,
        Photograph(Path(pair.id), shot.rgb, Exif(None, None, "")),
        Depth(noisy(shot.depth_m, rng), "drawn from the simulator, with the noise of a depth camera"),
        Intrinsics(shot.K[0, 0], shot.K[1, 1], shot.K[0, 2], shot.K[1, 2], "taken from the simulator"),
        tuple(boxes.values()),
    )
    base: dict[str, Any] = {"schema": SCHEMA, "room": pair.id, "seed": seed, "pair": number, "boxes": MOCKED}
    base["track"] = track
    began, worked = time.perf_counter(), time.process_time()
    try:
        if track == "D":
            upright = find_upright(given.picture, given.camera)
            floor = levelled_by_height(upright, float(shot.T_world_camera[2, 3]))
            given = replace(given, depth=None, floor=floor)
        result = reconstructed(given, variations=False)
    except PhotoRefused as problem:
        things = [_compared(shot, name, categories[name], masks, None, None, None).to_json() for name in masks]
        return {**base, "refused": str(problem), "kind": problem.kind, "things": things}
    took = {"took_s": time.perf_counter() - began, "cpu_s": time.process_time() - worked}
    ids = {name: _id_of(result, box) for name, box in boxes.items()}
    things = [_compared(shot, name, categories[name], masks, result, ids.get(name), given).to_json() for name in masks]
    return {
        **base,
        **took,
        "settled": not result.made.refused,
        "refused": result.made.refused,
        "camera": {"height_error_m": result.floor.height_m - float(shot.T_world_camera[2, 3])},
        "supports": support_counts(*_supports(shot.scene, result, ids)),
        "things": things,
    }


def _id_of(result: Result, box: object) -> str | None:
    return next((thing.id for thing in result.found.things if thing.detection is box), None)


def _compared(
    shot: Shot,
    name: str,
    category: str,
    masks: Mapping[str, Any],
    result: Result | None,
    made_id: str | None,
    given: Given | None,
) -> Any:
    true = in_level_frame(shot, name)
    points: Array = np.zeros((0, 3))
    made, confidence = None, None
    if result is not None and given is not None:
        # Without depth there are no points to draw a box around.
        seen = masks[name] & result.seen.measured
        points = result.seen.points_m[seen]
        thing = next((one for one in result.found.things if one.id == made_id), None)
        if thing is not None:
            confidence = thing.fit.confidence
            scene = result.made.scene
            made = thing.fit.guess.as_object(thing.id) if scene is None else scene.objects[thing.id]
    return compared(true, category, int(masks[name].sum()), made, confidence, points)


def _supports(
    scene: Scene, result: Result, ids: Mapping[str, str | None]
) -> tuple[Sequence[tuple[str, str]], Sequence[tuple[str, str]]]:
    """Pairs (thing, support) that are on or in each other, of things that the detector found, by their true names."""
    names = {made: name for name, made in ids.items() if made is not None}
    true = [(a, b) for a, b in _carried(scene) if a in ids and b in ids]
    made = [] if result.made.scene is None else _carried(result.made.scene)
    return true, [(names[a], names[b]) for a, b in made if a in names and b in names]


def _carried(scene: Scene) -> list[tuple[str, str]]:
    literals = (literal for fact in scene.facts for literal in bddl.literals(fact) or ())
    return [
        (literal.atom.args[0], literal.atom.args[1])
        for literal in literals
        if literal.value and literal.atom.predicate in ("ontop", "inside")
    ]
