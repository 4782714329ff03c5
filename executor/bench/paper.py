"""Printed results of the paper: its main table, and its planner's flows before any evolution."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from importlib import resources
from typing import Any

from bddl.errors import Scene2DemoError
from oag import Task, flow_from_json

_DATA = resources.files(__package__) / "data"


class NoPaperFlow(Scene2DemoError, ValueError):
    """The paper prints no flows for this family, or for a decomposition of this length."""


@dataclass(frozen=True, slots=True)
class PaperRow:
    """One row of the paper's main table.

    Attributes:
        method: The method.
        cells: Family -> success rate and subtask-level score in percent; families without numbers are absent.
    """

    method: str
    cells: Mapping[str, tuple[float, float]]


def main_table() -> tuple[PaperRow, ...]:
    """Return the rows of the paper's main table that have numbers, as printed; its fifth has "fail" or "success"."""
    rows = _read("main_comparison.json")["rows"]
    return tuple(
        PaperRow(row["method"], {key: tuple(cell) for key, cell in row.items() if key != "method" and cell})
        for row in rows
    )


def families_with_flows() -> tuple[str, ...]:
    """Return the families whose initial flows the paper prints."""
    return tuple(sorted(key for key in _read("initial_flows.json") if key != "source"))


def with_paper_flows(task: Task, family: str) -> Task:
    """Replace a task's flows by the paper's initial flows, numbers verbatim.

    Raises:
        NoPaperFlow: The paper prints none for the family, or for another number of subtasks.
    """
    flows = _read("initial_flows.json")
    if family == "source" or family not in flows:
        raise NoPaperFlow(f"the paper prints no flows for {family}; it does for {', '.join(families_with_flows())}")
    if len(flows[family]) != len(task.subtasks):
        raise NoPaperFlow(
            f"the paper's {family} has {len(flows[family])} subtasks, but {task.name} was decomposed into "
            f"{len(task.subtasks)}"
        )
    subtasks = tuple(
        replace(subtask, flow=flow_from_json(flow)) for subtask, flow in zip(task.subtasks, flows[family], strict=True)
    )
    return replace(task, subtasks=subtasks)


def _read(name: str) -> dict[str, Any]:
    found: dict[str, Any] = json.loads((_DATA / name).read_text(encoding="utf-8"))
    return found
