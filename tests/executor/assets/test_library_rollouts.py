"""The robot opens and closes every model that opens, and picks up what fits between its fingers."""

from __future__ import annotations

from dataclasses import replace

import pytest

import executor
import oag
from executor.assets.library import LIBRARY, kind, sample
from oag import Scene, SceneObject, Task
from oag.model.scene import RobotPose
from oag.model.symbols import Kind

pytestmark = [pytest.mark.physics, pytest.mark.slow]
OPENED = sorted(model for model in LIBRARY if kind(LIBRARY[model]) is Kind.ARTICULATED)
PICKED = (
    *("bottle", "book_upright", "carton", "cup", "die", "half_apple", "medicine_bottle", "mug", "orange", "plate"),
    "tumbler",
)
FRONT_X_M = 0.75
COUNTER_M = 0.50
TABLE_M = (0.5, 0.9, 0.6)
AIM_M = 0.05


def run(name: str, objects: dict[str, SceneObject], fact: str, *subtasks: dict[str, object], scale: float = 1.0) -> str:
    """Return why a subtask failed, or nothing."""
    scene = Scene(
        name=name,
        robot=RobotPose(position=(-0.4, 0.2, 0.0)),
        objects=objects,
        facts=(*Scene.from_json({"objects": _boxes(objects), "facts": [fact]}).facts,),
        closed=frozenset({"ontop", "inside", "open"}),
    )
    target = str(subtasks[0]["target"])
    scene = scene.with_scales({target: scale}) if scale != 1.0 else scene
    named = [{"task_activity_name": f"{name}_{index}", **subtask} for index, subtask in enumerate(subtasks)]
    task = {"task_activity_name": name, "goal": subtasks[-1]["goal"], "sub_tasks": named}
    rollout = executor.rollout(oag.compose(Task.from_json(task, scene=scene)), scene, seed=0)
    return "" if rollout.succeeded else str(rollout.failure)


def _boxes(objects: dict[str, SceneObject]) -> dict[str, object]:
    return {key: {"category": o.category, "bbox_extent": list(o.bbox_extent)} for key, o in objects.items()}


@pytest.mark.parametrize("model", OPENED)
def test_it_is_opened_and_closed(model: str) -> None:
    fixture = sample(model, 0, "fixture_0")
    depth, _, height = fixture.extent_m
    objects, floor = {}, 0.0
    if model.startswith("microwave"):
        floor = COUNTER_M
        counter = sample("counter_plain", 0, "counter_0")
        objects["counter_0"] = replace(counter, bbox_extent=(0.55, 0.7, floor), position=(1.125, 0.0, floor / 2))
    objects["fixture_0"] = replace(fixture, position=(FRONT_X_M + depth / 2, 0.0, floor + height / 2))
    shut, opened = "(not (open fixture_0))", "(open fixture_0)"
    opening = {"target": "fixture_0", "init": shut, "goal": opened, "flow": [17, 1, 2, 3, {"4": None}, 5, 6]}
    closing = {"target": "fixture_0", "init": opened, "goal": shut, "flow": [17, 1, 2, 3, {"19": None}, 5, 6]}
    assert run("open_and_close_it", objects, shut, opening, closing) == ""


@pytest.mark.parametrize("model", PICKED)
def test_it_is_picked_up(model: str) -> None:
    item, table = sample(model, 0, "item_0"), sample("table_four_legs", 0, "table_0")
    length, _, height = TABLE_M
    place = (1.2 - length / 2 + 0.10, 0.0, height + item.extent_m[2] / 2)
    objects = {
        "table_0": replace(table, bbox_extent=TABLE_M, position=(1.2, 0.0, height / 2)),
        "item_0": replace(item, position=place),
    }
    subtask = {
        "target": "item_0",
        "support_init": "table_0",
        "init": "(ontop item_0 table_0)",
        "goal": "(inside item_0 gripper)",
        "flow": [17, 1, 2, 3, {"7": None}],
    }
    scale = min(1.0, AIM_M / min(item.extent_m[:2]))
    assert run("pick_it", objects, "(ontop item_0 table_0)", subtask, scale=scale) == ""
