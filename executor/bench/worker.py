"""Worker process that runs units of a benchmark: `python -m executor.bench.worker`.

`serve_units` serves any other runner of units, such as a baseline's.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from executor.bench.any_task import run_wish
from executor.bench.units import Unit
from executor.bench.work import run_unit
from executor.campaign.planning_model import ModelPlan, Plan, plan_offline
from executor.campaign.versions import outcome_version
from executor.scenes.generators.any_task import FAMILY
from executor.system.files import plain
from executor.system.workers import check_version, serve


def serve_units(run: Callable[[Unit, Plan], dict[str, Any]], version: str) -> None:
    """Run the requested units until standard input ends.

    Args:
        run: Returns the result of a unit, which a model plans where its setting has one.
        version: The version of the program that its results are for; requests for others are refused.
    """

    def handle(request: dict[str, Any]) -> dict[str, Any]:
        check_version(request["version"], version)
        unit, plan = Unit.from_json(request), plan_offline
        if (model := unit.setting.model) is not None:
            plan = ModelPlan.of(model, Path(request["folder"]), request["place"], request)
        result: dict[str, Any] = plain(run(unit, plan))
        return result

    serve(handle)


def main() -> None:
    """Run units of the executor itself."""
    serve_units(_run, outcome_version())


def _run(unit: Unit, plan: Plan) -> dict[str, Any]:
    return run_wish(unit.seed, plan) if unit.family == FAMILY else run_unit(unit, plan=plan)


if __name__ == "__main__":
    main()
