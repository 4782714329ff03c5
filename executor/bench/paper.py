"""The paper's main table, as printed."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from importlib import resources


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
    text = (resources.files(__package__) / "data" / "main_comparison.json").read_text(encoding="utf-8")
    rows = json.loads(text)["rows"]
    return tuple(
        PaperRow(row["method"], {key: tuple(cell) for key, cell in row.items() if key != "method" and cell})
        for row in rows
    )
