"""Formulas beyond literals that fail: the false conjunct is blamed, since when it was false, and what mends it."""

from __future__ import annotations

import copy
from typing import Any

import oag
from tests.oag.other_tasks import closing, opening, picking, placing, scene, task

KITCHEN = scene(
    "kitchen",
    {"pen_0": "pen"},
    {"safe_0": "safe", "chest_0": "chest", "desk_0": "desk"},
    ["(ontop pen_0 desk_0)"],
)
EITHER = "(or (inside pen_0 safe_0) (inside pen_0 chest_0))"
SHUT = "(forall (?s - safe) (not (open ?s)))"
RIGHT = task(
    "put_away",
    f"(and {EITHER} {SHUT})",
    opening("safe_0"),
    picking("pen_0", "ontop", "desk_0"),
    placing("pen_0", "inside", "safe_0"),
    closing("safe_0"),
)


def verified(data: dict[str, Any]) -> oag.Report:
    """The report on a plan in the kitchen."""
    return oag.compose(oag.Task.from_json(data, scene=oag.Scene.from_json(KITCHEN))).verify()


def test_the_right_plan_is_proved() -> None:
    assert verified(RIGHT)


def test_only_the_false_part_is_blamed_with_the_step_that_made_it_false() -> None:
    data = copy.deepcopy(RIGHT)
    del data["sub_tasks"][3]
    error = verified(data).errors[0]
    assert error.message == f"{SHUT} is false: open(safe_0) since T1 step 5 ARTICULATE_OPEN"


def test_a_part_that_was_never_true_is_false_since_the_start_and_its_subtask_is_mended() -> None:
    data = copy.deepcopy(RIGHT)
    data["sub_tasks"][2]["goal"] = "(not (inside pen_0 safe_0))"
    report = verified(data)
    parts = "not inside(pen_0, safe_0) since the start, not inside(pen_0, chest_0) since the start"
    assert report.errors[0].message == f"{EITHER} is false: {parts}"
    assert str(report.fixes[0]).startswith(
        "change T3's goal from (not (inside pen_0 safe_0)) to (inside pen_0 safe_0)   [checked: all obligations hold]"
    )


def test_a_formula_of_one_part_is_not_repeated() -> None:
    data = copy.deepcopy(RIGHT)
    data["goal"] = SHUT
    del data["sub_tasks"][3]
    assert verified(data).errors[0].message == "it is false: open(safe_0) since T1 step 5 ARTICULATE_OPEN"
