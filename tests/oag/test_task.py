"""Tasks: reading and writing, errors for malformed files, mistakes of the plan kept as data."""

from __future__ import annotations

from typing import Any

import pytest

import bddl
import oag
from oag.model.diagnostics import MissingScene
from tests.json_edits import altered
from tests.oag.paper import DATA, INVALID, NAMES, scene, task_json


@pytest.mark.parametrize("name", NAMES)
def test_json_round_trip(name: str) -> None:
    task = oag.Task.from_json(DATA / f"{name}.json", scene=scene(name))
    again = oag.Task.from_json(task.to_json(), scene=scene(name))
    assert again == task


@pytest.mark.parametrize("name", INVALID)
def test_wrong_plans_round_trip_too(name: str) -> None:
    task = oag.Task.from_json(DATA / "invalid" / f"{name}.json", scene=scene("T1"))
    again = oag.Task.from_json(task.to_json(), scene=scene("T1"))
    assert str(oag.compose(again).verify()) == str(oag.compose(task).verify())


def test_numbered_subtasks_are_read_in_order() -> None:
    """The paper's outputs number the subtasks; ten comes after two."""
    data = task_json("T3")
    first, second = data.pop("sub_tasks")
    data |= {"sub_task_10": second, "sub_task_2": first}
    task = oag.Task.from_json(data)
    assert [subtask.name for subtask in task.subtasks] == ["pick_up_apple", "put_apple_into_bowl"]


def test_both_names_of_the_description_are_read() -> None:
    data = task_json("T1")
    data["task_message_detail"] = data.pop("task_detail_message")
    assert oag.Task.from_json(data).detail == task_json("T1")["task_detail_message"]


@pytest.mark.parametrize(
    ("path", "value", "message"),
    [
        (("sub_tasks",), ..., "the field 'sub_tasks' is missing"),
        (("sub_tasks",), 3, "sub_tasks: expected a list, got 3"),
        (("sub_tasks", 1), "pick", 'sub_tasks[1]: expected an object, got "pick"'),
        (("sub_tasks", 1, "target"), 4, "sub_tasks[1].target: expected a string, got 4"),
        (("sub_tasks", 0, "init"), None, "sub_tasks[0].init: expected a string, got null"),
        (("sub_tasks", 0, "goal"), ["a"], 'sub_tasks[0].goal: expected a string, got ["a"]'),
        (("sub_tasks", 0, "flow"), "1, 2, 3", 'sub_tasks[0].flow: expected a list, got "1, 2, 3"'),
        (("goal",), 5, "goal: expected a string, got 5"),
        (("scales",), {"glass_0": 0}, "scales.glass_0: expected a number greater than 0, got 0"),
    ],
)
def test_malformed_tasks_raise_with_their_place(path: tuple[Any, ...], value: Any, message: str) -> None:
    with pytest.raises(oag.TaskError) as caught:
        oag.Task.from_json(altered(task_json("T1"), path, value))
    assert message in str(caught.value)


def test_a_task_without_a_scene_says_what_to_do() -> None:
    task = oag.Task.from_json(DATA / "T1.json")
    with pytest.raises(MissingScene, match=r"compose\(task, scene=scene\)"):
        oag.compose(task)
    assert oag.compose(task, scene("T1")).verify()


def test_tasks_built_in_memory() -> None:
    """The planner builds tasks from data types; mistakes in them are found just as in files."""
    task = oag.Task(
        name="open",
        detail="",
        goal=bddl.parse_formula("(open refrigerator_0)"),
        goal_given=True,
        subtasks=(
            oag.SimpleTask(
                name="open_refrigerator",
                detail="",
                target="refrigerator_0",
                support_init=None,
                support_goal=None,
                init=bddl.Atom("opened", ("refrigerator_0",)),
                goal=bddl.Atom("open", ("refrigerator_0", "table_0")),
                flow=(oag.Action(oag.Primitive.RETREAT, 0.5),),
            ),
        ),
        scene=scene("T1"),
    )
    codes = [error.code for error in oag.compose(task).verify().errors]
    assert codes == ["bddl/unknown-predicate", "bddl/arity", "flow/parameter"]


def test_composing_never_raises_for_a_wrong_plan() -> None:
    data = task_json("T1")
    data["goal"] = "(and"
    for subtask in data["sub_tasks"]:
        subtask |= {"target": "nothing_9", "support_goal": "gripper", "init": "", "goal": "((", "flow": [None, {}, 99]}
    data["scales"] = {"unheard_of_1": 2.0}
    report = oag.compose(oag.Task.from_json(data, scene=scene("T1"))).verify()
    assert report.verdict is oag.Verdict.REFUTED
    assert report.certificate is None
    assert len(report.regressed_goals) == 4
