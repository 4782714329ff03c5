"""A process that runs units of baselines, one after the other: `python -m executor.baselines.worker`."""

from __future__ import annotations

from typing import Any

from executor.baselines.methods import baseline_version, run_baseline
from executor.bench.units import Unit
from executor.machine.files import plain
from executor.machine.workers.process import check_version, serve


def main() -> None:
    """Serves requests until standard input ends."""
    own = baseline_version()

    def handle(request: dict[str, Any]) -> dict[str, Any]:
        """Returns the result of the unit that a request names."""
        check_version(request["version"], own)
        result: dict[str, Any] = plain(run_baseline(Unit.from_json(request)))
        return result

    serve(handle)


if __name__ == "__main__":
    main()
