"""The paper's tasks T1 to T4 as the tests use them, and every flow that its tables and raw outputs print."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import oag

DATA = Path(__file__).parent.parent / "data"
GOLDEN = Path(__file__).parent.parent / "golden"
NAMES = ("T1", "T2", "T3", "T4")
INVALID = tuple(sorted(path.stem for path in (DATA / "invalid").glob("*.json")))


def _evolved() -> Iterator[tuple[str, int, list[Any]]]:
    """(Task, index of the subtask, flow): what the evolution tables and raw outputs print beyond the initial flows."""
    printed = json.loads((DATA / "paper_evolution.json").read_text(encoding="utf-8"))
    for name, entries in printed.items():
        yield from ((name, entry["subtask"], entry["flow"]) for entry in entries if entry["iteration"])


EVOLVED: tuple[tuple[str, int, list[Any]], ...] = tuple(_evolved())
# What the offline planner writes; the executor fills in the numbers.
UNFILLED: list[list[Any]] = [
    [17, 1, 2, 3, {"4": None}, 5, 6],
    [17, 1, 2, 3, {"7": None}],
    [18, {"13": None}, {"8": None}, 5, 6],
    [17, 1, 2, 3, {"19": None}, 5, 6],
]


def scene(name: str) -> oag.Scene:
    """The scene of a task."""
    return oag.Scene.from_json(DATA / f"{name}_scene.json")


def task_json(name: str) -> dict[str, Any]:
    """A task's JSON, to be changed at will."""
    data: dict[str, Any] = json.loads((DATA / f"{name}.json").read_text(encoding="utf-8"))
    return data


def verify(data: dict[str, Any], scene_name: str) -> oag.Report:
    """The report on a task in one of the scenes."""
    return oag.compose(oag.Task.from_json(data, scene=scene(scene_name))).verify()


def invalid(name: str) -> oag.Report:
    """The report on one of the invalid variants of T1."""
    return verify(json.loads((DATA / "invalid" / f"{name}.json").read_text(encoding="utf-8")), "T1")


def assert_golden(name: str, text: str) -> None:
    """Compare a text with its golden file; REWRITE_GOLDEN=1 in the environment writes the file instead."""
    golden = GOLDEN / f"oag_{name}.txt"
    if os.environ.get("REWRITE_GOLDEN") == "1":
        golden.write_text(text + "\n", encoding="utf-8")
    assert text + "\n" == golden.read_text(encoding="utf-8")
