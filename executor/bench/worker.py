"""A process that runs units of a benchmark, one after the other: `python -m executor.bench.worker`."""

from __future__ import annotations

from typing import Any

from executor.bench.pictures import Draughtsman
from executor.bench.units import Unit
from executor.bench.work import run_unit
from executor.machine.files import plain
from executor.machine.workers.serving import serve


def main() -> None:
    """Serves requests until standard input ends."""
    draughtsmen: list[Draughtsman] = []

    def handle(request: dict[str, Any]) -> dict[str, Any]:
        unit = Unit.from_json(request)
        if unit.setting.views and not draughtsmen:
            draughtsmen.append(Draughtsman())
        draw = draughtsmen[0].draw if unit.setting.views else None
        result: dict[str, Any] = plain(run_unit(unit, draw, rule=request["rule"]))
        return result

    try:
        serve(handle)
    finally:
        for draughtsman in draughtsmen:
            draughtsman.close()


if __name__ == "__main__":
    main()
