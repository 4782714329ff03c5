"""Pictures of a unit, as its recording asks for them: a video a view and kind, and where each camera was.

    <view>.mp4                H.264, yuv420p, every other picture complete: any player decodes it, and jumps in it
    <view>.depth.mkv          FFV1, 16-bit grey, without loss: millimetres along the camera's axis, 0 for nothing
    <view>.segmentation.mkv   the same of the number of the body that is seen; `unit.json` says which body it is

Picture i belongs to row i of the samples. They are drawn from packed states, so that they can be drawn again, larger or
from elsewhere, without simulating. The same states give the same bytes with the same renderer, encoder and processor.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import asdict, dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from executor.datasets.units import DemoUnit, Recording
from executor.geometry import pose_vector
from executor.machine.extras import require
from executor.machine.vulkan import RendererNotFound, find_renderer
from executor.pictures.appearance import drawn_lights, strayed_cameras
from executor.pictures.backdrop import panorama_of
from executor.pictures.cameras import Camera, camera_json
from executor.pictures.overview import cameras_for
from executor.pictures.stage import DAYLIGHT, Draughtsman, Lights
from executor.pictures.surfaces import Surfaces, drawn_surfaces
from executor.pictures.video import VideoFailed
from oag import Scene, Task

DEPTH, SEGMENTATION = "depth", "segmentation"
POSES = "camera_pose_"
"""Begin of the names of the arrays of camera poses, one a view."""

_SHADOW_MAP_PX = 512  # A texel of a centimetre, as small as a pixel's: half the time of one twice as fine.
_X264 = {"crf": "20", "preset": "veryfast", "g": "2", "bf": "0"}
_LARGEST = {"max_pixels": str(2 * 1024 * 1024)}  # Twice what the largest picture has that a recording asks for.
_FFV1 = {"level": "3", "g": "1", "coder": "1", "context": "0", "slices": "4"}


@dataclass(frozen=True, slots=True)
class Filmed:
    """What was drawn.

    Attributes:
        described: What `unit.json` says of it.
        poses: Name -> (N, 7) position and quaternion w x y z of a camera in the world, x right, y down, z ahead.
    """

    described: Mapping[str, Any]
    poses: Mapping[str, NDArray[np.float32]]


@dataclass(frozen=True, slots=True)
class Look:
    """How a scene is looked at.

    Attributes:
        cameras: From where.
        lights: In what light.
        surfaces: What things are made of; by default each has its asset's colours.
    """

    cameras: Sequence[Camera]
    lights: Lights = DAYLIGHT
    surfaces: Surfaces | None = None


def look_of(unit: DemoUnit, scene: Scene, task: Task) -> Look:
    """Returns how a unit is looked at: what its variation draws, and else the usual.

    Args:
        unit: Whose pictures they are.
        scene: The concrete scene.
        task: What the global camera is to show.
    """
    varies, (width, height) = unit.variation, unit.recording.size
    cameras = cameras_for(scene, unit.recording.views, aspect=width / height, task=task)
    return Look(
        strayed_cameras(unit.looks("cameras"), cameras, scene) if varies.cameras else cameras,
        drawn_lights(unit.looks("lights")) if varies.lights else DAYLIGHT,
        drawn_surfaces(unit.looks("surfaces"), scene) if varies.surfaces else None,
    )


def film_unit(
    draughtsman: Draughtsman,
    folder: Path,
    unit: DemoUnit,
    scene: Scene,
    task: Task,
    time_s: NDArray[np.float64],
    states: Sequence[bytes],
) -> Filmed:
    """Draws a unit's states as its recording and variation say; arguments and errors as for `film` and `look_of`.

    Args:
        time_s: (N,) when each state was.
    """
    # Samples are whole physics steps apart, which is not always what was asked for.
    each_s = float(time_s[-1] - time_s[0]) / max(len(time_s) - 1, 1)
    rate = Fraction(1.0 / each_s if each_s else unit.recording.rate_hz).limit_denominator(1000)
    return film(draughtsman, folder, scene, states, look_of(unit, scene, task), unit.recording, rate)


def film(
    draughtsman: Draughtsman,
    folder: Path,
    scene: Scene,
    states: Sequence[bytes],
    look: Look,
    recording: Recording,
    rate: Fraction,
) -> Filmed:
    """Draws states into videos in a folder.

    Args:
        draughtsman: What draws.
        folder: It exists.
        scene: The concrete scene that the states are of.
        states: Packed physical states, one a picture.
        look: Cameras, lights and surfaces.
        recording: Sizes and kinds of pictures.
        rate: Pictures a second.

    Raises:
        VideoFailed: An encoder refuses.
        MissingExtra: PyAV is not installed.
        OSError: The folder cannot be written.
    """
    names = [camera.name for camera in look.cameras]
    poses = {name: np.empty((len(states), 7), np.float32) for name in names}
    with ExitStack() as open_files:
        stage = open_files.enter_context(
            draughtsman.stage(
                scene,
                look.cameras,
                dict.fromkeys(names, recording.size),
                shadow_map_px=_SHADOW_MAP_PX,
                lights=look.lights,
                painting=look.surfaces,
                panorama=panorama_of(look.lights),
            )
        )
        tracks = {
            (name, kind): open_files.enter_context(encoded(footage_path(folder, name, kind), recording.size, rate))
            for name in names
            for kind in kinds(recording)
        }
        for row, state in enumerate(states):
            seen = stage.sense(state, depth=recording.depth, segmentation=recording.segmentation)
            for name, sensed in seen.items():
                poses[name][row] = pose_vector(stage.T_world_camera(name))
                tracks[name, ""].add(sensed.color)
                if sensed.depth_mm is not None:
                    tracks[name, DEPTH].add(sensed.depth_mm)
                if sensed.segmentation is not None:
                    tracks[name, SEGMENTATION].add(sensed.segmentation)
        described: dict[str, Any] = {
            "renderer": draughtsman.renderer,
            "rate_hz": float(rate),
            "count": len(states),
            "depth_unit": "mm",
            "lights": asdict(look.lights),
            "surfaces": None if look.surfaces is None else look.surfaces.to_json(),
            "views": {
                camera.name: {**camera_json(camera, recording.size), "intrinsics": stage.intrinsics(camera.name)}
                for camera in look.cameras
            },
        }
        if recording.segmentation:
            legend = stage.legend()
            described["legend"] = {str(k): {"object": legend[k].owner, "link": legend[k].link} for k in sorted(legend)}
    return Filmed(described, {f"{POSES}{name}": poses[name] for name in names})


def check_drawable() -> None:
    """Returns when pictures can be drawn and encoded here.

    Raises:
        RendererNotFound: Nothing can draw.
        MissingExtra: PyAV is not installed.
    """
    require("av", "data")
    if not (renderer := find_renderer()):
        raise RendererNotFound.of(renderer)


def kinds(recording: Recording) -> tuple[str, ...]:
    """Returns the kinds of pictures of each view: "" for colours, and what else is recorded."""
    return ("", *((DEPTH,) if recording.depth else ()), *((SEGMENTATION,) if recording.segmentation else ()))


def footage_path(folder: Path, view: str, kind: str = "") -> Path:
    """Returns where a view's pictures of a kind ("" for colours) lie in a unit's folder."""
    return folder / (f"{view}.{kind}.mkv" if kind else f"{view}.mp4")


def pixels_of(video: Path) -> str:
    """Returns what a picture of a video of a unit is made of, as PyAV names it."""
    return "rgb24" if video.suffix == ".mp4" else "gray16le"


def pictures(path: Path) -> Iterator[NDArray[Any]]:
    """Yields the pictures of a video of a unit: (H, W, 3) uint8 RGB, or (H, W) uint16 of depth and segmentation.

    Raises:
        VideoFailed: It cannot be read.
        MissingExtra: PyAV is not installed.
    """
    with opened_video(path) as (source, stream):
        stream.codec_context.thread_count = 1
        for frame in source.decode(stream):
            yield frame.to_ndarray(format=pixels_of(path))


@contextmanager
def opened_video(video: Path) -> Iterator[tuple[Any, Any]]:
    """Give a video file and its one stream; pictures larger than any that is recorded are not decoded.

    Raises:
        VideoFailed: It cannot be read.
        MissingExtra: PyAV is not installed.
    """
    av: Any = require("av", "data")
    try:
        with av.open(str(video), options=_LARGEST) as source:
            if not source.streams.video:
                raise VideoFailed(f"{video} has no pictures")
            stream = source.streams.video[0]
            stream.codec_context.options = _LARGEST
            yield source, stream
    except av.FFmpegError as problem:
        raise VideoFailed(f"{video} cannot be read: {problem}") from problem


class Track:
    """A video that is being written."""

    def __init__(self, container: Any, stream: Any, pixels: str, frame: Any) -> None:
        self._container, self._stream, self._pixels, self._frame = container, stream, pixels, frame

    def add(self, picture: NDArray[Any]) -> None:
        """Adds the next picture."""
        self._container.mux(self._stream.encode(self._frame.from_ndarray(picture, format=self._pixels)))


@contextmanager
def encoded(path: Path, size: tuple[int, int], rate: Fraction) -> Iterator[Track]:
    """Gives a new video to add pictures to; its name says whether they are colours, or (H, W) numbers of 16 bits.

    Args:
        path: The file, `.mp4` or `.mkv`; its folder exists.
        size: Width and height of the pictures.
        rate: Pictures a second.

    Raises:
        VideoFailed: The encoder refuses.
        OSError: The file cannot be written.
    """
    av: Any = require("av", "data")
    colours = path.suffix == ".mp4"
    codec, pixels, options = ("libx264", "yuv420p", _X264) if colours else ("ffv1", "gray16le", _FFV1)
    # Without "bitexact" a file says when it was made, and with which library.
    settings = {"fflags": "+bitexact", **({"movflags": "faststart"} if colours else {})}
    try:
        with av.open(str(path), "w", format="mp4" if colours else "matroska", options=settings) as container:
            stream = container.add_stream(codec, rate=rate)
            stream.width, stream.height = size
            stream.pix_fmt, stream.options = pixels, options
            # How the work is shared among threads shows in the bytes.
            stream.codec_context.thread_count = 1
            yield Track(container, stream, "rgb24" if colours else pixels, av.VideoFrame)
            container.mux(stream.encode())
    except av.FFmpegError as problem:
        if isinstance(problem, OSError):
            raise OSError(problem.errno, problem.strerror, str(path)) from problem
        raise VideoFailed(f"the video {path} could not be encoded: {problem}") from problem
