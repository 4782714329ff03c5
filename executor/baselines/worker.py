"""A process that runs units of baselines, one after the other: `python -m executor.baselines.worker`."""

from __future__ import annotations

from typing import Any

from executor.baselines.methods import run_baseline
from executor.bench.units import Unit
from executor.machine.files import plain
from executor.machine.workers.process import serve


def handle(request: dict[str, Any]) -> dict[str, Any]:
    """Returns the result of the unit that a request names."""
    result: dict[str, Any] = plain(run_baseline(Unit.from_json(request)))
    return result


if __name__ == "__main__":
    serve(handle)
