"""Worker processes: JSON lines in and out, nothing pickled; a pool that loses one request to a crash.

Processes live long, so imports are paid once. The last lines of standard error of a process that died are kept.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import threading
import time
import traceback
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from dataclasses import dataclass, field
from itertools import islice
from typing import Any, Literal, TextIO

from bddl.errors import Scene2DemoError
from bddl.files import is_disk_full

_STDERR_LINES = 5


class WorkerDied(Exception):
    """A worker process ended in the middle of its work; the message has its status and its last error lines."""


class HandoverRefused(RuntimeError):
    """A process runs another version of the program, or has other inputs, than its request is for."""


def check_version(wanted: str, own: str) -> None:
    """Refuse work whose record would name a version of the program that did not do it.

    Args:
        wanted: The version that the request names.
        own: The version that this process runs.

    Raises:
        HandoverRefused: They differ.
    """
    if wanted != own:
        raise HandoverRefused(
            f"this process runs version {own} of the program, and the request is for version {wanted!r}: the program "
            "was changed meanwhile, or this machine has another copy of it; start the same command again, with one "
            "copy of the program everywhere"
        )


class WorkerProcess:
    """A module in a process of its own; its standard input and output carry one JSON object a line.

    Args:
        module: Dotted name; its `__main__` part reads requests until its input ends with `requests` or `serve`.
        environment: Variables to set, in addition to those of this process.
    """

    def __init__(self, module: str, environment: Mapping[str, str] | None = None) -> None:
        variables = {**os.environ, **(environment or {})}
        variables["PYTHONPATH"] = os.pathsep.join(path for path in sys.path if path)
        # One thread each: two processes on two cores are faster than two that fight over them.
        for library in ("OMP", "OPENBLAS"):
            variables.setdefault(f"{library}_NUM_THREADS", "1")
        self._process = subprocess.Popen(
            [sys.executable, "-m", module],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            env=variables,
            # Ctrl-C in a terminal goes to the whole group; the parent ends its workers itself.
            start_new_session=True,
        )
        self._killed = False
        self._stderr_tail: list[str] = []
        self._listener = threading.Thread(target=self._listen_to_stderr, daemon=True)
        self._listener.start()

    @property
    def pid(self) -> int:
        """The process's number."""
        return self._process.pid

    def send(self, request: Mapping[str, Any]) -> None:
        """Write one request.

        Raises:
            WorkerDied: The process is gone.
        """
        stream = self._process.stdin
        try:
            if stream is not None:
                stream.write(json.dumps(request) + "\n")
                stream.flush()
        except (BrokenPipeError, ValueError):
            raise WorkerDied(self._exit_message()) from None

    def receive(self) -> dict[str, Any]:
        """Wait for one answer and return it.

        Raises:
            WorkerDied: The process ended instead.
        """
        line = ""
        if self._process.stdout is not None and not self._process.stdout.closed:
            line = self._process.stdout.readline()
        if not line.endswith("\n"):
            raise WorkerDied(self._exit_message())
        try:
            answer: dict[str, Any] = json.loads(line)
        except ValueError:
            self.kill()
            raise WorkerDied(f"a worker process answered with no JSON: {line.strip()[:80]!r}") from None
        return answer

    @property
    def killed(self) -> bool:
        """Whether `kill` was called."""
        return self._killed

    def kill(self) -> None:
        """End the process at once; a pending `receive` raises `WorkerDied`."""
        self._killed = True
        if self._process.poll() is None:
            self._process.kill()

    def close(self) -> None:
        """End the process and close its streams."""
        self.kill()
        self._process.wait()
        for stream in (self._process.stdin, self._process.stdout):
            if stream is not None:
                try:
                    stream.close()
                except BrokenPipeError:
                    continue

    def _listen_to_stderr(self) -> None:
        stream = self._process.stderr
        if stream is None:
            return
        with stream:
            for line in stream:
                self._stderr_tail = [*self._stderr_tail, line.rstrip()][-_STDERR_LINES:]

    def _exit_message(self) -> str:
        code = self._process.wait()
        self._listener.join(timeout=1.0)
        words = " / ".join(self._stderr_tail)
        return f"a worker process ended with status {code}" + (f": {words}" if words else "")


Handler = Callable[[dict[str, Any]], dict[str, Any]]
_TRACEBACK_LINES = 12


def take_stdout() -> TextIO:
    """Return a stream on the original standard output, and redirect what libraries print there to standard error."""
    private = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)
    return private


def answer(stream: TextIO, **values: Any) -> None:
    """Write one answer."""
    stream.write(json.dumps(values) + "\n")
    stream.flush()


def requests() -> Iterator[dict[str, Any]]:
    """Yield the requests of the parent process, until it closes the stream or ends."""
    for line in sys.stdin:
        yield json.loads(line)


