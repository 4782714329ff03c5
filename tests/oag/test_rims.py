"""What has a wall to be held by may be wider than the gripper; what has none may not."""

from __future__ import annotations

import pytest

import oag
from oag.model.symbols import has_rim


@pytest.mark.parametrize(
    ("category", "expected"),
    [("bowl", True), ("soup_bowl", True), ("mug.n.04", True), ("apple", False), ("plate", False), ("bowl_lid", False)],
)
def test_the_last_word_of_a_category_says_whether_it_has_a_rim(category: str, expected: bool) -> None:
    assert has_rim(category) is expected


@pytest.mark.parametrize(("category", "codes"), [("bowl", []), ("apple", ["task/size"])])
def test_only_what_has_a_rim_may_be_wider_than_the_gripper(category: str, codes: list[str]) -> None:
    item = {"category": category, "bbox_extent": [0.15, 0.15, 0.05], "position": [0, 0, 0.6]}
    table = {"category": "table", "bbox_extent": [1, 1, 0.6], "position": [0, 0, 0.3]}
    scene = oag.Scene.from_json({"objects": {"item_0": item, "table_0": table}, "facts": ["(ontop item_0 table_0)"]})
    pick = {
        "task_activity_name": "pick",
        "task_detail_message": "",
        "target": "item_0",
        "support_init": "table_0",
        "support_goal": None,
        "init": "(ontop item_0 table_0)",
        "goal": "(not (ontop item_0 table_0))",
        "flow": [17, 1, 2, 3, {"7": 0.1}],
    }
    task = {
        "task_activity_name": "t",
        "task_detail_message": "",
        "goal": "(inside item_0 gripper)",
        "sub_tasks": [pick],
    }
    report = oag.compose(oag.Task.from_json(task | {"sub_tasks": [pick]}, scene=scene), scene=scene).verify()
    assert [error.code for error in report.errors] == codes
