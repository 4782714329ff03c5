"""From a photograph to a scene: read the inputs, level the picture, find walls, fit the room, make the scene.

    photo -> inputs (picture, depth, camera, boxes) -> geometry (floor, walls) -> fitting (furniture, then items) ->
        scene

Frames: a camera looks along +z, x right, y down, as in OpenCV. The level frame has its origin on the floor under the
camera, z up, and x where the camera looks; the reconstructed scene is in it.
"""

from __future__ import annotations

import hashlib
import json
import time
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path

from executor.photo.errors import PhotoRefused
from executor.photo.fitting.rim import level_by_rim
from executor.photo.geometry.level import (
    find_board,
    find_upright,
    flat_observation,
    level_by_board,
    level_by_height,
    level_by_length,
    observe_by_height,
    read_length,
    scale_by_board,
    scale_by_length,
)
from executor.photo.geometry.observation import FloorPlane, Observation, observe
from executor.photo.geometry.walls import find_walls
from executor.photo.inputs.annotations import Detection, Detections, Detector, LeftOut
from executor.photo.inputs.consistency import depth_doubts
from executor.photo.inputs.depth import Depth, DepthSource, is_capture, read_capture
from executor.photo.inputs.picture import Intrinsics, Photograph, read_camera, read_picture
from executor.photo.room.reconstruct import FittedRoom, reconstruct
from executor.photo.scene import SAME_HEIGHT_M, MadeScene, RoomVariation, scene_of, variations_of

OnSentence = Callable[[str], None]

_ABOUT_M = 0.1  # Between an object and its top without exact depth: one of them may have been fitted better since.
_LEAST_BOX_SHARE = 0.01  # Share of the picture below which an object may be left out.


@dataclass(frozen=True)
class PhotoInput:
    """Input of a reconstruction.

    Attributes:
        name: Name of the scene.
        picture, camera, detections: As they were read.
        depth: As it was read; None without depth.
        observation, floor: The picture in the level frame, and the floor that levels it.
        left_out: Detections for which the library has no model.
        find_more: Whether objects without a box are searched for.
        doubts: Evidence that depth or boxes do not belong to this picture, as sentences.
    """

    name: str
    picture: Photograph
    depth: Depth | None
    camera: Intrinsics
    detections: tuple[Detection, ...]
    observation: Observation
    floor: FloorPlane
    left_out: tuple[LeftOut, ...] = ()
    find_more: bool = False
    doubts: tuple[str, ...] = ()

    @property
    def sha256(self) -> str:
        """Hash of everything that determines a reconstruction."""
        scale = None if self.depth is not None else (self.floor.up.tolist(), self.floor.height_m)
        settings = (self.name, asdict(self.camera), [one.to_json() for one in self.detections], scale, self.find_more)
        parts = (
            self.picture.rgb.tobytes(),
            b"" if self.depth is None else self.depth.z_m.tobytes(),
            json.dumps(settings).encode(),
        )
        return hashlib.sha256(b"".join(hashlib.sha256(part).digest() for part in parts)).hexdigest()


@dataclass(frozen=True)
class PhotoResult:
    """A reconstruction with its input and its scene.

    Attributes:
        given: The input.
        found: The fitted room, and what was left out.
        made: The scene.
        varied: The same room with the next best models.
        took_s: step -> duration [s].
    """

    given: PhotoInput
    found: FittedRoom
    made: MadeScene
    varied: tuple[RoomVariation, ...]
    took_s: Mapping[str, float]

    @property
    def observation(self) -> Observation:
        """The picture in the level frame."""
        return self.given.observation

    @property
    def floor(self) -> FloorPlane:
        """The floor plane, as measured or as given by the camera's height."""
        return self.given.floor


@dataclass(frozen=True)
class AuxiliaryInputs:
    """Inputs beside the picture.

    Attributes:
        detect: Detector: a file, a network or a model; optional with depth.
        depth: Source of the depth; None for a recording, which has its own, and without depth.
        camera: `hfov=70`, `vfov=55` or a JSON file; by default the recording's calibration or the picture's EXIF.
        frame: Frame of a recording.
        length, board: Sources of the scale, see `executor.photo.geometry.level`.
        camera_height_m: Height of the camera above the floor. It gives the scale to a picture without depth, or to
            depth that a network guesses.
        find_more: Whether objects without a box are searched for; needed with depth if no boxes are given.
    """

    detect: Detector | None = None
    depth: DepthSource | None = None
    camera: str | None = None
    frame: int | None = None
    length: str | None = None
    board: str | None = None
    camera_height_m: float | None = None
    find_more: bool = False


