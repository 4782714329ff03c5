"""One worker process: JSON lines in, JSON lines out, nothing pickled; when it dies, its last words are kept."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import threading
import traceback
from collections.abc import Callable, Iterator, Mapping
from typing import Any, TextIO

from bddl.files import no_room

_STDERR_LINES = 5


class WorkerDied(Exception):
    """A worker process ended in the middle of its work; the message has its status and its last words."""


class HandoverRefused(RuntimeError):
    """A process runs another version of the program, or has other inputs, than the request is for that it was given."""


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
    """Runs a module in a process of its own, whose standard input and output carry one JSON object a line.

    Args:
        module: Dotted name; its `__main__` part reads requests until its input ends with `requests` or `serve`.
        environment: Variables to set, beside those of this process.
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
        self._last_words: list[str] = []
        self._listener = threading.Thread(target=self._listen_to_stderr, daemon=True)
        self._listener.start()

    @property
    def pid(self) -> int:
        """The process's number."""
        return self._process.pid

    def send(self, request: Mapping[str, Any]) -> None:
        """Writes one request.

        Raises:
            WorkerDied: The process is gone.
        """
        stream = self._process.stdin
        try:
            if stream is not None:
                stream.write(json.dumps(request) + "\n")
                stream.flush()
        except (BrokenPipeError, ValueError):
            raise WorkerDied(self._epitaph()) from None

    def receive(self) -> dict[str, Any]:
        """Waits for one answer and returns it.

        Raises:
            WorkerDied: The process ended instead.
        """
        line = ""
        if self._process.stdout is not None and not self._process.stdout.closed:
            line = self._process.stdout.readline()
        if not line.endswith("\n"):
            raise WorkerDied(self._epitaph())
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
        """Ends the process at once; whoever waits for its answer is told that it died."""
        self._killed = True
        if self._process.poll() is None:
            self._process.kill()

    def close(self) -> None:
        """Ends the process and lets go of its streams."""
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
                self._last_words = [*self._last_words, line.rstrip()][-_STDERR_LINES:]

    def _epitaph(self) -> str:
        code = self._process.wait()
        self._listener.join(timeout=1.0)
        words = " / ".join(self._last_words)
        return f"a worker process ended with status {code}" + (f": {words}" if words else "")


Handler = Callable[[dict[str, Any]], dict[str, Any]]
_TRACEBACK_LINES = 12


def take_stdout() -> TextIO:
    """Returns a stream on the original standard output, and sends whatever libraries print there to standard error."""
    private = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)
    return private


def answer(stream: TextIO, **values: Any) -> None:
    """Writes one answer."""
    stream.write(json.dumps(values) + "\n")
    stream.flush()


def requests() -> Iterator[dict[str, Any]]:
    """Yields the requests of the parent process, until it closes the stream or ends."""
    for line in sys.stdin:
        yield json.loads(line)


def serve(handle: Handler) -> None:
    """Answers every request with what a function makes of it; its exceptions are answers too.

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
            if isinstance(error, OSError) and no_room(error):
                room["no_room"] = [error.errno, error.strerror, error.filename]
            answer(answers, error=str(error), kind=type(error).__name__, traceback=trace, **room)
