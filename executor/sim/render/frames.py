"""Pictures of a rollout: drawn afterwards by worker processes, kept as memory-mapped arrays, shown as an MP4 video.

A job's folder has the scene, the cameras and the packed states; `executor.sim.render.worker` draws it. The video shows
the overview large, the robot's two views at its side, and a caption above them.

Source: the paper's L_j = min(ceil(t_j / p_2), 6) key frames of a step, where t_j is an action's duration and p_2 the
sampling interval.
"""

from __future__ import annotations

import json
import math
import os
import threading
from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import nullcontext
from dataclasses import asdict, dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.lib.format import open_memmap
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from bddl.errors import Scene2DemoError
from bddl.files import atomic_path
from executor.geometry import Array, transform_from_quaternion
from executor.records import Caption, Rollout, StepRecord, Trajectory
from executor.sim.render.cameras import VIEWS, Camera, Solids, cameras_for, following
from executor.system import vulkan
from executor.system.extras import require
from executor.system.progress import OnProgress
from executor.system.workers import WorkerDied, WorkerProcess
from oag import Scene, Task

Picture = NDArray[np.uint8]
GLOBAL_FACTOR = 2
"""The overview is drawn this many times larger than the robot's own views: people watch it, and details are small."""

MOST_FRAMES = 6  # The paper's.
SAMPLING_INTERVAL_S = 1.0  # The paper's p_2.