def read_inputs(picture: Path, auxiliary: AuxiliaryInputs) -> PhotoInput:
    """Read and check all inputs of a photograph.

    Args:
        picture: The picture, or a recording (see `executor.photo.inputs.depth`).
        auxiliary: The other inputs.

    Raises:
        PhotoRefused: One of them cannot be used.
        MissingExtra: A library that reads one of them is not installed.
        OSError: A file cannot be read.
        ModelError, AnswersRefused: The model that is asked for boxes gives no usable answer.
    """
    shown, measured, intrinsics = _sensed(picture, auxiliary)
    if auxiliary.detect is None and measured is None:
        hint = "give --boxes, --detector or --model, or --depth, or both"
        raise PhotoRefused("boxes", picture, "has neither boxes nor depths", hint)
    if auxiliary.detect is None and not auxiliary.find_more:
        hint = "give --boxes, --detector or --model, or have things searched for in its depths by --find-more"
        raise PhotoRefused("boxes", picture, "has no boxes", hint)
    # A network's depth belongs to the picture, and is distorted.
    doubts: tuple[str, ...] = ()
    if measured is not None and not measured.depth_distortion:
        doubts = depth_doubts(shown, measured, intrinsics)
    if measured is not None and auxiliary.board is not None:
        measured = scale_by_board(measured, find_board(auxiliary.board, shown, intrinsics))
    if measured is not None and auxiliary.length is not None:
        measured = scale_by_length(measured, intrinsics, read_length(auxiliary.length))
    # A network is slow and a model costs: all other inputs have been read by now, and with depth the floor has been
    # found.
    level: tuple[Observation, FloorPlane] | None = None
    if measured is not None and auxiliary.camera_height_m is not None:
        measured, observation, floor = observe_by_height(shown, measured, intrinsics, auxiliary.camera_height_m)
        level = observation, floor
    elif measured is not None:
        level = observe(shown, measured, intrinsics)
    found = Detections(()) if auxiliary.detect is None else auxiliary.detect(shown)
    if auxiliary.detect is not None and not found.things:
        reasons = "; ".join(f"{one.label}: {one.reason}" for one in found.left_out)
        raise PhotoRefused("nothing", picture, "nothing in it was recognised", reasons)
    if level is None:
        floor = _levelled(shown, intrinsics, found.things, auxiliary)
        level = flat_observation(shown, intrinsics, floor), floor
    return PhotoInput(
        picture.stem,
        shown,
        measured,
        intrinsics,
        found.things,
        *level,
        found.left_out,
        auxiliary.find_more,
        (*doubts, *found.doubts),
    )


def _levelled(
    picture: Photograph, camera: Intrinsics, things: tuple[Detection, ...], auxiliary: AuxiliaryInputs
) -> FloorPlane:
    """Return the floor of a picture without depth."""
    if auxiliary.board is not None:
        return level_by_board(find_board(auxiliary.board, picture, camera))
    if auxiliary.camera_height_m is not None:
        return level_by_height(find_upright(picture, camera), auxiliary.camera_height_m)
    if auxiliary.length is not None:
        return level_by_length(find_upright(picture, camera), camera, read_length(auxiliary.length))
    return level_by_rim(picture, camera, things)


def _sensed(picture: Path, auxiliary: AuxiliaryInputs) -> tuple[Photograph, Depth | None, Intrinsics]:
    if is_capture(picture):
        if auxiliary.depth is not None:
            raise PhotoRefused("depth", picture, "has depths of its own", "leave out --depth and --depth-model")
        capture = read_capture(picture, auxiliary.frame)
        own = capture.camera if auxiliary.camera is None else None
        return capture.picture, capture.depth, own or read_camera(auxiliary.camera, capture.picture)
    if auxiliary.frame is not None:
        raise PhotoRefused("picture", picture, "is one picture", "--frame is for recordings")
    shown = read_picture(picture)
    intrinsics = read_camera(auxiliary.camera, shown)
    return shown, None if auxiliary.depth is None else auxiliary.depth(shown), intrinsics


def reconstruct_scene(
    given: PhotoInput, on_progress: OnSentence = lambda words: None, *, variations: bool = True
) -> PhotoResult:
    """Reconstruct the scene of a photograph.

    Args:
        given: The input.
        on_progress: Called with sentences about the progress.
        variations: Whether the next best models are made rooms of as well.

    Raises:
        PhotoRefused: Nothing is recognised.
    """
    began = time.perf_counter()
    observation, floor = given.observation, given.floor
    for doubt in given.doubts:
        on_progress(doubt)
    walls = () if given.depth is None else find_walls(observation, given.detections)
    walled = time.perf_counter()
    on_progress(f"camera {floor.height_m:.2f} m above the floor, {len(walls)} walls")
    found = reconstruct(
        observation, given.detections, walls, on_progress, floor.spread_share, find_more=given.find_more
    )
    fitted = time.perf_counter()
    _require_things(given, found)
    same_height_m = SAME_HEIGHT_M if observation.is_exact else _ABOUT_M
    found, made = scene_of(found, given.name, _LEAST_BOX_SHARE * observation.z_m.size, same_height_m=same_height_m)
    _require_things(given, found)
    settled = time.perf_counter()
    varied = variations_of(found, given.name) if variations else ()
    took = {
        "walls": walled - began,
        "fitting": fitted - walled,
        "settling": settled - fitted,
        "variations": time.perf_counter() - settled,
    }
    return PhotoResult(given, found, made, varied, took)


def _require_things(given: PhotoInput, found: FittedRoom) -> None:
    """Refuse a room without any object."""
    if not found.things:
        reasons = "; ".join(f"{one.detection.label or 'thing'}: {one.reason}" for one in found.unfitted)
        raise PhotoRefused("nothing", given.picture.source, "nothing in it was recognised", reasons)
