"""The cyclic garbage collector, held back where many small values are made and none of them is garbage.

Deciding a plan makes some ten tuples a step, all of which stay; each pass of the collector walks over all that were
made before. For 5,000 steps that was a fifth of the time, and the only part of it that grew faster than the plan. Part
of this is put off, not saved: one pass over what is left comes when the next value is made (docs/results.md, The
checker).
"""

from __future__ import annotations

import gc
from types import TracebackType


class HeldBack:
    """Runs a block without the cyclic collector, and leaves the collector as it was; reference counting goes on."""

    # A generator would make an exception to end with, which is reason enough for the collector to set in.
    __slots__ = ("_enabled",)

    def __enter__(self) -> None:
        self._enabled = gc.isenabled()
        gc.disable()

    def __exit__(
        self, kind: type[BaseException] | None, problem: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._enabled:
            gc.enable()


def held_back() -> HeldBack:
    """Returns a context manager that holds the collector back for a block."""
    return HeldBack()
