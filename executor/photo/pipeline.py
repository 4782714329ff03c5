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
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from types import MappingProxyType

from executor.photo.errors import PhotoRefused
from executor.photo.fitting.likelihood import Fit
from executor.photo.geometry.level import flat_observation, level_as_given, scale_by_height
from executor.photo.geometry.observation import (
    FloorPlane,
    Observation,
    floor_below,
    levelled,
    planes_below,
    unnamed_top,
)
from executor.photo.geometry.planes import level_planes
from executor.photo.geometry.walls import find_walls
from executor.photo.inputs.annotations import Detection, Detector, LeftOut
from executor.photo.inputs.consistency import depth_doubts
from executor.photo.inputs.depth import DEFAULT_DEPTH_DISTORTION, Depth, DepthSource, is_capture, read_capture
from executor.photo.inputs.picture import (
    UPRIGHT_DEG,
    CameraFacts,
    Intrinsics,
    Photograph,
    read_camera,
    read_facts,
    read_picture,
)
from executor.photo.networks.masks import Masker
from executor.photo.room.reconstruct import FittedRoom, Listener, reconstruct
from executor.photo.scene import MadeScene, RoomVariation, scene_of, variations_of

OnSentence = Callable[[str], None]


@dataclass(frozen=True)
class PhotoInput:
    """Input of a reconstruction.

    Attributes:
        name: Name of the scene.
        picture, camera, detections: As they were read.
        depth: As it was read; None without depth.
        observation, floor: The picture in the level frame, and the floor that levels it.
        left_out: Detections for which the library has no model.
        doubts: Evidence that depth or boxes do not belong to this picture, as sentences.
        origin_sha256: Hash of the input that this one is a correction of; empty where it is none.
    """

    name: str
    picture: Photograph
    depth: Depth | None
    camera: Intrinsics
    detections: tuple[Detection, ...]
    observation: Observation
    floor: FloorPlane
    left_out: tuple[LeftOut, ...] = ()
    doubts: tuple[str, ...] = ()
    origin_sha256: str = ""

    @property
    def sha256(self) -> str:
        """Hash of everything that determines a reconstruction, before it was corrected."""
        if self.origin_sha256:
            return self.origin_sha256
        level = self.floor.up.tolist(), self.floor.height_m, self.observation.depth_distortion
        settings = (self.name, asdict(self.camera), [one.to_json() for one in self.detections], level)
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
        detect: Detector: a file, a network or a model.
        depth: Source of the depth; None for a recording, which has its own, and without depth.
        camera: `hfov=70`, `vfov=55` or a JSON file; by default the recording's calibration, the picture's EXIF, or what
            a network guesses with the depth.
        frame: Frame of a recording.
        facts: What is known of the camera. The tilt levels a picture without depth. The height gives the scale to a
            picture without depth and to guessed depth, and the place of a floor that measured depth does not show.
        masks: Adds masks to detections.
    """

    detect: Detector | None = None
    depth: DepthSource | None = None
    camera: str | None = None
    frame: int | None = None
    facts: CameraFacts = field(default_factory=CameraFacts)
    masks: Masker | None = None


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
    facts = read_facts(auxiliary.camera, auxiliary.facts)
    shown, measured, intrinsics = _sensed(picture, auxiliary, facts)
    assert auxiliary.detect is not None, "refused before"
    # A network's depth belongs to the picture, and is distorted.
    doubts: tuple[str, ...] = ()
    if measured is not None and not measured.depth_distortion:
        measured, doubts = depth_doubts(shown, measured, intrinsics)
        if measured.of_px is not None:
            sizes = " x ".join(map(str, measured.of_px)), " x ".join(map(str, shown.size_px))
            doubts += (f"the depth of {sizes[0]} pixels is scaled to {sizes[1]}: what is thin or small may be lost",)
    # A network is slow and a model costs: all other inputs have been read by now, and a floor too far below is refused.
    planes = None if measured is None else level_planes(measured, intrinsics, facts.up)
    if planes is not None:
        floor_below(picture, planes, facts=facts)
    found = auxiliary.detect(shown)
    if not found.things:
        reasons = "; ".join(f"{one.label}: {one.reason}" for one in found.left_out)
        raise PhotoRefused("nothing", picture, "nothing in it was recognised", reasons)
    if auxiliary.masks is not None:
        found = auxiliary.masks(shown, found)
    things = found.things
    if measured is None:
        floor = _levelled(shown.source, auxiliary, facts)
        observation = flat_observation(shown, intrinsics, floor)
    else:
        if facts.up is None:
            planes = planes_below(planes, measured, intrinsics, things)
        is_guess = measured.depth_distortion > 0.0
        if is_guess and planes is not None and facts.height_m is not None:
            measured, floor = scale_by_height(measured, floor_below(picture, planes, things), facts.height_m)
        else:
            floor = floor_below(picture, planes, things, facts)
        observation = levelled(shown, measured, intrinsics, floor)
        top = unnamed_top(planes, floor, things)
        things = things if top is None else (*things, top)
    return PhotoInput(
        picture.stem,
        shown,
        measured,
        intrinsics,
        things,
        observation,
        floor,
        found.left_out,
        (*doubts, *found.doubts),
    )


def _levelled(picture: Path, auxiliary: AuxiliaryInputs, facts: CameraFacts) -> FloorPlane:
    """Return the floor of a picture without depth."""
    if abs(facts.roll_deg or 0.0) > UPRIGHT_DEG:
        problem = f"is {facts.roll_deg:g}, and there is no depth"
        raise PhotoRefused("camera", "--roll", problem, "turn the picture and its boxes upright")
    if facts.up is None or facts.height_m is None:
        raise _incomplete(picture, auxiliary, facts)
    return level_as_given(facts.up, facts.height_m)


def _incomplete(
    picture: Path,
    auxiliary: AuxiliaryInputs,
    facts: CameraFacts,
    *,
    no_lens: str = "",
) -> PhotoRefused:
    """Return one refusal with everything that a picture lacks, and the shortest command.

    Args:
        picture: Its file.
        auxiliary, facts: What was given.
        no_lens: Why its lens is unknown.
    """
    lacks = {}
    if auxiliary.detect is None:
        lacks["--boxes BOXES.json"] = "boxes with names (or --detector or --model)"
    if no_lens:
        lacks["--camera hfov=DEGREES"] = f"its lens ({no_lens}; a phone's main camera has about 65)"
    if auxiliary.depth is None:
        if facts.up is None:
            lacks["--tilt DEGREES"] = "how far the camera looks down"
        if facts.height_m is None:
            lacks["--camera-height-m METRES"] = "how high above the floor the camera was"
    problem = f"{'this is' if len(lacks) == 1 else f'{len(lacks)} things are'} missing: {'; '.join(lacks.values())}"
    is_bare = auxiliary == AuxiliaryInputs()
    command = f"scene2demo photo {picture.name} {' '.join(lacks)} --out DIR"
    hint = f"the shortest command is: {command}" if is_bare else f"add {' '.join(lacks)}"
    depth = "" if auxiliary.depth is not None else " (--depth FILE gives tilt and height as well)"
    return PhotoRefused("missing", picture, problem, f"{hint}{depth}")


def _sensed(
    picture: Path, auxiliary: AuxiliaryInputs, facts: CameraFacts
) -> tuple[Photograph, Depth | None, Intrinsics]:
    if is_capture(picture):
        if auxiliary.depth is not None:
            raise PhotoRefused("depth", picture, "has depths of its own", "leave out --depth and --depth-model")
        if auxiliary.detect is None:
            raise PhotoRefused("boxes", picture, "has no boxes", "give --boxes, --detector or --model")
        capture = read_capture(picture, auxiliary.frame)
        own = capture.camera if auxiliary.camera is None else None
        camera = own or read_camera(auxiliary.camera, capture.picture)
        return capture.picture, _of_kind(capture.depth, facts), camera
    if auxiliary.frame is not None:
        raise PhotoRefused("picture", picture, "is one picture", "--frame is for recordings")
    shown = read_picture(picture)
    try:
        intrinsics = read_camera(auxiliary.camera, shown)
    except PhotoRefused as problem:
        # Where nothing gives the camera, a network that guesses depth may guess it.
        asked = auxiliary.depth if auxiliary.camera is None and auxiliary.detect is not None else None
        guessed = None if asked is None else asked(shown, None)
        if guessed is not None and guessed.camera is not None:
            return shown, _of_kind(guessed, facts), guessed.camera
        if auxiliary.camera is not None:
            raise
        raise _incomplete(picture, auxiliary, facts, no_lens=problem.problem) from problem
    if auxiliary.detect is None:
        raise _incomplete(picture, auxiliary, facts)
    depth = None if auxiliary.depth is None else _of_kind(auxiliary.depth(shown, intrinsics), facts)
    return shown, depth, intrinsics


def _of_kind(depth: Depth, facts: CameraFacts) -> Depth:
    """Return a depth as people say who made it."""
    if facts.depth_kind != "guessed" or depth.depth_distortion:
        return depth
    return replace(depth, depth_distortion=DEFAULT_DEPTH_DISTORTION, source=f"{depth.source}, guessed by a network")


def reconstruct_scene(
    given: PhotoInput,
    on_progress: OnSentence = lambda words: None,
    *,
    variations: bool = True,
    on_first: Callable[[PhotoResult], None] | None = None,
    on_fitted: Callable[[PhotoResult], None] = lambda result: None,
    kept: Mapping[int, Fit] = MappingProxyType({}),
) -> PhotoResult:
    """Reconstruct the scene of a photograph; after Ctrl-C, with `on_first`, the scene of what is fitted by then.

    Args:
        given: The input.
        on_progress: Called with sentences about the progress.
        variations: Whether the next best models are made rooms of as well.
        on_first: Called with a first scene of rough fits, before anything is fitted closely.
        on_fitted: Called with the result but for its variations.
        kept: index of a detection -> its fit, which stays as it is.

    Raises:
        PhotoRefused: Nothing is recognised.
        KeyboardInterrupt: Ctrl-C before anything is fitted, or without `on_first`.
    """
    began = time.perf_counter()
    for doubt in given.doubts:
        on_progress(doubt)
    walls = () if given.depth is None else find_walls(given.observation, given.detections)
    walled = time.perf_counter()
    on_progress(f"camera {given.floor.height_m:.2f} m above the floor ({given.floor.source}), {len(walls)} walls")

    def show_first(room: FittedRoom) -> None:
        if room.things and on_first is not None:
            on_first(PhotoResult(given, *_scene_of(given, room), (), {"first scene": time.perf_counter() - began}))

    listener = Listener(on_progress, None if on_first is None else show_first)
    found = reconstruct(given.observation, given.detections, walls, listener, given.floor.spread_share, kept)
    fitted = time.perf_counter()
    _require_things(given, found)
    try:
        found, made = _scene_of(given, found)
    except KeyboardInterrupt:
        if on_first is None:
            raise
        found, made = replace(found, interrupted=True), MadeScene(None, "interrupted before it settled", (), {})
    _require_things(given, found)
    took = {"walls": walled - began, "fitting": fitted - walled, "settling": time.perf_counter() - fitted}
    result = PhotoResult(given, found, made, (), took)
    on_fitted(result)
    return _varied(result, keeps=on_first is not None) if variations and not found.interrupted else result


def _scene_of(given: PhotoInput, room: FittedRoom) -> tuple[FittedRoom, MadeScene]:
    return scene_of(room, given.name)


def _varied(result: PhotoResult, *, keeps: bool) -> PhotoResult:
    """Return a result with its variations; after Ctrl-C without them, if what is fitted is kept."""
    began = time.perf_counter()
    try:
        varied = variations_of(result.found, result.given.name)
    except KeyboardInterrupt:
        if not keeps:
            raise
        return replace(result, found=replace(result.found, interrupted=True))
    return replace(result, varied=varied, took_s={**result.took_s, "variations": time.perf_counter() - began})


def _require_things(given: PhotoInput, found: FittedRoom) -> None:
    """Refuse a room without any object."""
    if not found.things:
        if found.interrupted:
            raise KeyboardInterrupt
        reasons = "; ".join(f"{one.detection.label or 'thing'}: {one.reason}" for one in found.unfitted)
        raise PhotoRefused("nothing", given.picture.source, "nothing in it was recognised", reasons)