@dataclass(frozen=True, slots=True)
class Frames:
    """Pictures of all views of a rollout.

    Attributes:
        views: View name -> (N, H, W, 3) uint8 RGB; row i belongs to row i of the trajectory.
        size: Width and height of the robot's own views.
        overview: (N, 4, 4) poses of the overview, which follows the task.
    """

    views: Mapping[str, Picture]
    size: tuple[int, int]
    renderer: str = ""
    overview: Array | None = None

    @property
    def count(self) -> int:
        """Number of pictures of each view."""
        return min((len(pictures) for pictures in self.views.values()), default=0)

    def at_size(self, view: str, indices: slice | None = None) -> Picture:
        """Return a view's pictures at the common size; larger ones are averaged down over whole blocks of pixels.

        Args:
            indices: Which pictures; all of them by default.
        """
        pictures = self.views[view][indices or slice(None)]
        return shrink(pictures, pictures.shape[2] // self.size[0])


def view_size(view: str, size: tuple[int, int]) -> tuple[int, int]:
    """Return the width and height at which a view is drawn, given those of the robot's own views."""
    factor = GLOBAL_FACTOR if view == "global" else 1
    return size[0] * factor, size[1] * factor


def cameras_of(scene: Scene, task: Task, views: Iterable[str], size: tuple[int, int]) -> tuple[Camera, ...]:
    """Return the cameras of a rollout's pictures, given the size of the robot's own views."""
    height_px = view_size("global", size)[1]
    return cameras_for(scene, views, aspect=size[0] / size[1], task=task, height_px=height_px)


def frames_path(folder: Path, view: str) -> Path:
    """Return where a view's array lies in a job's folder."""
    return folder / f"{view}.npy"


def shrink(pictures: Picture, factor: int) -> Picture:
    """Return (N, H, W, 3) pictures averaged over blocks of factor x factor pixels; factor 1 changes nothing."""
    if factor <= 1:
        return pictures
    count, height, width, channels = pictures.shape
    smaller = np.empty((count, height // factor, width // factor, channels), dtype=np.uint8)
    for index, picture in enumerate(pictures):
        blocks = picture.reshape(height // factor, factor, width // factor, factor, channels)
        smaller[index] = (blocks.sum(axis=(1, 3), dtype=np.uint32) + factor * factor // 2) // (factor * factor)
    return smaller


def step_samples(trajectory: Trajectory, step: StepRecord) -> tuple[int, ...]:
    """Return the indices of the samples that were recorded while a step ran, in order."""
    mask = (trajectory.subtask == step.subtask) & (trajectory.step == step.step)
    return tuple(int(index) for index in np.flatnonzero(mask))


def frame_count(duration_s: float, interval_s: float = SAMPLING_INTERVAL_S) -> int:
    """Return L_j: how many pictures an action of a duration gets, from 1 to 6."""
    # A duration that is a whole number of intervals must not gain a picture by rounding.
    return max(1, min(math.ceil(duration_s / interval_s - 1e-9), MOST_FRAMES))


def key_samples(trajectory: Trajectory, step: StepRecord, interval_s: float = SAMPLING_INTERVAL_S) -> tuple[int, ...]:
    """Return the indices of the samples that stand for a step; none when it ended between two samples.

    The last sample is always among them, since it shows the result. With two or more, the first one is as well, so that
    the change from beginning to end is visible.
    """
    samples = step_samples(trajectory, step)
    if not samples:
        return ()
    count = min(frame_count(step.end_s - step.start_s, interval_s), len(samples))
    if count == 1:
        return (samples[-1],)
    return tuple(samples[round(place)] for place in np.linspace(0, len(samples) - 1, count))


Font = ImageFont.FreeTypeFont | ImageFont.ImageFont
SPEED = 2.0
"""How many times faster than real time a video plays."""

_BAR_PX = 56
_BAR_COLOR = (24, 26, 31)
_TITLE_COLOR = (240, 241, 244)
_DETAIL_COLOR = (168, 173, 184)
_ACCENT_COLOR = (88, 166, 255)
_QUALITY = "23"


class VideoFailed(Scene2DemoError):
    """The video could not be encoded."""

    exit_code = 1


def write_video(
    path: Path | str,
    frames: Frames,
    captions: Sequence[Caption],
    *,
    rate_hz: float = 10.0,
    speed: float = SPEED,
    on_progress: OnProgress | None = None,
) -> Path:
    """Write an H.264 MP4 that browsers and players open, and return its path.

    Args:
        rate_hz: Recorded samples a second of simulated time.
        speed: How many times faster than real time it plays.
        on_progress: Called with the number of encoded pictures, and the total.

    Raises:
        ValueError: When there are no pictures, or captions and pictures differ in number.
    """
    av: Any = require("av", "data")

    if frames.count == 0 or frames.count != len(captions):
        raise ValueError(f"expected one caption for each of {frames.count} pictures, got {len(captions)}")
    composer = Composer(frames)
    with atomic_path(Path(path)) as temporary:
        try:
            with av.open(str(temporary), "w", format="mp4", options={"movflags": "faststart"}) as container:
                rate = Fraction(rate_hz * speed).limit_denominator(1000)
                stream = container.add_stream("libx264", rate=rate)
                stream.width, stream.height = composer.size
                stream.pix_fmt = "yuv420p"
                stream.options = {"crf": _QUALITY, "preset": "veryfast", "g": "40"}
                for index, caption in enumerate(captions):
                    picture = av.VideoFrame.from_ndarray(composer.compose(index, caption), format="rgb24")
                    for packet in stream.encode(picture):
                        container.mux(packet)
                    if on_progress is not None:
                        on_progress(index + 1, len(captions))
                for packet in stream.encode():
                    container.mux(packet)
        except av.FFmpegError as error:
            raise VideoFailed(f"the video {path} could not be encoded: {error}") from error
    return Path(path)


class Composer:
    """Puts the views of one moment and its caption into one picture.

    The overview stands left; the other views are stacked right of it, together as high as it is. Without an overview
    the views stand side by side.
    """

    def __init__(self, frames: Frames) -> None:
        self._frames = frames
        self._title = _font(19)
        self._detail = _font(15)
        overview = frames.views.get("global")
        others = [view for view in frames.views if view != "global"]
        self._places: dict[str, tuple[int, int, int, int]] = {}
        if overview is not None and others:
            width, height = overview.shape[2], overview.shape[1]
            side_height = height // len(others)
            side_width = frames.size[0] * side_height // frames.size[1]
            self._places["global"] = (0, 0, width, height)
            for row, view in enumerate(others):
                self._places[view] = (width, row * side_height, side_width, side_height)
            self._picture_size = (width + side_width, height)
        else:
            height = max(pictures.shape[1] for pictures in frames.views.values())
            x = 0
            for view, pictures in frames.views.items():
                width = pictures.shape[2] * height // pictures.shape[1]
                self._places[view] = (x, 0, width, height)
                x += width
            self._picture_size = (x, height)

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the composed pictures; both are even, as the encoder wants."""
        width, height = self._picture_size
        return width + width % 2, height + height % 2 + _BAR_PX

    def compose(self, index: int, caption: Caption) -> Picture:
        """Return the (H, W, 3) picture of one moment."""
        canvas = Image.new("RGB", self.size, _BAR_COLOR)
        for view, (x, y, width, height) in self._places.items():
            picture = Image.fromarray(np.ascontiguousarray(self._frames.views[view][index]))
            if picture.size != (width, height):
                picture = picture.resize((width, height), Image.Resampling.LANCZOS)
            canvas.paste(picture, (x, y + _BAR_PX))
        self._write(ImageDraw.Draw(canvas), caption)
        return np.asarray(canvas)

    def _write(self, draw: ImageDraw.ImageDraw, caption: Caption) -> None:
        # The caption stands above the pictures, since players lay their controls over the lower edge.
        width, _ = self.size
        clock = f"{caption.time_s:.1f} s"
        draw.rectangle((0, _BAR_PX - 3, round(width * caption.progress), _BAR_PX - 1), fill=_ACCENT_COLOR)
        room = width - 24 - draw.textlength(clock, font=self._detail) - 12
        draw.text((12, 6), _fitted(draw, caption.title, self._title, room), _TITLE_COLOR, font=self._title)
        draw.text((12, 30), _fitted(draw, caption.detail, self._detail, room), _DETAIL_COLOR, font=self._detail)
        draw.text((width - 12, 9), clock, _DETAIL_COLOR, font=self._detail, anchor="ra")


def _font(size_px: int) -> Font:
    """Return Pillow's own font, so that no font of the machine is needed and pictures are alike everywhere."""
    return ImageFont.load_default(size_px)


def _fitted(draw: ImageDraw.ImageDraw, text: str, font: Font, room_px: float) -> str:
    if draw.textlength(text, font=font) <= room_px:
        return text
    while text and draw.textlength(text + "...", font=font) > room_px:
        text = text[:-1]
    return text + "..."


DEFAULT_SIZE = (224, 224)
SMALLEST_SIDE, LARGEST_SIDE = 32, 2048
_MAX_WORKERS = 2
"""Drawing itself uses all cores; two processes hide each other's pauses."""

_ATTEMPTS = 2
"""A process that dies is replaced once."""


class RenderFailed(Scene2DemoError):
    """Pictures could not be drawn although a renderer was found."""

    exit_code = 1

    def __init__(self, problem: str) -> None:
        super().__init__(f"drawing pictures failed: {problem}")


class BadPictureSize(Scene2DemoError, ValueError):
    """Pictures of this size cannot be drawn or encoded."""

    def __init__(self, size: tuple[int, int]) -> None:
        super().__init__(
            f"pictures of {size[0]} x {size[1]} pixels are not possible: "
            f"both sides must be even numbers from {SMALLEST_SIDE} to {LARGEST_SIDE}"
        )


def check_size(size: tuple[int, int]) -> tuple[int, int]:
    """Return the size of pictures when it can be drawn and encoded."""
    if any(side % 2 or not SMALLEST_SIDE <= side <= LARGEST_SIDE for side in size):
        raise BadPictureSize(size)
    return size


JOB_SCENE, JOB_STATES, JOB_CAMERAS, JOB_OVERVIEW = "scene.json", "states.npy", "cameras.json", "overview.npy"


def write_job(
    folder: Path,
    scene: Scene,
    cameras: Sequence[Camera],
    states: Sequence[bytes],
    size: tuple[int, int],
    *,
    plain: bool = False,
    overview: Array | None = None,
) -> None:
    """Write a job, and empty arrays for its pictures, into a folder.

    Args:
        states: Packed physical states, one a picture.
        plain: Whether assets are drawn in their own colours, without their home.
        overview: (N, 4, 4) poses of the overview; by default it stands still.

    Raises:
        ValueError: When there are no states, or they differ in length.
    """
    lengths = {len(state) for state in states}
    if len(lengths) != 1:
        raise ValueError(f"expected packed states of one length, got {sorted(lengths) or 'none'}")
    np.save(folder / JOB_STATES, np.frombuffer(b"".join(states), dtype=np.uint8).reshape(len(states), -1))
    (folder / JOB_SCENE).write_text(json.dumps(scene.to_json()), encoding="utf-8")
    described = {
        "cameras": [{**asdict(camera), "T_mount_camera": camera.T_mount_camera.tolist()} for camera in cameras],
        "sizes": {camera.name: view_size(camera.name, size) for camera in cameras},
        "plain": plain,
    }
    if overview is not None:
        np.save(folder / JOB_OVERVIEW, overview)
    (folder / JOB_CAMERAS).write_text(json.dumps(described), encoding="utf-8")
    for camera in cameras:
        width, height = view_size(camera.name, size)
        shape = (len(states), height, width, 3)
        open_memmap(frames_path(folder, camera.name), mode="w+", dtype=np.uint8, shape=shape)


class RenderPool:
    """Draws jobs with a fixed number of worker processes, started at the first job and reused for later ones.

    Args:
        workers: Number of processes; by default two, or one on a machine with one core.
    """

    def __init__(self, workers: int | None = None) -> None:
        self.renderer = vulkan.find_renderer()
        if not self.renderer:
            raise vulkan.RendererNotFound.of(self.renderer)
        cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
        self._count = max(1, workers if workers is not None else min(_MAX_WORKERS, cores))
        self._threads = max(1, cores // self._count)
        self._workers: dict[int, WorkerProcess] = {}
        self._stopping = threading.Event()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    def start(self) -> None:
        """Start the worker processes now, so that they compile their shaders while something else goes on."""
        for share in range(self._count):
            self._worker(share)

    def draw(
        self,
        folder: Path,
        scene: Scene,
        task: Task,
        states: Sequence[bytes],
        *,
        views: Sequence[str] = VIEWS,
        size: tuple[int, int] = DEFAULT_SIZE,
        plain: bool = False,
        overview: Array | None = None,
        on_progress: OnProgress | None = None,
    ) -> dict[str, Picture]:
        """Return view -> (N, H, W, 3) uint8 pictures of packed physical states, read from arrays in a folder.

        Args:
            folder: Where the arrays go; it exists.
            states: Packed physical states of the scene, one a picture.
            views, size, plain, on_progress: As for `render`.
            overview: As for `write_job`.

        Raises:
            RenderFailed: When a worker reports an error, or its replacement dies too.
            ValueError: When a view is unknown, or there are no states.
        """
        cameras = cameras_of(scene, task, views, size)
        write_job(folder, scene, cameras, states, size, plain=plain, overview=overview)
        count = len(states)
        shares = min(self._count, count)
        done = [0] * shares
        lock = threading.Lock()

        def advance(share: int, finished: int) -> None:
            with lock:
                done[share] = finished
                if on_progress is not None:
                    on_progress(sum(done), count)

        self._stopping.clear()
        threads = ThreadPoolExecutor(shares)
        try:
            for future in [threads.submit(self._share, folder, k, shares, advance) for k in range(shares)]:
                future.result()
        except BaseException:
            # Threads wait for their workers' answers; without workers they end at once, and none is replaced.
            self._stopping.set()
            self.close()
            raise
        finally:
            threads.shutdown()
        return {view: np.load(frames_path(folder, view), mmap_mode="r") for view in views}

    def close(self) -> None:
        """End the worker processes; a later job starts new ones."""
        for worker in list(self._workers.values()):
            worker.close()
        self._workers.clear()

    def _worker(self, share: int) -> WorkerProcess:
        if share not in self._workers:
            threads = {"LP_NUM_THREADS": str(self._threads)}
            self._workers[share] = WorkerProcess("executor.sim.render.worker", threads)
        return self._workers[share]

    def _share(self, folder: Path, share: int, shares: int, advance: OnProgress) -> None:
        """Let one process draw every n-th state of a job."""
        finished = 0
        for attempt in range(_ATTEMPTS):
            worker = self._worker(share)
            try:
                worker.send({"folder": str(folder), "first": share, "step": shares, "skip": finished})
                while True:
                    answer = worker.receive()
                    if "error" in answer:
                        raise RenderFailed(answer["error"])
                    if "ready" in answer:
                        continue
                    finished = answer["drawn"]
                    advance(share, finished)
                    if answer["finished"]:
                        return
            except WorkerDied as death:
                worker.close()
                self._workers.pop(share, None)
                if attempt + 1 == _ATTEMPTS or self._stopping.is_set():
                    raise RenderFailed(str(death)) from None


def render(
    rollout: Rollout,
    out_dir: Path | str,
    *,
    views: Sequence[str] = VIEWS,
    size: tuple[int, int] = DEFAULT_SIZE,
    plain: bool = False,
    on_progress: OnProgress | None = None,
    pool: RenderPool | None = None,
) -> Frames:
    """Return pictures of every recorded sample, drawn from the packed physical states.

    Args:
        rollout: What was recorded; its scene rebuilds the world.
        out_dir: Folder for the arrays (about 1 MB a sample at the default size); it is made when absent.
        views: Names out of `executor.sim.render.cameras.VIEWS`.
        size: Width and height of the robot's own views; the overview is drawn twice as large, and follows the task.
        plain: Whether assets are drawn in their own colours, without their home.
        on_progress: Called with the number of samples done, and the total; from any thread, but never twice at once.
        pool: Worker processes to reuse; without one, they are started and ended here.
    """
    check_size(size)
    folder = Path(out_dir)
    folder.mkdir(parents=True, exist_ok=True)
    with RenderPool() if pool is None else nullcontext(pool) as drawing:
        states = rollout.trajectory.packed_states
        overview = follow_task(rollout, size) if "global" in views else None
        pictures = drawing.draw(
            folder,
            rollout.scene,
            rollout.task,
            states,
            views=views,
            size=size,
            plain=plain,
            overview=overview,
            on_progress=on_progress,
        )
        return Frames(pictures, size, drawing.renderer.why, overview)


def follow_task(rollout: Rollout, size: tuple[int, int]) -> Array:
    """Return (N, 4, 4) poses of the overview, which has robot, target and goal's support in its picture throughout."""
    motion, scene, task = rollout.trajectory, rollout.scene, rollout.task
    (still,) = cameras_of(scene, task, ("global",), size)
    rate_hz = rollout.record_hz
    signs = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])

    def corners(name: str | None) -> Array:
        """Return (N, 8, 3) corners of a thing where it is in each picture; those around the hand without one."""
        thing = None if name is None else scene.objects.get(name)
        if name is None or thing is None:
            return motion.eef_pose[:, None, :3] + signs * [0.3, 0.3, 0.25]
        R = transform_from_quaternion((0.0, 0.0, 0.0), thing.orientation)[:3, :3]
        moved = motion.object_poses.get(name)
        at = np.tile(thing.position, (len(motion.time_s), 1)) if moved is None else moved[:, :3]
        return np.asarray(at[:, None] + signs * np.asarray(thing.extent_m) / 2 @ R.T)

    shown = [corners(None)]
    for role in ("target", "support_goal"):
        of_each = np.array([corners(getattr(part, role)) for part in task.subtasks])
        shown.append(of_each[np.clip(motion.subtask, 0, len(of_each) - 1), np.arange(len(motion.time_s))])
    base = np.zeros((len(motion.time_s), 1, 3))
    base[:, 0, :2] = motion.robot_qpos[:, :2]
    points = np.concatenate([*shown, base + [0.0, 0.0, 0.4] + signs * [0.3, 0.3, 0.4]], axis=1)
    return following(still, points, Solids.of(scene), size[0] / size[1], rate_hz)
