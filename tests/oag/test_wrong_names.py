"""Roles and categories that no formula can name, and mistakes that move with their subtask: diagnostics, no crashes."""

from __future__ import annotations

from typing import Any

import pytest

import oag
from tests.json_edits import altered
from tests.oag.paper import DATA, scene, task_json, verify

NO_NAMES = ["table 0", "table_0\n", " table_0", "", "(and)", "?x", ";table_0", "\ud800"]


@pytest.mark.parametrize("name", NO_NAMES)
@pytest.mark.parametrize("role", ["target", "support_init", "support_goal"])
@pytest.mark.parametrize("index", [0, 1, 2])
def test_a_role_that_is_no_name_is_an_unknown_object(name: str, role: str, index: int) -> None:
    report = verify(altered(task_json("T1"), ("sub_tasks", index, role), name), "T1")
    assert report.verdict is oag.Verdict.REFUTED and str(report)
    first = report.errors[0]
    assert first.code == "bddl/unknown-object" and first.subtask == index and repr(name) in first.message
    assert first.place.endswith(role)


@pytest.mark.parametrize("index", range(4))
@pytest.mark.parametrize("step", ["GRISP", 99, {"7": "high"}])
def test_an_unreadable_step_beside_another_mistake(index: int, step: Any) -> None:
    """Repairs that leave out or move a subtask take its unreadable step with it."""
    data = task_json("T1")
    data["sub_tasks"][index]["flow"].append(step)
    for other in range(4):
        report = verify(altered(data, ("sub_tasks", other, "target"), "unheard_of_0"), "T1")
        assert str(report)
        assert {error.subtask for error in report.errors} == {index, other}
        for fix in report.fixes:
            fix.apply(report.task)


def test_a_mistake_is_told_of_the_place_that_its_subtask_has_now() -> None:
    data = task_json("T1")
    data["sub_tasks"][3]["goal"] = "(not (open"
    task = oag.Task.from_json(data, scene=scene("T1"))
    assert task.subtasks[3].issues[0].place == "goal"
    first, *_ = oag.Task("t", "", task.goal, True, task.subtasks[2:], scene=task.scene).subtasks
    shorter = oag.compose(oag.Task("t", "", task.goal, True, task.subtasks[2:], scene=task.scene)).verify()
    assert [(error.code, error.subtask) for error in shorter.errors] == [("bddl/syntax", 1)]
    assert shorter.errors[0].place == "T2 close_refrigerator, goal" and first is task.subtasks[2]


@pytest.mark.parametrize("category", ["water glass", "", "glass\n", "(glass)", "?glass"])
def test_a_category_that_no_quantifier_can_say_is_refused(category: str) -> None:
    data = scene("T1").to_json()
    with pytest.raises(oag.SceneError, match=r"objects\.glass_0\.category: .*cannot be used"):
        oag.Scene.from_json(altered(data, ("objects", "glass_0", "category"), category))


@pytest.mark.parametrize(
    ("path", "value"),
    [
        (("objects", "glass_0", "position"), [1e308, 0, 0]),
        (("objects", "glass_0", "position"), [0, 0, -1e308]),
        (("objects", "glass_0", "bbox_extent"), [1e308, 0.1, 0.1]),
        (("objects", "glass_0", "bbox_extent"), [5e-324, 0.1, 0.1]),
        (("objects", "glass_0", "scale"), [1e308, 1, 1]),
        (("objects", "glass_0", "scale"), [1e5, 1, 1]),
        (("objects", "glass_0", "orientation"), [1e308, 0, 0, 1e308]),
        (("robot", "position"), [1e308, 0, 0]),
        (("robot", "yaw"), 1e308),
    ],
)
def test_lengths_and_angles_are_those_of_a_room(path: tuple[str, ...], value: Any) -> None:
    data = oag.Scene.from_json(DATA / "T1_scene.json").to_json()
    with pytest.raises(oag.SceneError, match=r"expected .*[0-9]") as caught:
        oag.Scene.from_json(altered(data, path, value))
    assert ".".join(path) in str(caught.value)


@pytest.mark.parametrize("factor", [1e308, 1e-308])
def test_a_scale_beyond_all_sizes_is_refused(factor: float) -> None:
    with pytest.raises(oag.TaskError, match=r"scales\.glass_0: expected a number from"):
        oag.Task.from_json(task_json("T1") | {"scales": {"glass_0": factor}})


@pytest.mark.parametrize("width_m", [0.5, 20.0, 900.0])
def test_no_fix_scales_by_nothing(width_m: float) -> None:
    data = scene("T1").to_json()
    wide = oag.Scene.from_json(altered(data, ("objects", "glass_0", "bbox_extent"), [width_m, width_m, 0.1]))
    report = oag.compose(oag.Task.from_json(task_json("T1") | {"scales": {}}, scene=wide)).verify()
    assert "by 0," not in str(report) and '": 0}' not in str(report)
    for fix in report.fixes:
        scales = fix.apply(report.task).scales
        assert all(factor > 0.0 for factor in scales.values())


def test_a_long_flow_is_repaired_near_its_mistake() -> None:
    """All moves of one of 500 steps would be a quarter of a million flows of 500 steps each."""
    data = task_json("T1")
    data["sub_tasks"][3]["flow"] = [1, 2, 3, 4, 5] * 100
    report = verify(data, "T1")
    assert report.verdict is oag.Verdict.REFUTED and report.fixes
