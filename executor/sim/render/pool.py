"""Deferred rendering: pictures of a recorded rollout, drawn afterwards by worker processes that outlive a rollout."""

from __future__ import annotations

import os
import threading
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import nullcontext
from pathlib import Path
from typing import Self

import numpy as np

from bddl.errors import Scene2DemoError
from executor.records import Rollout
from executor.sim.render.cameras import VIEWS, cameras_for
from executor.sim.render.frames import Frames, Picture, frames_path
from executor.sim.render.worker import write_job
from executor.system import vulkan
from executor.system.progress import OnProgress
from executor.system.workers import WorkerDied, WorkerProcess
from oag import Scene, Task

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
    """Return the size of pictures when it can be drawn and encoded.

    Raises:
        BadPictureSize: When it cannot.
    """
    if any(side % 2 or not SMALLEST_SIDE <= side <= LARGEST_SIDE for side in size):
        raise BadPictureSize(size)
    return size


class RenderPool:
    """Draws jobs with a fixed number of worker processes, started at the first job and reused for later ones.

    Args:
        workers: Number of processes; by default two, or one on a machine with one core.

    Raises:
        RendererNotFound: When nothing on this machine can draw.
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
        shadows: bool = True,
        on_progress: OnProgress | None = None,
    ) -> dict[str, Picture]:
        """Return view -> (N, H, W, 3) uint8 pictures of packed physical states, read from arrays in a folder.

        Args:
            folder: Where the arrays go; it exists.
            scene: The concrete scene.
            task: What the global camera is to show.
            states: Packed physical states of the scene, one a picture.
            views, size, shadows, on_progress: As for `render`.

        Raises:
            RenderFailed: When a worker reports an error, or its replacement dies too.
            ValueError: When a view is unknown, or there are no states.
        """
        cameras = cameras_for(scene, views, aspect=size[0] / size[1], task=task)
        write_job(folder, scene, cameras, states, size, shadows=shadows)
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
    shadows: bool = True,
    on_progress: OnProgress | None = None,
    pool: RenderPool | None = None,
) -> Frames:
    """Return pictures of every recorded sample, drawn from the packed physical states.

    Args:
        rollout: What was recorded; its scene rebuilds the world.
        out_dir: Folder for the arrays (about 1 MB a sample at the default size); it is made when absent.
        views: Names out of `executor.sim.render.cameras.VIEWS`.
        size: Width and height of the robot's own views; the overview is drawn twice as large.
        shadows: Whether to draw shadows.
        on_progress: Called with the number of samples done, and the total; from any thread, but never twice at once.
        pool: Worker processes to reuse; without one, they are started and ended here.

    Raises:
        RendererNotFound: When nothing on this machine can draw.
        RenderFailed: When drawing failed.
        BadPictureSize: When the size cannot be drawn.
        ValueError: When a view is unknown or nothing was recorded.
    """
    check_size(size)
    folder = Path(out_dir)
    folder.mkdir(parents=True, exist_ok=True)
    with RenderPool() if pool is None else nullcontext(pool) as drawing:
        states = rollout.trajectory.packed_states
        pictures = drawing.draw(
            folder,
            rollout.scene,
            rollout.task,
            states,
            views=views,
            size=size,
            shadows=shadows,
            on_progress=on_progress,
        )
        return Frames(pictures, size, drawing.renderer.why)
