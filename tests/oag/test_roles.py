"""The roles of subtasks: read off the conditions where a task leaves them out."""

from __future__ import annotations

from pathlib import Path

import pytest

import oag
from tests.oag.paper import NAMES, scene, task_json


def pairs_alone(*pairs: tuple[str, str]) -> oag.Task:
    """Return the task that says of its subtasks where they start and where they end, and no more."""
    return oag.Task.from_json({"sub_tasks": [{"init": init, "goal": goal} for init, goal in pairs]})


@pytest.mark.parametrize("name", NAMES)
def test_the_papers_table_of_states_is_enough(name: str) -> None:
    """The table of initial and goal states gives roles, flows and proof of every task."""
    data = task_json(name)
    pairs = [{"init": subtask["init"], "goal": subtask["goal"]} for subtask in data["sub_tasks"]]
    graph = oag.compose({"sub_tasks": pairs, "scales": data["scales"]}, scene(name))
    assert graph.verify().verdict is oag.Verdict.PROVED, str(graph.verify())
    for subtask, given in zip(graph.task.subtasks, data["sub_tasks"], strict=True):
        assert (subtask.target, subtask.support_goal) == (given["target"], given["support_goal"])
        assert subtask.support_init == given["support_init"]


def test_a_mistake_in_a_text_is_data() -> None:
    task = pairs_alone(("(not (open refrigerator_0)", "(open refrigerator_0)"))
    errors = oag.compose(task, scene("T1")).verify().errors
    assert [(error.code, error.subtask) for error in errors] == [("bddl/syntax", 0)]


def test_a_target_that_cannot_be_told_is_said() -> None:
    task = pairs_alone(("(ontop glass_0 table_0)", "(and (inside glass_0 refrigerator_0) (not (open refrigerator_0)))"))
    errors = oag.compose(task, scene("T1")).verify().errors
    assert [error.code for error in errors] == ["task/role-scope"]
    assert errors[0].message == (
        "the goal changes glass_0 and refrigerator_0, so it cannot be told which of them the subtask is about"
    )


def test_what_the_goal_repeats_is_not_the_target() -> None:
    task = pairs_alone(
        (
            "(and (open refrigerator_0) (inside glass_0 gripper))",
            "(and (open refrigerator_0) (inside glass_0 refrigerator_0))",
        )
    )
    assert task.subtasks[0].target == "glass_0"
    assert task.subtasks[0].support_goal == "refrigerator_0"


def test_roles_that_a_task_file_leaves_out_are_read_off() -> None:
    data = task_json("T1")
    for subtask in data["sub_tasks"]:
        for role in ("target", "support_init", "support_goal"):
            del subtask[role]
    assert oag.Task.from_json(data) == oag.Task.from_json(task_json("T1"))


def test_a_role_that_is_null_stays_null() -> None:
    data = task_json("T1")
    data["sub_tasks"][2]["support_goal"] = None
    assert oag.Task.from_json(data).subtasks[2].support_goal is None


def test_compose_takes_paths_and_mappings() -> None:
    path = Path(__file__).parent.parent / "data" / "T1.json"
    assert oag.compose(path, scene("T1")).task == oag.compose(task_json("T1"), scene("T1")).task
