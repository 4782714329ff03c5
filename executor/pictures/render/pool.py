"""Worker processes that draw, kept between rollouts; one that dies is replaced once."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from types import TracebackType
from typing import Self

from executor.machine import vulkan
from executor.machine.workers.process import WorkerDied, WorkerProcess

Progress = Callable[[int, int], None]
_MAX_WORKERS = 2
_ATTEMPTS = 2


class RenderFailed(RuntimeError):
    """Pictures could not be drawn although a renderer was found."""

    def __init__(self, problem: str) -> None:
        super().__init__(f"drawing pictures failed: {problem}")


class _Worker:
    """A process that draws its share of a job."""

    def __init__(self, threads: int) -> None:
        self._process = WorkerProcess("executor.pictures.render.worker", {"LP_NUM_THREADS": str(threads)})
        self.renderer = ""

    def draw(self, folder: Path, first: int, step: int, skip: int) -> Iterator[int]:
        """Yields how many pictures of its share are done, until all are."""
        self._process.send({"folder": str(folder), "first": first, "step": step, "skip": skip})
        while True:
            answer = self._process.receive()
            if "ready" in answer:
                self.renderer = answer["ready"]
            elif "error" in answer:
                raise RenderFailed(answer["error"])
            else:
                yield answer.get("finished", answer.get("done", 0))
                if "finished" in answer:
                    return

    def close(self) -> None:
        self._process.close()


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
            raise vulkan.RendererNotFound(self.renderer)
        cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
        self._count = max(1, workers if workers is not None else min(_MAX_WORKERS, cores))
        self._threads = max(1, cores // self._count)
        self._workers: dict[int, _Worker] = {}
        self._stopping = threading.Event()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def start(self) -> None:
        """Starts the worker processes now, so that they compile their shaders while something else goes on."""
        for share in range(self._count):
            if share not in self._workers:
                self._workers[share] = _Worker(self._threads)

    def draw(self, folder: Path, count: int, progress: Progress | None = None) -> None:
        """Draws all states of the job in a folder.

        Args:
            folder: Where `write_job` left it; the pictures go into its arrays.
            count: Number of states.
            progress: Told the number of states done and their total, from any thread but never twice at once.

        Raises:
            RenderFailed: When a worker reports an error, or its replacement dies too.
        """
        shares = min(self._count, count)
        done = [0] * shares
        lock = threading.Lock()

        def advance(share: int, finished: int) -> None:
            with lock:
                done[share] = finished
                if progress is not None:
                    progress(sum(done), count)

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

    def close(self) -> None:
        """Ends the worker processes; a later job starts new ones."""
        for worker in list(self._workers.values()):
            worker.close()
        self._workers.clear()

    def _share(self, folder: Path, share: int, shares: int, advance: Callable[[int, int], None]) -> None:
        finished = 0
        for attempt in range(_ATTEMPTS):
            worker = self._workers.get(share)
            if worker is None:
                worker = self._workers[share] = _Worker(self._threads)
            try:
                for count in worker.draw(folder, share, shares, skip=finished):
                    finished = count
                    advance(share, finished)
                return
            except WorkerDied as death:
                worker.close()
                self._workers.pop(share, None)
                if attempt + 1 == _ATTEMPTS or self._stopping.is_set():
                    raise RenderFailed(str(death)) from None
