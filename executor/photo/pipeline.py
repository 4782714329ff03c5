"""All of it in order: files are read, the room is levelled, walls are found, things are fitted, a scene is made."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from executor.photo.inputs.annotations import Sighting, read_boxes
from executor.photo.inputs.camera import Intrinsics, read_camera
from executor.photo.inputs.depth import Depth, read_depth
from executor.photo.inputs.picture import Photograph, read_picture
from executor.photo.reconstruct import FittedRoom, reconstruct
from executor.photo.refusal import PhotoRefused
from executor.photo.scene import MadeScene, scene_of
from executor.photo.space.floor import FloorSeen, observe
from executor.photo.space.observation import Observation
from executor.photo.space.walls import find_walls

Told = Callable[[str], None]


@dataclass(frozen=True)
class Given:
    """What a reconstruction is made of.

    Attributes:
        name: Of the scene.
        picture, depth, camera, detections: As they were read.
    """

    name: str
    picture: Photograph
    depth: Depth
    camera: Intrinsics
    detections: tuple[Sighting, ...]


@dataclass(frozen=True)
class Result:
    """A reconstruction with what it came from and what became of it.

    Attributes:
        given: The input.
        seen: The picture in the level frame.
        floor: The floor.
        found: The things, and what was left out.
        made: The scene.
        took_s: step -> seconds.
    """

    given: Given
    seen: Observation
    floor: FloorSeen
    found: FittedRoom
    made: MadeScene
    took_s: Mapping[str, float]


def read_given(
    picture: Path, depth: Path, boxes: Path, camera: str | None = None, depth_unit_m: float | None = None
) -> Given:
    """Returns what the files of a photograph say.

    Args:
        picture: The picture.
        depth: Its depth, see `executor.photo.inputs.depth`.
        boxes: Boxes with names, see `executor.photo.inputs.annotations`.
        camera: `hfov=70`, `vfov=55` or a JSON file; by default the picture's EXIF.
        depth_unit_m: One step of the depth's numbers in metres.

    Raises:
        PhotoRefused: One of them cannot be used.
        OSError: A file cannot be read.
    """
    shown = read_picture(picture)
    intrinsics = read_camera(camera, shown)
    measured = read_depth(depth, shown.size_px, depth_unit_m)
    return Given(picture.stem, shown, measured, intrinsics, read_boxes(boxes, shown.size_px, picture.name))


def reconstructed(given: Given, told: Told = lambda words: None) -> Result:
    """Returns the scene of a photograph.

    Args:
        given: The input.
        told: Is told what has been found, in sentences.

    Raises:
        PhotoRefused: No floor is seen, or nothing is recognised.
    """
    began = time.perf_counter()
    seen, floor = observe(given.picture, given.depth, given.camera)
    walls = find_walls(seen, given.detections)
    levelled = time.perf_counter()
    told(f"camera {floor.height_m:.2f} m above the floor, {len(walls)} walls")
    found = reconstruct(seen, given.detections, walls, told)
    fitted = time.perf_counter()
    if not found.things:
        reasons = "; ".join(f"{one.detection.label or 'thing'}: {one.reason}" for one in found.unfitted)
        raise PhotoRefused("nothing", given.picture.source, "nothing in it was recognised", reasons)
    made = scene_of(found, given.name)
    took = {"floor and walls": levelled - began, "fitting": fitted - levelled, "settling": time.perf_counter() - fitted}
    return Result(given, seen, floor, found, made, took)
