"""A proposal's JSON: the paper's names, readable BDDL, and a task file."""

from __future__ import annotations

import json
from typing import Any

import pytest

import bddl
import llm
import oag
from tests.llm.kitchens import FAMILIES, FIRST_WORDS, SCENES

T1 = llm.propose("put the glass into the refrigerator", SCENES["kitchen_t1"])


def written() -> dict[str, Any]:
    """Return T1's proposal as read back from a file."""
    data: dict[str, Any] = json.loads(json.dumps(T1.to_json()))
    return data


SEVERAL = tuple(phrasing for phrasing in FAMILIES if phrasing.family in ("several_objects", "several_steps"))


@pytest.mark.parametrize(
    "phrasing", [p for p in FIRST_WORDS + SEVERAL if p.goal], ids=lambda p: f"{p.scene}: {p.query}"
)
def test_its_json_is_a_task_file(phrasing) -> None:  # type: ignore[no-untyped-def]
    scene = SCENES[phrasing.scene]
    proposal = llm.propose(phrasing.query, scene)
    written = json.loads(json.dumps(proposal.to_json()))
    assert oag.Task.from_json(written, scene=scene) == proposal.task
    texts = [written[f"sub_task_{number}"]["bddl"] for number in range(1, len(proposal.problems) + 1)]
    assert tuple(map(bddl.parse, texts)) == proposal.problems


def test_the_papers_names_are_used() -> None:
    data = written()
    assert data["task_activity_name"] == "open_the_refrigerator_and_put_the_glass_into_the_refrigerator"
    assert data["task_name"] == "put glass_0 into refrigerator_0"
    assert [key for key in data if key.startswith("sub_task")] == [f"sub_task_{number}" for number in (1, 2, 3, 4)]
    pick = data["sub_task_2"]
    assert pick["task_activity_name"] == "pick_up_glass"
    assert pick["scale"] == data["scales"]["glass_0"] == 0.71
    assert pick["bddl_category"] == {"glass_0": "water_glass", "table_0": "table"}
    assert pick["flow"] == [17, 1, 2, 3, {"7": None}]


def test_the_bddl_says_what_the_subtask_says() -> None:
    for subtask, key in zip(T1.task.subtasks, ("sub_task_1", "sub_task_2", "sub_task_3", "sub_task_4"), strict=True):
        problem = bddl.parse(written()[key]["bddl"])
        assert problem.name == subtask.name
        assert problem.init == bddl.conjuncts(subtask.init)
        assert problem.goal == subtask.goal


def test_a_proposal_is_a_task_file_too() -> None:
    task = oag.Task.from_json(written(), scene=SCENES["kitchen_t1"])
    assert task == T1.task
    assert oag.compose(task).verify().verdict is oag.Verdict.PROVED
