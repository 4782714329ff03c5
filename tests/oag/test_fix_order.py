"""Which fix is offered first: the smallest one, and of those what keeps most of what the plan says."""

from __future__ import annotations

from typing import Any

import oag
from tests.oag.paper import task_json, verify


def first_fix(data: dict[str, Any], name: str = "T1") -> str:
    """The summary of the first fix of a plan that is refuted."""
    report = verify(data, name)
    assert report.verdict is oag.Verdict.REFUTED
    return report.fixes[0].summary


def test_letting_go_comes_after_the_motions() -> None:
    """Letting go before moving in proves the symbols, and would drop the glass in front of the refrigerator."""
    data = task_json("T1")
    del data["sub_tasks"][2]["flow"][-1]
    assert first_fix(data) == "insert UNGRASP in T3 at the end"


def test_dropping_a_thing_is_no_small_change() -> None:
    """A glass in the hand keeps the door from being gripped: exchanging two subtasks keeps it, a fall does not."""
    data = task_json("T1")
    opening, picking = data["sub_tasks"][:2]
    data |= {"goal": "(open refrigerator_0)", "sub_tasks": [picking, opening]}
    opening["flow"] = [17, *opening["flow"]]
    assert first_fix(data) == "exchange T1 pick_up_glass and T2 open_refrigerator"


def test_an_initial_condition_comes_to_say_what_is_the_case() -> None:
    data = task_json("T1")
    data["sub_tasks"][1]["init"] = "(not (ontop glass_0 table_0))"
    assert first_fix(data) == "change T2's init from (not (ontop glass_0 table_0)) to (ontop glass_0 table_0)"


def test_a_wrong_name_is_still_a_wrong_name() -> None:
    data = task_json("T1")
    data["sub_tasks"][1] |= {"init": "(ontop glass_0 refrigerator_0)", "support_init": "refrigerator_0"}
    assert first_fix(data) == "name table_0 instead of refrigerator_0 in T2"
