"""What the doors of the executor are handed: a graph, and a clear error for anything else."""

from __future__ import annotations

from typing import Any

import pytest

import executor
import oag
from tests.oag.paper import scene, task_json

untyped: Any = executor


@pytest.mark.parametrize("door", ["rollout", "evolve", "resume"])
def test_a_task_is_no_graph(door: str) -> None:
    task = oag.Task.from_json(task_json("T1"), scene=scene("T1"))
    more = (None, 0) if door == "resume" else ()
    with pytest.raises(
        oag.TaskError, match=r"expected an object-action graph, got Task.* \(oag\.compose\(task, scene\)"
    ):
        getattr(untyped, door)(task, *more)
