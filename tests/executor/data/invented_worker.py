"""A worker whose units end as their seeds say, without any physics."""

from __future__ import annotations

import errno
import os
import time
from pathlib import Path
from typing import Any

import numpy as np

from executor.data import samples
from executor.data.store import SAMPLES, EpisodeStore
from executor.data.units import DemoUnit
from executor.system.workers import serve

FAIL, CRASH, NO_ROOM, SLOW = 3, 4, 5, 9
SLOW_S = 120.0
MENDED = "mended"


def handle(request: dict[str, Any]) -> dict[str, Any]:
    """Make a unit; the last digit of the seed decides how it ends, but nothing crashes beside a file MENDED."""
    unit, store = DemoUnit.from_json(request["unit"]), EpisodeStore(Path(request["store"]))
    digit = unit.seed % 10
    with store.writing(unit, request["version"]) as folder:
        (folder / SAMPLES).write_bytes(samples.packed({"time_s": np.arange(unit.seed % 97, dtype=float)}))
        if digit == CRASH and not store.path.with_name(MENDED).exists():
            os.kill(os.getpid(), 11)
        if digit == NO_ROOM:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(folder))
        if digit == SLOW:
            time.sleep(SLOW_S)
        failure = {"kind": "slipped", "message": "the fingers lost <glass>"} if digit == FAIL else None
        ended = "failed" if failure else "succeeded"
        store.write(unit, request["version"], {"ended": ended, "failure": failure}, folder)
    return {"ended": ended, "kind": failure and failure["kind"], "message": "lost", "bytes": 100, "cpu_s": 0.5}


if __name__ == "__main__":
    serve(handle)
