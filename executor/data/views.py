"""Videos of a unit, as its recording requests them: one per view and kind, and the camera poses.

    <view>.mp4                H.264, yuv420p, every other picture a key frame: any player decodes it and seeks in it
    <view>.depth.mkv          FFV1, 16-bit grey, lossless: millimetres along the camera's axis, 0 for no depth
    <view>.segmentation.mkv   the same with the number of the visible body; `unit.json` has the legend

Picture i belongs to row i of the samples. Pictures are drawn from packed states. They can be drawn again, larger or
from elsewhere, without simulating. Equal states give equal bytes with the same renderer, encoder and processor.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import asdict, dataclass, replace
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from executor.data.units import DemoUnit, Recording
from executor.geometry import pose_vector
from executor.sim.render.appearance import Surfaces, panorama_of, perturb_cameras, sample_lights
from executor.sim.render.cameras import Camera, camera_json, cameras_for
from executor.sim.render.frames import VideoFailed
from executor.sim.render.home import home_of
from executor.sim.render.stage import DAYLIGHT, Lights, SceneRenderer, Stage
from executor.system.extras import require
from executor.system.vulkan import RendererNotFound, find_renderer
from oag import Scene, Task

DEPTH, SEGMENTATION = "depth", "segmentation"
POSES = "camera_pose_"
"""Prefix of the arrays of camera poses, one per view."""

_SHADOW_MAP_PX = 512  # A texel of 1 cm, like a pixel; half the time of twice the resolution.
_X264 = {"crf": "20", "preset": "veryfast", "g": "2", "bf": "0"}
_LARGEST = {"max_pixels": str(2 * 1024 * 1024)}  # Twice the pixels of the largest recordable picture.
_FFV1 = {"level": "3", "g": "1", "coder": "1", "context": "0", "slices": "4"}


@dataclass(frozen=True, slots=True)
class RenderedViews:
    """Rendered views.

    Attributes:
        described: Their description in `unit.json`.
        poses: Name -> (N, 7) camera position and quaternion w x y z in the world; x right, y down, z ahead.
    """

    described: Mapping[str, Any]
    poses: Mapping[str, NDArray[np.float32]]


@dataclass(frozen=True, slots=True)
class Look:
    """Cameras, lights and surfaces of a scene.

    Attributes:
        cameras: The cameras.
        lights: The lights.
        surfaces: Materials of things; by default each has its asset's colours.
    """

    cameras: Sequence[Camera]
    lights: Lights = DAYLIGHT
    surfaces: Surfaces | None = None


def look_of(unit: DemoUnit, scene: Scene, task: Task) -> Look:
    """Return a unit's look: drawn where its variation says so, and otherwise the default.

    Args:
        unit: Unit of the pictures.
        scene: The concrete scene.
        task: Its objects have to be visible in the global view.
    """
    varies, (width, height) = unit.variation, unit.recording.size
    cameras = cameras_for(scene, unit.recording.views, aspect=width / height, task=task, height_px=height)
    home = home_of(scene, unit.looks("surfaces") if varies.surfaces else None)
    surfaces = home.surfaces if unit.recording.home else replace(home.surfaces, walls=(), replaced=())
    return Look(
        perturb_cameras(unit.looks("cameras"), cameras, scene) if varies.cameras else cameras,
        sample_lights(unit.looks("lights")) if varies.lights else home.lights if unit.recording.home else DAYLIGHT,
        surfaces if unit.recording.home or varies.surfaces else None,
    )


def render_unit_views(
    scene_renderer: SceneRenderer,
    folder: Path,
    unit: DemoUnit,
    scene: Scene,
    task: Task,
    time_s: NDArray[np.float64],
    states: Sequence[bytes],
) -> RenderedViews:
    """Render a unit's states by its recording and variation; arguments and errors as for `render_views` and `look_of`.

    Args:
        time_s: (N,) time of each state [s].
    """
    # Samples are whole physics steps apart, which may differ from the requested rate.
    each_s = float(time_s[-1] - time_s[0]) / max(len(time_s) - 1, 1)
    rate = Fraction(1.0 / each_s if each_s else unit.recording.rate_hz).limit_denominator(1000)
    return render_views(scene_renderer, folder, scene, states, look_of(unit, scene, task), unit.recording, rate)


def render_views(
    scene_renderer: SceneRenderer,
    folder: Path,
    scene: Scene,
    states: Sequence[bytes],
    look: Look,
    recording: Recording,
    rate: Fraction,
) -> RenderedViews:
    """Render states into videos in a folder.

    Args:
        scene_renderer: The renderer.
        folder: An existing folder.
        scene: Concrete scene of the states.
        states: Packed physical states, one per picture.
        look: Cameras, lights and surfaces.
        recording: Sizes and kinds of pictures.
        rate: Pictures per second.

    Raises:
        VideoFailed: An encoder fails.
        MissingExtra: PyAV is not installed.
        OSError: The folder cannot be written.
    """
    names = [camera.name for camera in look.cameras]
    poses = {name: np.empty((len(states), 7), np.float32) for name in names}
    with ExitStack() as open_files:
        stage = open_files.enter_context(
            scene_renderer.stage(
                scene,
                look.cameras,
                dict.fromkeys(names, recording.size),
                shadow_map_px=_SHADOW_MAP_PX,
                lights=look.lights,
                materials=look.surfaces,
                panorama=panorama_of(look.lights),
            )
        )
        tracks = {
            (name, kind): open_files.enter_context(
                video_encoder(footage_path(folder, name, kind), recording.size, rate)
            )
            for name in names
            for kind in kinds(recording)
        }
        for row, state in enumerate(states):
            images = stage.sense(state, depth=recording.depth, segmentation=recording.segmentation)
            for name, sensed in images.items():
                poses[name][row] = pose_vector(stage.T_world_camera(name))
                tracks[name, ""].add(sensed.color)
                if sensed.depth_mm is not None:
                    tracks[name, DEPTH].add(sensed.depth_mm)
                if sensed.segmentation is not None:
                    tracks[name, SEGMENTATION].add(sensed.segmentation)
        described = {
            "renderer": scene_renderer.renderer,
            "rate_hz": float(rate),
            "count": len(states),
            **_described_by(stage, look, recording),
        }
    return RenderedViews(described, {f"{POSES}{name}": poses[name] for name in names})


def _described_by(stage: Stage, look: Look, recording: Recording) -> dict[str, Any]:
    """Return what a reader of the pictures has to know of lights, surfaces, cameras and segmentation."""
    described: dict[str, Any] = {
        "depth_unit": "mm",
        "lights": asdict(look.lights),
        "surfaces": None if look.surfaces is None else look.surfaces.to_json(),
        "views": {
            # The matrix that drew the pictures, which the renderer has rounded.
            camera.name: camera_json(camera, recording.size, stage.intrinsics(camera.name))
            for camera in look.cameras
        },
    }
    if recording.segmentation:
        legend = stage.legend()
        described["legend"] = {str(k): {"object": legend[k].owner, "link": legend[k].link} for k in sorted(legend)}
    return described


def check_drawable() -> None:
    """Refuse a machine that cannot render and encode pictures.

    Raises:
        RendererNotFound: There is no renderer.
        MissingExtra: PyAV is not installed.
    """
    require("av", "data")
    if not (renderer := find_renderer()):
        raise RendererNotFound.of(renderer)


def kinds(recording: Recording) -> tuple[str, ...]:
    """Return the kinds of pictures of each view: "" for colours, and further recorded ones."""
    return ("", *((DEPTH,) if recording.depth else ()), *((SEGMENTATION,) if recording.segmentation else ()))


def footage_path(folder: Path, view: str, kind: str = "") -> Path:
    """Return the path of a view's pictures of a kind ("" for colours) in a unit's folder."""
    return folder / (f"{view}.{kind}.mkv" if kind else f"{view}.mp4")


def pixels_of(video: Path) -> str:
    """Return the pixel format of a unit's video, as PyAV names it."""
    return "rgb24" if video.suffix == ".mp4" else "gray16le"


