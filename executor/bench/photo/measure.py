"""Known rooms seen by a camera, rebuilt of what a track gives, and compared."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import numpy as np

import bddl
from executor.assets.imports.stored import Imported
from executor.assets.library import LIBRARY
from executor.bench.photo.drawn import DrawnRoom, each_once
from executor.bench.photo.foreign import CATEGORY, foreign_models, with_foreign_items
from executor.bench.photo.matching import matched
from executor.bench.photo.score import compared, in_level_frame, support_counts
from executor.bench.photo.sensor import MOCKED, ORACLE, MockedDetector
from executor.bench.photo.tracks import Track, input_of
from executor.bench.photo.truth import NoPlace, Shot, photograph, photograph_for, photographer
from executor.geometry import Array
from executor.photo.inputs.annotations import Detector
from executor.photo.pipeline import Result, reconstructed
from executor.photo.refusal import PhotoRefused
from executor.scenes.pair import NotDrawn
from oag import Scene

SCHEMA = "scene2demo-photo-room/1"
_STREAM = 180  # Keeps these draws apart from those of the rooms.


def measure(
    folder: Path,
    rooms: Sequence[DrawnRoom],
    detector: MockedDetector,
    told: Callable[[Mapping[str, Any]], None],
    track: Track = "B",
    detect: Detector | None = None,
) -> Iterator[dict[str, Any]]:
    """Yields the result of every room, measured where it has no file yet.

    Args:
        folder: Where the files of the rooms are.
        rooms: Which ones.
        detector: The quality of the mocked detector.
        told: Is told of every room.
        track: What is given.
        detect: Of track F, the detector.
    """
    with photographer(), foreign_models(folder / "foreign") if track == "G" else nullcontext(()) as foreign:

        def measured(room: DrawnRoom) -> dict[str, Any]:
            return _room(room, detector, track, foreign, detect)

        yield from each_once(folder, f"room-{track}", rooms, measured, told)


def _room(
    room: DrawnRoom, detector: MockedDetector, track: Track, foreign: Sequence[Imported], detect: Detector | None
) -> dict[str, Any]:
    base: dict[str, Any] = {"schema": SCHEMA, "room": room.name, "family": room.family, "track": track}
    base["boxes"] = {"A": ORACLE, "C": "none", "F": "a detector's"}.get(track, MOCKED)
    try:
        scene = room.pair().scene
        if foreign:
            scene = with_foreign_items(scene, foreign, np.random.default_rng([*room.entropy, _STREAM + 1]))
        items = [thing.id for thing in scene.objects.values() if thing.category == CATEGORY]
        # Of what is as small as they are, a picture of the whole room shows too little to count.
        shot = photograph_for(scene, items, room.camera_seed)[0] if foreign else photograph(scene, room.camera_seed)
    except (NotDrawn, NoPlace) as problem:
        return {**base, "not_photographed": str(problem), "refused": str(problem), "things": []}
    rng = np.random.default_rng([*room.entropy, _STREAM])
    masks = shot.visible()
    categories = {name: category_in(shot.scene, name) for name in masks}
    counted = {name: mask for name, mask in masks.items() if not foreign or categories[name] == CATEGORY}
    began, worked = time.perf_counter(), time.process_time()
    try:
        made = input_of(track, room.name, shot, categories, detector, rng, detect)
        result = reconstructed(made.given, variations=False)
    except PhotoRefused as problem:
        things = [_compared(shot, name, categories[name], masks, None, None).to_json() for name in counted]
        return {**base, "refused": str(problem), "kind": problem.kind, "things": things}
    took = {"took_s": time.perf_counter() - began, "cpu_s": time.process_time() - worked}
    # What is made of something that is hardly seen is nothing invented.
    ids, invented = matched(shot.visible(least_px=1), made.boxes, result)
    things = [_compared(shot, name, categories[name], masks, result, ids.get(name)).to_json() for name in counted]
    return {
        **base,
        **took,
        "settled": not result.made.refused,
        "refused": result.made.refused,
        "camera": {"height_error_m": result.floor.height_m - float(shot.T_world_camera[2, 3])},
        "supports": support_counts(*_supports(shot.scene, result, ids)),
        "invented": [next(one.fit.guess.entry.model for one in result.found.things if one.id == k) for k in invented],
        "things": things,
    }


def category_in(scene: Scene, name: str) -> str:
    """Returns what a thing is: the library's name of it, or its own where the library has nothing like it."""
    thing = scene.objects[name]
    return LIBRARY[thing.model].category if thing.model in LIBRARY else thing.category


def _compared(
    shot: Shot,
    name: str,
    category: str,
    masks: Mapping[str, Any],
    result: Result | None,
    made_id: str | None,
) -> Any:
    true = in_level_frame(shot, name)
    points: Array = np.zeros((0, 3))
    made, confidence = None, None
    if result is not None:
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
    scene: Scene, result: Result, ids: Mapping[str, str]
) -> tuple[Sequence[tuple[str, str]], Sequence[tuple[str, str]]]:
    """Pairs (thing, support) that are on or in each other, of things that were found, by their true names."""
    names = {made: name for name, made in ids.items()}
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