def serve(handle: Handler) -> None:
    """Answer every request with the result of a handler; its exceptions are answers too.

    Args:
        handle: Takes a request and returns plain data.
    """
    answers = take_stdout()
    answer(answers, ready="")
    for request in requests():
        try:
            answer(answers, finished=handle(request))
        except Exception as error:
            trace = traceback.format_exc().splitlines()[-_TRACEBACK_LINES:]
            room = {}
            if isinstance(error, OSError) and is_disk_full(error):
                room["no_room"] = [error.errno, error.strerror, error.filename]
            answer(answers, error=str(error), kind=type(error).__name__, traceback=trace, **room)


START_LIMIT_S = 300.0
"""Wall time that a worker may take until it is ready; imports on a slow disk take a minute."""

Ending = Literal["finished", "error", "crashed", "timed-out"]


class WorkersUnusable(Scene2DemoError):
    """Worker processes end or hang before they take a request, or refuse the request; no work is done."""

    exit_code = 1


@dataclass(frozen=True, slots=True)
class WorkerOutcome:
    """The outcome of one request.

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
class _Deadline:
    """Kill a worker that takes too long over one request; inactive once the block is left."""

    worker: WorkerProcess
    limit_s: float | None
    timed_out: bool = field(default=False)
    _over: bool = field(default=False)
    _lock: threading.Lock = field(default_factory=threading.Lock)

    def __enter__(self) -> _Deadline:
        self._timer = threading.Timer(self.limit_s, self._time_out) if self.limit_s is not None else None
        if self._timer is not None:
            self._timer.daemon = True
            self._timer.start()
        return self

    def __exit__(self, *exception: object) -> None:
        with self._lock:
            self._over = True
        if self._timer is not None:
            self._timer.cancel()

    def _time_out(self) -> None:
        with self._lock:
            if not self._over:
                self.timed_out = True
                self.worker.kill()


class WorkerPool:
    """Worker processes of one module.

    Args:
        module: What each process runs, such as "executor.bench.worker".
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
        """Yield the outcome of each request, in the order in which they end; one is taken when a process is free.

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
            waiting, flying = iter(requests), set[Future[WorkerOutcome]]()
            while True:
                for request in islice(waiting, self._count - len(flying)):
                    flying.add(threads.submit(self.ask, request))
                if not flying:
                    return
                done, flying = wait(flying, return_when=FIRST_COMPLETED)
                for one in done:
                    yield one.result()
        finally:
            self._stop()
            threads.shutdown(cancel_futures=True)
            self.close()

    def _stop(self) -> None:
        self._stopping.set()
        with self._lock:
            live = list(self._live)
        for worker in live:
            worker.kill()

    def close(self) -> None:
        """End all processes."""
        self._stop()
        while self._live:
            self._end(next(iter(self._live)))
        self._idle.clear()

    def ask(self, request: Mapping[str, Any]) -> WorkerOutcome:
        """Return the outcome of one request; threads that ask at once have a process each.

        Raises:
            WorkersUnusable, OSError: As for `run`.
        """
        started_s, began = time.time(), time.perf_counter()
        try:
            with self._lock:
                idle = self._idle.pop() if self._idle else None
            worker = idle or self._start()
        except WorkerDied as death:
            raise WorkersUnusable(f"{self._module} cannot be started: {death}") from None
        ending, answer, message = self._ask(worker, request)
        outcome = WorkerOutcome(request, ending, answer, message, started_s, time.perf_counter() - began, worker.pid)
        # An answer that came just at the deadline is whole, but its worker takes no other request.
        if worker.killed or ending in ("crashed", "timed-out"):
            self._end(worker)
        else:
            with self._lock:
                self._idle.append(worker)
        return outcome

    def _ask(self, worker: WorkerProcess, request: Mapping[str, Any]) -> tuple[Ending, Mapping[str, Any], str]:
        with _Deadline(worker, self._limit_s) as deadline:
            try:
                worker.send(request)
                answer = worker.receive()
            except WorkerDied as death:
                if deadline.timed_out:
                    return "timed-out", {}, f"it took longer than {self._limit_s:g} s"
                return "crashed", {}, str(death)
        if "no_room" in answer:
            # The disk is full, not the request wrong: the next ones would fare the same.
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
        with _Deadline(worker, self._start_limit_s) as deadline:
            try:
                worker.receive()
            except WorkerDied:
                if not deadline.timed_out:
                    raise
        if deadline.timed_out:
            raise WorkerDied(f"it was not ready within {self._start_limit_s:g} s")

    def _end(self, worker: WorkerProcess) -> None:
        worker.close()
        with self._lock:
            self._live.discard(worker)
