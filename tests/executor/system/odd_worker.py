"""A worker process that does what a request says: answers, crashes, raises or hangs."""

from __future__ import annotations

import errno
import os
import time
from typing import Any

from executor.system.workers import check_version, serve


def handle(request: dict[str, Any]) -> dict[str, Any]:
    if request["do"] == "crash":
        os._exit(7)
    if request["do"] == "raise":
        raise ValueError("odd request")
    if request["do"] == "be another program":
        check_version("theirs", "mine")
    if request["do"] == "fill the disk":
        raise OSError(errno.ENOSPC, "No space left on device", "r/rollout.json")
    if request["do"] == "hang":
        time.sleep(600)
    print("a library that prints to standard output")
    return {"number": request["number"], "process": os.getpid()}


if __name__ == "__main__":
    if os.environ.get("ODD_WORKER") == "hangs at its start":
        time.sleep(600)
    serve(handle)
