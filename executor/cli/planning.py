"""What commands with many units share where a language model plans these: its specification and its budget."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from executor.cli.errors import BadOption, check
from executor.cli.options import ModelOptions

if TYPE_CHECKING:
    from executor.campaign.planning_model import PlanningModel


def planned_by_model(options: ModelOptions, workers: int, folder: Path) -> PlanningModel | None:
    """Return the model that plans the units, None for the offline planner; nothing is sent.

    Args:
        options: The typed options.
        workers: Number of processes.
        folder: Folder of the units.

    Raises:
        ModelConfigError: It is not configured, its key or file is missing, or a limit needs a price that is unknown.
        CassetteError: Its recording cannot be read, or what the models of the folder have used.
    """
    if options.model is None:
        given = {
            "--models": " ".join(options.models),
            "--temperature": options.temperature,
            "--model-seed": options.model_seed,
            "--max-tokens": options.max_tokens,
            "--max-cost-usd": options.max_cost_usd,
            "--max-time-s": options.max_time_s,
        }
        for name, value in given.items():
            check(value in ("", None), name, value, "--model with it")
        return None
    from executor.campaign.planning_model import MODULES_THAT_PLAN, PlanningModel, used_in
    from executor.cli.evolution_setup import by_module, connect_model
    from llm.client.connect import recording_of
    from llm.client.profiles import find_profile

    models = by_module(options.models)
    for name in (options.model, *models.values()):
        file, live = recording_of(name)
        if (live or file is None) and find_profile(live or name).serve and workers > 1:
            raise BadOption("--workers", workers, f"1 with {name}: each process would start a server for the file")
    connect_model(options, None, starts=False)
    planning = all(module in MODULES_THAT_PLAN for module in models)
    check(planning, "--models", " ".join(options.models), "modules 1 to 5: measurements judge the units of a campaign")
    in_order = tuple(sorted(models.items()))
    model = PlanningModel(options.model.strip(), in_order, options.temperature, options.model_seed)
    # Each unit would be refused alone.
    used_in(folder, model)
    return model


def budget_of(options: ModelOptions, *unit: object) -> dict[str, Any]:
    """Return the budget of a campaign for a request to a process; nothing without a model."""
    if options.model is None:
        return {}
    limits = {"tokens": options.max_tokens, "cost_usd": options.max_cost_usd, "time_s": options.max_time_s}
    return {"budget": limits}