def pictures(path: Path) -> Iterator[NDArray[Any]]:
    """Yield the pictures of a unit's video: (H, W, 3) uint8 RGB, or (H, W) uint16 of depth and segmentation.

    Raises:
        VideoFailed: It is unreadable.
        MissingExtra: PyAV is not installed.
    """
    with opened_video(path) as (source, stream):
        stream.codec_context.thread_count = 1
        for frame in source.decode(stream):
            yield frame.to_ndarray(format=pixels_of(path))


@contextmanager
def opened_video(video: Path) -> Iterator[tuple[Any, Any]]:
    """Open a video file and its one stream; pictures larger than recordable ones are not decoded.

    Raises:
        VideoFailed: It is unreadable.
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


class VideoTrack:
    """Video file that is being written."""

    def __init__(self, container: Any, stream: Any, pixels: str, frame: Any) -> None:
        self._container, self._stream, self._pixels, self._frame = container, stream, pixels, frame

    def add(self, picture: NDArray[Any]) -> None:
        """Add the next picture."""
        self._container.mux(self._stream.encode(self._frame.from_ndarray(picture, format=self._pixels)))


@contextmanager
def video_encoder(path: Path, size: tuple[int, int], rate: Fraction) -> Iterator[VideoTrack]:
    """Open a new video for pictures; its suffix selects colours, or (H, W) 16-bit numbers.

    Args:
        path: The file, `.mp4` or `.mkv`, in an existing folder.
        size: Width and height of the pictures [pixels].
        rate: Pictures per second.

    Raises:
        VideoFailed: The encoder fails.
        OSError: The file cannot be written.
    """
    av: Any = require("av", "data")
    colours = path.suffix == ".mp4"
    codec, pixels, options = ("libx264", "yuv420p", _X264) if colours else ("ffv1", "gray16le", _FFV1)
    # Without "bitexact" a file contains its time and library.
    settings = {"fflags": "+bitexact", **({"movflags": "faststart"} if colours else {})}
    try:
        with av.open(str(path), "w", format="mp4" if colours else "matroska", options=settings) as container:
            stream = container.add_stream(codec, rate=rate)
            stream.width, stream.height = size
            stream.pix_fmt, stream.options = pixels, options
            # The number of threads changes the bytes.
            stream.codec_context.thread_count = 1
            yield VideoTrack(container, stream, "rgb24" if colours else pixels, av.VideoFrame)
            container.mux(stream.encode())
    except av.FFmpegError as problem:
        if isinstance(problem, OSError):
            raise OSError(problem.errno, problem.strerror, str(path)) from problem
        raise VideoFailed(f"the video {path} could not be encoded: {problem}") from problem
