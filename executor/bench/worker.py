"""Worker process that runs units of a benchmark: `python -m executor.bench.worker`.

`serve_units` serves any other runner of units, such as a baseline's.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from executor.bench.any_task import run_wish
from executor.bench.units import Unit
from executor.bench.work import run_unit
from executor.campaign.versions import outcome_version
from executor.scenes.generators.any_task import FAMILY
from executor.system.files import plain
from executor.system.workers import check_version, serve


def serve_units(run: Callable[[Unit], dict[str, Any]], version: str) -> None:
    """Run the requested units until standard input ends.

    Args:
        run: Returns the result of a unit.
        version: The version of the program that its results are for; requests for others are refused.
    """

    def handle(request: dict[str, Any]) -> dict[str, Any]:
        check_version(request["version"], version)
        result: dict[str, Any] = plain(run(Unit.from_json(request)))
        return result

    serve(handle)


def main() -> None:
    """Run units of the executor itself."""
    serve_units(lambda unit: run_wish(unit.seed) if unit.family == FAMILY else run_unit(unit), outcome_version())


if __name__ == "__main__":
    main()
