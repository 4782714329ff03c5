"""Tasks from BDDL: problems, texts, files and pairs; roles are read off the conditions."""

from __future__ import annotations

from pathlib import Path

import pytest

import bddl
import oag
from tests.oag.paper import NAMES, scene, task_json

PROBLEM = """(define (problem open_refrigerator)
    (:domain omnigibson)
    (:objects refrigerator_0 - fridge)
    (:init (not (open refrigerator_0)))
    (:goal (open refrigerator_0)))"""


@pytest.mark.parametrize("name", NAMES)
def test_the_papers_table_of_states_is_enough(name: str) -> None:
    """The table of initial and goal states gives roles, flows and proof of every task."""
    data = task_json(name)
    pairs = [(subtask["init"], subtask["goal"]) for subtask in data["sub_tasks"]]
    graph = oag.compose(oag.Task.from_bddl(pairs, scales=data["scales"], scene=scene(name)))
    assert graph.verify().verdict is oag.Verdict.PROVED, str(graph.verify())
    for subtask, given in zip(graph.task.subtasks, data["sub_tasks"], strict=True):
        assert (subtask.target, subtask.support_goal) == (given["target"], given["support_goal"])
        assert subtask.support_init == given["support_init"]


def test_a_goal_may_be_given() -> None:
    pairs = [("(not (open refrigerator_0))", "(open refrigerator_0)")]
    task = oag.Task.from_bddl(pairs, goal="(not (open refrigerator_0))", name="t", scene=scene("T1"))
    assert task.goal_given and task.name == "t"
    assert [error.code for error in oag.compose(task).verify().errors] == ["goal/not-reached"]


def test_problems_texts_and_files_are_the_same(tmp_path: Path) -> None:
    file = tmp_path / "open.bddl"
    file.write_text(PROBLEM, encoding="utf-8")
    tasks = [oag.Task.from_bddl([form]) for form in (PROBLEM, file, str(file), bddl.parse(PROBLEM))]
    assert all(task == tasks[0] for task in tasks)
    assert tasks[0].subtasks[0].name == "open_refrigerator"
    assert oag.compose([file], scene("T1")).verify()


def test_formulas_are_taken_as_they_are() -> None:
    opened = bddl.parse_formula("(open refrigerator_0)")
    task = oag.Task.from_bddl([(bddl.Not(opened), opened)])
    assert task.subtasks[0].goal is opened


def test_a_mistake_in_a_text_is_data() -> None:
    task = oag.Task.from_bddl([("(not (open refrigerator_0)", "(open refrigerator_0)"), PROBLEM[:-1]])
    errors = oag.compose(task, scene("T1")).verify().errors
    assert [(error.code, error.subtask) for error in errors] == [("bddl/syntax", 0), ("bddl/syntax", 1)]


def test_a_target_that_cannot_be_told_is_said() -> None:
    pair = ("(ontop glass_0 table_0)", "(and (inside glass_0 refrigerator_0) (not (open refrigerator_0)))")
    errors = oag.compose([pair], scene("T1")).verify().errors
    assert [error.code for error in errors] == ["task/role-scope"]
    assert errors[0].message == (
        "the goal changes glass_0 and refrigerator_0, so it cannot be told which of them the subtask is about"
    )


def test_what_the_goal_repeats_is_not_the_target() -> None:
    pair = (
        "(and (open refrigerator_0) (inside glass_0 gripper))",
        "(and (open refrigerator_0) (inside glass_0 refrigerator_0))",
    )
    task = oag.Task.from_bddl([pair])
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


@pytest.mark.parametrize("wrong", [7, ("(open a)",), None])
def test_something_else_is_misuse(wrong: object) -> None:
    with pytest.raises(oag.TaskError):
        oag.Task.from_bddl([wrong])  # type: ignore[list-item]


def test_a_file_that_is_not_there_is_misuse() -> None:
    with pytest.raises(oag.TaskError, match=r"nowhere\.bddl"):
        oag.Task.from_bddl(["nowhere.bddl"])


def test_compose_takes_paths_and_mappings() -> None:
    path = Path(__file__).parent.parent / "data" / "T1.json"
    assert oag.compose(path, scene("T1")).task == oag.compose(task_json("T1"), scene("T1")).task
