"""All of it in order: files are read, the room is levelled, walls are found, things are fitted, a scene is made."""

from __future__ import annotations

import hashlib
import json
import time
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path

from executor.photo.fitting.rim import levelled_by_rim
from executor.photo.inputs.agreement import depth_doubts
from executor.photo.inputs.annotations import Detections, Detector, LeftOut, Sighting
from executor.photo.inputs.camera import Intrinsics, read_camera
from executor.photo.inputs.captures import is_capture, read_capture
from executor.photo.inputs.depth import Depth, DepthSource
from executor.photo.inputs.picture import Photograph, read_picture
from executor.photo.inputs.scale import find_board, read_length, scaled_by_board, scaled_by_length
from executor.photo.refusal import PhotoRefused
from executor.photo.room.reconstruct import FittedRoom, reconstruct
from executor.photo.scene import MadeScene, scene_of
from executor.photo.space.floor import FloorSeen, observe
from executor.photo.space.level import (
    find_upright,
    flat_observation,
    levelled_by_board,
    levelled_by_height,
    levelled_by_length,
)
from executor.photo.space.observation import Observation
from executor.photo.space.rescale import observe_by_height
from executor.photo.space.walls import find_walls
from executor.photo.tidy import SAME_HEIGHT_M
from executor.photo.variations import RoomVariation, variations_of

Told = Callable[[str], None]

_ABOUT_M = 0.1  # Between a thing and its top by sight, where one of them may have been fitted better since.
_HARDLY_SEEN = 0.01  # Of the picture, the box of what a room may do without.


@dataclass(frozen=True)
class Given:
    """What a reconstruction is made of.

    Attributes:
        name: Of the scene.
        picture, camera, detections: As they were read.
        depth: As it was read; None where the picture is all there is.
        seen, floor: The picture in the level frame, and what levels it.
        left_out: What was found and the library has nothing for.
        find_more: Whether what nobody has boxed is searched for.
        doubts: What speaks against the depth or the boxes being of this picture, in sentences.
    """

    name: str
    picture: Photograph
    depth: Depth | None
    camera: Intrinsics
    detections: tuple[Sighting, ...]
    seen: Observation
    floor: FloorSeen
    left_out: tuple[LeftOut, ...] = ()
    find_more: bool = False
    doubts: tuple[str, ...] = ()

    @property
    def sha256(self) -> str:
        """Hash of everything that a reconstruction depends on: another one makes another scene."""
        scale = None if self.depth is not None else (self.floor.up.tolist(), self.floor.height_m)
        told = (self.name, asdict(self.camera), [one.to_json() for one in self.detections], scale, self.find_more)
        parts = (
            self.picture.rgb.tobytes(),
            b"" if self.depth is None else self.depth.z_m.tobytes(),
            json.dumps(told).encode(),
        )
        return hashlib.sha256(b"".join(hashlib.sha256(part).digest() for part in parts)).hexdigest()


@dataclass(frozen=True)
class Result:
    """A reconstruction with what it came from and what became of it.

    Attributes:
        given: The input.
        found: The things, and what was left out.
        made: The scene.
        varied: The same room with the next best models.
        took_s: step -> seconds.
    """

    given: Given
    found: FittedRoom
    made: MadeScene
    varied: tuple[RoomVariation, ...]
    took_s: Mapping[str, float]

    @property
    def seen(self) -> Observation:
        """The picture in the level frame."""
        return self.given.seen

    @property
    def floor(self) -> FloorSeen:
        """The floor."""
        return self.given.floor


@dataclass(frozen=True)
class GivenBeside:
    """What is given beside a picture.

    Attributes:
        detect: Finds things in it: in a file, by a network, by asking a model; with depth it may be left out.
        depth: Gives it its depth; None for a recording, which has its own, and where there is none.
        camera: `hfov=70`, `vfov=55` or a JSON file; by default what the recording or the picture's EXIF says.
        frame: Which moment of a recording.
        length, board: What gives the scale, see `executor.photo.inputs.scale`.
        camera_height_m: Of the camera above the floor, which gives its scale to a picture without depth, or with depth
            that a network has guessed.
        find_more: Whether what nobody has boxed is searched for, too; needed with depth where no boxes are given.
    """

    detect: Detector | None = None
    depth: DepthSource | None = None
    camera: str | None = None
    frame: int | None = None
    length: str | None = None
    board: str | None = None
    camera_height_m: float | None = None
    find_more: bool = False


