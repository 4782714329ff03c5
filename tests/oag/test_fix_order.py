"""Which fix is offered first: the smallest one, and of those what keeps most of what the plan says; and no crashes."""

from __future__ import annotations

from typing import Any

import pytest

import oag
from oag.model.diagnostics import FixError
from oag.verify.edits import MoveSubtask
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


@pytest.mark.parametrize("places", [(4, 0), (0, 4), (-1, 0)])
def test_a_move_to_or_from_no_place_is_refused(places: tuple[int, int]) -> None:
    """A fix of a plan that has grown is tried on the plan as it was: that is refused, and no crash."""
    task = oag.Task.from_json(task_json("T1"))
    with pytest.raises(FixError, match="the task has 4"):
        MoveSubtask(*places).apply(task)


def test_fixes_together_that_move_what_was_inserted() -> None:
    """Three mistakes; what mends them all inserts a subtask and moves another to a place that the plan has not yet."""
    opened = {
        "target": "fridge_0",
        "init": "(open fridge_0)",
        "goal": "(not (open fridge_0))",
        "flow": [17, 1, 2, 3, 19, 5],
    }
    taken = [
        {"target": name, "init": f"(ontop {name} table_0)", "goal": f"(not (ontop {name} table_0))", "flow": flow}
        for name, flow in (("apple_0", [17, 1, 2, 3, 7]), ("cup_0", [17, 2, 3, 7]))
    ]
    kinds = {"apple_0": "apple", "cup_0": "cup", "fridge_0": "fridge", "cabinet_0": "cabinet", "table_0": "table"}
    sizes = {"apple_0": [0.05, 0.05, 0.1], "cup_0": [0.05, 0.05, 0.1]}
    things = {key: {"category": kind, "bbox_extent": sizes.get(key, [0.6, 0.6, 1.0])} for key, kind in kinds.items()}
    facts = ["(ontop apple_0 table_0)", "(ontop cup_0 table_0)"]
    scene = oag.Scene.from_json({"objects": things, "facts": facts, "closed": ["ontop", "inside", "open"]})
    report = oag.compose({"goal": "(and)", "sub_tasks": [*taken, opened]}, scene).verify()
    assert report.verdict is oag.Verdict.REFUTED
    for fix in report.fixes:
        assert bool(oag.compose(fix.apply(report.task), scene).verify()) is fix.proves
