"""Worker process that runs units of baselines: `python -m executor.bench.baselines.worker`."""

from __future__ import annotations

from typing import Any

from executor.bench.baselines.methods import baseline_version, run_baseline
from executor.bench.units import Unit
from executor.system.files import plain
from executor.system.workers import check_version, serve


def main() -> None:
    """Serve requests until standard input ends."""
    own = baseline_version()

    def handle(request: dict[str, Any]) -> dict[str, Any]:
        check_version(request["version"], own)
        result: dict[str, Any] = plain(run_baseline(Unit.from_json(request)))
        return result

    serve(handle)


if __name__ == "__main__":
    main()
