"""Every baseline by its name: what makes a unit's plan, and what runs it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from executor.baselines.checking import checked, mistaken, repaired, unchecked
from executor.bench.units import Baseline, Unit, outcome_version
from executor.bench.work import run_unit
from executor.evolution.record import Evolution
from executor.machine.files import content_key
from executor.records.rollout import Rollout
from executor.scenes.pair import ScenePair
from oag import ObjectActionGraph

Way = Callable[[Unit, ScenePair, ObjectActionGraph], Rollout]

_MISTAKEN: dict[Baseline, Way] = {"unchecked": unchecked, "checked": checked, "repaired": repaired}


def baseline_version() -> str:
    """Returns 16 hexadecimal digits that change when a result of a baseline may not be repeated exactly."""
    executor = Path(__file__).resolve().parents[1]
    files = sorted(path for room in ("baselines", "envs") for path in (executor / room).rglob("*.py"))
    return content_key(outcome_version(), *(path.read_bytes() for path in files))


def run_baseline(unit: Unit) -> dict[str, Any]:
    """Returns the result of a unit whose setting names a baseline, in the form of any other unit's."""
    baseline = unit.setting.baseline
    if baseline is None:
        raise ValueError(f"{unit.name} names no baseline")
    kind, pair, graph = mistaken(unit)
    return {"mistake": kind, **run_unit(unit, ready=(pair, graph), run=_alone(_MISTAKEN[baseline]))}


def _alone(way: Way) -> Callable[[Unit, ScenePair, ObjectActionGraph], tuple[Rollout, Evolution | None]]:
    """Returns a way that has no revisions to tell of."""
    return lambda unit, pair, graph: (way(unit, pair, graph), None)