def read_given(picture: Path, beside: GivenBeside) -> Given:
    """Returns what the files of a photograph say.

    Args:
        picture: The picture, or a recording (see `executor.photo.inputs.captures`).
        beside: What is given beside it.

    Raises:
        PhotoRefused: One of them cannot be used.
        MissingExtra: What reads one of them is not installed.
        OSError: A file cannot be read.
        ModelError, AnswersRefused: Whoever is asked for boxes gives no usable answer.
    """
    shown, measured, intrinsics = _sensed(picture, beside)
    if beside.detect is None and measured is None:
        hint = "give --boxes, --detector or --model, or --depth, or both"
        raise PhotoRefused("boxes", picture, "has neither boxes nor depths", hint)
    if beside.detect is None and not beside.find_more:
        hint = "give --boxes, --detector or --model, or have things searched for in its depths by --find-more"
        raise PhotoRefused("boxes", picture, "has no boxes", hint)
    # A network's depth is of the picture, and bent.
    doubts: tuple[str, ...] = ()
    if measured is not None and not measured.bend_share:
        doubts = depth_doubts(shown, measured, intrinsics)
    if measured is not None and beside.board is not None:
        measured = scaled_by_board(measured, find_board(beside.board, shown, intrinsics))
    if measured is not None and beside.length is not None:
        measured = scaled_by_length(measured, intrinsics, read_length(beside.length))
    # A network takes its time and a model its price: all that is given beside them has been read by now, and with depth
    # the floor has been found.
    level: tuple[Observation, FloorSeen] | None = None
    if measured is not None and beside.camera_height_m is not None:
        measured, seen, floor = observe_by_height(shown, measured, intrinsics, beside.camera_height_m)
        level = seen, floor
    elif measured is not None:
        level = observe(shown, measured, intrinsics)
    found = Detections(()) if beside.detect is None else beside.detect(shown)
    if beside.detect is not None and not found.things:
        reasons = "; ".join(f"{one.label}: {one.reason}" for one in found.left_out)
        raise PhotoRefused("nothing", picture, "nothing in it was recognised", reasons)
    if level is None:
        floor = _levelled(shown, intrinsics, found.things, beside)
        level = flat_observation(shown, intrinsics, floor), floor
    return Given(
        picture.stem,
        shown,
        measured,
        intrinsics,
        found.things,
        *level,
        found.left_out,
        beside.find_more,
        (*doubts, *found.doubts),
    )


def _levelled(picture: Photograph, camera: Intrinsics, things: tuple[Sighting, ...], beside: GivenBeside) -> FloorSeen:
    """Returns what is known of the floor without depth."""
    if beside.board is not None:
        return levelled_by_board(find_board(beside.board, picture, camera))
    if beside.camera_height_m is not None:
        return levelled_by_height(find_upright(picture, camera), beside.camera_height_m)
    if beside.length is not None:
        return levelled_by_length(find_upright(picture, camera), camera, read_length(beside.length))
    return levelled_by_rim(picture, camera, things)


def _sensed(picture: Path, beside: GivenBeside) -> tuple[Photograph, Depth | None, Intrinsics]:
    if is_capture(picture):
        if beside.depth is not None:
            raise PhotoRefused("depth", picture, "has depths of its own", "leave out --depth and --depth-model")
        capture = read_capture(picture, beside.frame)
        own = capture.camera if beside.camera is None else None
        return capture.picture, capture.depth, own or read_camera(beside.camera, capture.picture)
    if beside.frame is not None:
        raise PhotoRefused("picture", picture, "is one picture", "--frame is for recordings")
    shown = read_picture(picture)
    intrinsics = read_camera(beside.camera, shown)
    return shown, None if beside.depth is None else beside.depth(shown), intrinsics


def reconstructed(given: Given, told: Told = lambda words: None, *, variations: bool = True) -> Result:
    """Returns the scene of a photograph.

    Args:
        given: The input.
        told: Is told what has been found, in sentences.
        variations: Whether the next best models are made rooms of as well.

    Raises:
        PhotoRefused: Nothing is recognised.
    """
    began = time.perf_counter()
    seen, floor = given.seen, given.floor
    for doubt in given.doubts:
        told(doubt)
    walls = () if given.depth is None else find_walls(seen, given.detections)
    walled = time.perf_counter()
    told(f"camera {floor.height_m:.2f} m above the floor, {len(walls)} walls")
    found = reconstruct(seen, given.detections, walls, told, floor.spread_share, find_more=given.find_more)
    fitted = time.perf_counter()
    _require_things(given, found)
    same_height_m = SAME_HEIGHT_M if seen.is_exact else _ABOUT_M
    found, made = scene_of(found, given.name, _HARDLY_SEEN * seen.z_m.size, same_height_m=same_height_m)
    _require_things(given, found)
    settled = time.perf_counter()
    varied = variations_of(found, given.name) if variations else ()
    took = {
        "walls": walled - began,
        "fitting": fitted - walled,
        "settling": settled - fitted,
        "variations": time.perf_counter() - settled,
    }
    return Result(given, found, made, varied, took)


def _require_things(given: Given, found: FittedRoom) -> None:
    """Refuse a room of which nothing is left."""
    if not found.things:
        reasons = "; ".join(f"{one.detection.label or 'thing'}: {one.reason}" for one in found.unfitted)
        raise PhotoRefused("nothing", given.picture.source, "nothing in it was recognised", reasons)
