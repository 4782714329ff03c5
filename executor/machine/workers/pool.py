"""Requests spread over worker processes that live long: imports are paid once, and a crash costs one request."""

from __future__ import annotations

import threading
import time
from collections.abc import Generator, Iterable, Mapping
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass, field
from typing import Any, Literal

from executor.machine.workers.process import HandoverRefused, WorkerDied, WorkerProcess

START_LIMIT_S = 300.0
"""Wall time that a worker may take until it is ready; imports on a slow disk take a minute."""

Ending = Literal["finished", "error", "crashed", "timed-out"]


class WorkersUnusable(RuntimeError):
    """Worker processes end or hang before they take a request, or refuse what is handed over; none is worked on."""


@dataclass(frozen=True, slots=True)
class WorkerOutcome:
    """What became of one request.

    Attributes:
        request: The request.
        ending: How it ended.
        answer: What the worker returned; with "error", its exception's `kind` and `traceback`.
        message: What went wrong, in a sentence; empty when it finished.
        started_s: When it was handed over, in seconds since 1970.
        wall_s: How long it took.
        worker: Number of the worker's process.
    """

    request: Mapping[str, Any]
    ending: Ending
    answer: Mapping[str, Any]
    message: str
    started_s: float
    wall_s: float
    worker: int


@dataclass
class _Clock:
    """Kills a worker that takes too long over one request; once it is left, it does not ring any more."""

    worker: WorkerProcess
    limit_s: float | None
    rang: bool = field(default=False)
    _over: bool = field(default=False)
    _lock: threading.Lock = field(default_factory=threading.Lock)

    def __enter__(self) -> _Clock:
        self._timer = threading.Timer(self.limit_s, self._ring) if self.limit_s is not None else None
        if self._timer is not None:
            self._timer.daemon = True
            self._timer.start()
        return self

    def __exit__(self, *exception: object) -> None:
        with self._lock:
            self._over = True
        if self._timer is not None:
            self._timer.cancel()

    def _ring(self) -> None:
        with self._lock:
            if not self._over:
                self.rang = True
                self.worker.kill()


class WorkerPool:
    """Worker processes of one module.

    Args:
        module: What each process runs, such as "executor.bench.worker".
        workers: How many processes.
        limit_s: Wall time that one request may take; without it, there is no limit.
        environment: Variables to set in the processes.
        start_limit_s: Wall time that a process may take until it can take a request.
    """

    def __init__(
        self,
        module: str,
        workers: int,
        *,
        limit_s: float | None = None,
        environment: Mapping[str, str] | None = None,
        start_limit_s: float = START_LIMIT_S,
    ) -> None:
        self._module, self._count, self._limit_s = module, max(1, workers), limit_s
        self._start_limit_s = start_limit_s
        self._environment = dict(environment or {})
        self._stopping = threading.Event()
        self._idle: list[WorkerProcess] = []
        self._live: set[WorkerProcess] = set()
        self._lock = threading.Lock()

    def run(self, requests: Iterable[Mapping[str, Any]]) -> Generator[WorkerOutcome, None, None]:
        """Yields what became of each request, in the order in which they end.

        A worker that dies, or is killed for taking too long, is replaced. When the iteration is left early, such as
        by Ctrl-C, all workers end at once.

        Raises:
            WorkersUnusable: A worker died, or hung, before it took a request, or refuses one that is for another
                version of the program or other inputs than it has.
            OSError: A worker's disk is full.
        """
        self._stopping.clear()
        threads = ThreadPoolExecutor(self._count)
        try:
            for done in as_completed([threads.submit(self._work, request) for request in requests]):
                yield done.result()
        finally:
            self._stopping.set()
            with self._lock:
                live = list(self._live)
            for worker in live:
                worker.kill()
            threads.shutdown(cancel_futures=True)
            while self._live:
                self._end(next(iter(self._live)))
            self._idle.clear()

    def _work(self, request: Mapping[str, Any]) -> WorkerOutcome:
        """Hands a request to a worker that has nothing to do, or to a new one."""
        started_s, began = time.time(), time.perf_counter()
        try:
            with self._lock:
                idle = self._idle.pop() if self._idle else None
            worker = idle or self._start()
        except WorkerDied as death:
            raise WorkersUnusable(f"{self._module} cannot be started: {death}") from None
        ending, answer, message = self._ask(worker, request)
        outcome = WorkerOutcome(request, ending, answer, message, started_s, time.perf_counter() - began, worker.pid)
        # An answer that came while the clock rang is whole, but its worker takes no other request.
        if worker.killed or ending in ("crashed", "timed-out"):
            self._end(worker)
        else:
            with self._lock:
                self._idle.append(worker)
        return outcome

    def _ask(self, worker: WorkerProcess, request: Mapping[str, Any]) -> tuple[Ending, Mapping[str, Any], str]:
        with _Clock(worker, self._limit_s) as clock:
            try:
                worker.send(request)
                answer = worker.receive()
            except WorkerDied as death:
                if clock.rang:
                    return "timed-out", {}, f"it took longer than {self._limit_s:g} s"
                return "crashed", {}, str(death)
        if "no_room" in answer:
            # It is the disk's fault and nobody's of this request: the next ones would fare the same.
            raise OSError(*answer["no_room"])
        if answer.get("kind") == HandoverRefused.__name__:
            # The next ones would fare the same.
            raise WorkersUnusable(answer["error"])
        if "error" in answer:
            return "error", answer, f"{answer['kind']}: {answer['error']}" if answer["error"] else str(answer["kind"])
        return "finished", answer["finished"], ""

    def _start(self) -> WorkerProcess:
        worker = WorkerProcess(self._module, self._environment)
        with self._lock:
            self._live.add(worker)
            stopping = self._stopping.is_set()
        try:
            if stopping:
                raise WorkerDied("the pool is closed")
            self._await_ready(worker)
        except WorkerDied:
            self._end(worker)
            raise
        return worker

    def _await_ready(self, worker: WorkerProcess) -> None:
        with _Clock(worker, self._start_limit_s) as clock:
            try:
                worker.receive()
            except WorkerDied:
                if not clock.rang:
                    raise
        if clock.rang:
            raise WorkerDied(f"it was not ready within {self._start_limit_s:g} s")

    def _end(self, worker: WorkerProcess) -> None:
        worker.close()
        with self._lock:
            self._live.discard(worker)
