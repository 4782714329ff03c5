"""A worker whose requests say what it does."""

from __future__ import annotations

import os
import time
from typing import Any

from executor.system.workers import serve


def handle(request: dict[str, Any]) -> dict[str, Any]:
    """Sleep, or crash."""
    if request.get("crash"):
        os._exit(11)
    time.sleep(request.get("sleep_s", 0.0))
    return {"number": request["number"]}


if __name__ == "__main__":
    serve(handle)
