"""Flows of the paper's evolution tables and raw outputs that run to their goals exactly as they are printed.

`python -m benchmarks.paper_flows` runs all of them, and says what comes of the others.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

import oag
from executor.rollouts.rollout import rollout
from oag.model.actions import flow_to_json
from tests.executor.rollouts.tasks import into_an_open_refrigerator
from tests.oag.paper import EVOLVED, NAMES, scene, task_json

pytestmark = [pytest.mark.physics, pytest.mark.slow]
PICK: list[Any] = [17, 1, 2, 3, {"7": 0.2}]
# Going in 0.3 m above where the glass is let go takes a compartment of that height.
ONE_SHELF = (0.5,)


@pytest.mark.parametrize(
    ("flow", "shelf_heights_m"),
    [
        ([18, {"13": 0.4}, {"9": 0.1}, 5], (0.42, 0.72)),
        ([18, {"15": 0.3}, {"13": 0.45}, 5], (0.42, 0.72)),
        ([18, {"15": 0.3}, {"13": 0.45}, {"9": 0.2}, {"8": 0.3}, 5], ONE_SHELF),
    ],
)
def test_it_runs_to_its_goal_as_it_is_printed(flow: list[Any], shelf_heights_m: tuple[float, ...]) -> None:
    task = into_an_open_refrigerator([PICK, flow], shelf_heights_m=shelf_heights_m)
    done = rollout(task, task.scene, 16003)
    assert done.succeeded, done.failure
    assert flow_to_json(done.subtasks[1].flow) == flow, "the numbers that were run are the printed ones"


def test_every_printed_flow_is_read_and_proved_in_its_task() -> None:
    printed = json.loads((Path(__file__).parents[2] / "data" / "paper_evolution.json").read_text(encoding="utf-8"))
    assert tuple(printed) == NAMES and len(EVOLVED) == 12
    for name, entries in printed.items():
        initial = {entry["subtask"]: entry["flow"] for entry in entries if not entry["iteration"]}
        assert [subtask["flow"] for subtask in task_json(name)["sub_tasks"]] == list(initial.values())
        for entry in entries:
            data = task_json(name)
            data["sub_tasks"][entry["subtask"]]["flow"] = entry["flow"]
            assert oag.compose(oag.Task.from_json(data, scene=scene(name)), scene=scene(name)).verify()
