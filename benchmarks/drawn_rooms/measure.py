"""Measure reconstructions of known rooms: rendered, degraded like true pictures, reconstructed and compared."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

import bddl
from benchmarks.drawn_rooms.rooms import DrawnRoom
from benchmarks.drawn_rooms.score import compare_thing, in_level_frame, match_things, support_counts
from benchmarks.drawn_rooms.tracks import MOCKED, MockedDetector, TrackName, input_of
from executor.assets.library import LIBRARY
from executor.bench.photo.pictures import each_once
from executor.bench.photo.truth import NoPlace, Shot, photograph, photographer
from executor.geometry import Array
from executor.photo.errors import PhotoRefused
from executor.photo.pipeline import PhotoResult, reconstruct_scene
from executor.scenes.pair import NotDrawn
from oag import Scene

ROOM_SCHEMA = "scene2demo-photo-room/1"
_ROOM_STREAM = 180  # Keeps these draws apart from those of the rooms.


def measure(
    folder: Path,
    rooms: Sequence[DrawnRoom],
    detector: MockedDetector,
    on_progress: Callable[[Mapping[str, Any]], None],
    track: TrackName = "B",
) -> Iterator[dict[str, Any]]:
    """Yield the result of every room, measured if it has no file yet.

    Args:
        folder: Folder of the rooms' files.
        rooms: Which ones.
        detector: The quality of the mocked detector.
        on_progress: Called with every result.
        track: The track.
    """
    with photographer():
        yield from each_once(folder, f"room-{track}", rooms, lambda room: _measured(room, detector, track), on_progress)


def _measured(room: DrawnRoom, detector: MockedDetector, track: TrackName) -> dict[str, Any]:
    base: dict[str, Any] = {"schema": ROOM_SCHEMA, "room": room.name, "family": room.family, "track": track}
    base["boxes"] = MOCKED
    try:
        shot = photograph(room.pair().scene, room.camera_seed)
    except (NotDrawn, NoPlace) as problem:
        return {**base, "not_photographed": str(problem), "refused": str(problem), "things": []}
    rng = np.random.default_rng([*room.entropy, _ROOM_STREAM])
    masks = shot.visible()
    categories = {name: category_in(shot.scene, name) for name in masks}
    began, worked = time.perf_counter(), time.process_time()
    try:
        made = input_of(track, room.name, shot, categories, detector, rng)
        result = reconstruct_scene(made.given, variations=False)
    except PhotoRefused as problem:
        things = [_compared(shot, name, categories[name], masks, None, None).to_json() for name in masks]
        return {**base, "refused": str(problem), "kind": problem.kind, "things": things}
    took = {"took_s": time.perf_counter() - began, "cpu_s": time.process_time() - worked}
    # A fit of a hardly visible object is not invented.
    ids, invented = match_things(shot.visible(least_px=1), made.boxes, result)
    things = [_compared(shot, name, categories[name], masks, result, ids.get(name)).to_json() for name in masks]
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
    """Return the library's category of an object, or its own if the library has none."""
    thing = scene.objects[name]
    return LIBRARY[thing.model].category if thing.model in LIBRARY else thing.category


def _compared(
    shot: Shot,
    name: str,
    category: str,
    masks: Mapping[str, Any],
    result: PhotoResult | None,
    made_id: str | None,
) -> Any:
    true = in_level_frame(shot, name)
    points: Array = np.zeros((0, 3))
    made, confidence = None, None
    if result is not None:
        # Without depth there are no points to draw a box around.
        visible = masks[name] & result.observation.measured
        points = result.observation.points_m[visible]
        thing = next((one for one in result.found.things if one.id == made_id), None)
        if thing is not None:
            confidence = thing.fit.confidence
            scene = result.made.scene
            made = thing.fit.guess.as_object(thing.id) if scene is None else scene.objects[thing.id]
    return compare_thing(true, category, int(masks[name].sum()), made, confidence, points)


def _supports(
    scene: Scene, result: PhotoResult, ids: Mapping[str, str]
) -> tuple[Sequence[tuple[str, str]], Sequence[tuple[str, str]]]:
    """Return pairs (object, support) of found objects, by their true names."""
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
