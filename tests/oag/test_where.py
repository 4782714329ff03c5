"""Parts and spots in plans: what a plan may name, and that its canonical form keeps them."""

from __future__ import annotations

from dataclasses import replace

import pytest

import oag
from oag.model.diagnostics import TaskError
from oag.model.where import Where

_SCENE = oag.scene(
    {"cup_0": "cup", "fridge_0": "fridge", "table_0": "table", "table_1": "table", "bowl_0": "bowl"},
    ["(ontop cup_0 table_0)", "(ontop bowl_0 table_1)"],
    closed="all",
)


def _task(where: object, index: int = 1) -> oag.Task:
    plan = oag.task(
        _SCENE, steps=[oag.pick("cup_0"), oag.place("cup_0", ontop="table_1")], goal="(ontop cup_0 table_1)"
    )
    subtasks = list(plan.subtasks)
    subtasks[index] = replace(subtasks[index], where=where)  # type: ignore[arg-type]
    return replace(plan, subtasks=tuple(subtasks))


def test_the_canonical_form_keeps_a_spot() -> None:
    left, right = _task("left of bowl_0"), _task(Where("right of", "bowl_0"))
    assert [subtask.where for subtask in oag.canonical(left).subtasks] == [None, Where("left of", "bowl_0")]
    assert len({oag.canonical_digest(task) for task in (left, right, _task(None))}) == 3
    assert oag.canonical_digest(_task("left of Bowl_0")) == oag.canonical_digest(left)
    assert oag.canonical(oag.canonical(left)) == oag.canonical(left)


@pytest.mark.parametrize(
    ("where", "index", "code"),
    [
        ("left of ghost_0", 1, "bddl/unknown-object"),
        ("next to cup_0", 1, "task/role-scope"),
        ("next to table_1", 1, "task/role-scope"),
        ("next to gripper", 1, "task/role-scope"),
        ("third drawer", 1, "task/role-scope"),
        ("third drawer", 0, "task/role-scope"),
        ("left of bowl_0", 0, "task/role-scope"),
    ],
)
def test_a_part_or_a_spot_that_cannot_be_is_refuted(where: str, index: int, code: str) -> None:
    report = oag.compose(_task(where, index)).verify()
    assert report.verdict.value == "REFUTED" and [found.code for found in report.errors] == [code]


def test_the_text_of_a_part_or_a_spot_is_read() -> None:
    assert _task("left of bowl_0").subtasks[1].where == Where("left of", "bowl_0")
    assert oag.compose(_task("left of bowl_0")).verify()
    with pytest.raises(TaskError, match="where"):
        _task("bogus")
