"""Waits for blocking work, but no longer than a deadline and never against the caller's will."""

from __future__ import annotations

import time
from collections.abc import Callable
from enum import Enum
from threading import Event, Thread
from typing import Generic, TypeVar

Result = TypeVar("Result")

# A caller's event can be set by any thread without a signal that would wake the waiting one.
_LOOKS_S = 0.05


class Ended(Enum):
    """Why waiting ended without a result."""

    LATE = "late"
    CANCELLED = "cancelled"


class _Errand(Generic[Result]):
    """Work in a thread of its own, with its result or the exception that it ended with."""

    def __init__(self, work: Callable[[], Result]) -> None:
        self.done = Event()
        self.result: Result | None = None
        self.error: BaseException | None = None
        self._work = work

    def run(self) -> None:
        try:
            self.result = self._work()
        except BaseException as error:
            self.error = error
        finally:
            self.done.set()


def wait_for(
    work: Callable[[], Result], *, timeout_s: float, cancel: Event | None = None, abandon: Callable[[], None]
) -> Result | Ended:
    """Returns what the work returns, or why it was not waited for; exceptions of the work are raised.

    A server that sends one byte now and then keeps every socket timeout at bay; a deadline over the whole is the only
    one that holds. The thread is a daemon: work that hangs keeps no program alive.

    Args:
        work: Called once, in another thread.
        timeout_s: Most seconds to wait.
        cancel: Ends the waiting when it is set.
        abandon: Called when the waiting ended before the work did, also on Ctrl+C; it makes the work end soon.
    """
    errand = _Errand(work)
    deadline = time.monotonic() + timeout_s
    thread = Thread(target=errand.run, name="model-request", daemon=True)
    try:
        thread.start()
        while not errand.done.is_set():
            if cancel is not None and cancel.is_set():
                return Ended.CANCELLED
            left = deadline - time.monotonic()
            if left <= 0:
                return Ended.LATE
            errand.done.wait(left if cancel is None else min(left, _LOOKS_S))
    finally:
        if not errand.done.is_set():
            abandon()
    if errand.error is not None:
        raise errand.error
    return errand.result  # type: ignore[return-value]
