"""The side of the worker process: reads requests as JSON lines, answers each with one or more JSON lines."""

from __future__ import annotations

import json
import os
import sys
import traceback
from collections.abc import Callable, Iterator
from typing import Any, TextIO

from bddl.wholefile import NO_ROOM

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
            if isinstance(error, OSError) and error.errno in NO_ROOM:
                room["no_room"] = [error.errno, error.strerror, error.filename]
            answer(answers, error=str(error), kind=type(error).__name__, traceback=trace, **room)
