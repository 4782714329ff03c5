"""What reports say of steps that change what their subtask is not about, and what can come of a step."""

from __future__ import annotations

from typing import Any

import oag
from tests.oag.paper import assert_golden, task_json, verify


def careless() -> dict[str, Any]:
    """T1, in which a visit to the refrigerator takes the glass along that was to be held where it stands."""
    data = task_json("T1")
    data["sub_tasks"][1] |= {"support_goal": "table_0", "flow": [17, 1, 2, 3]}
    data["sub_tasks"][1]["goal"] = "(and (inside glass_0 gripper) (ontop glass_0 table_0))"
    visit = {"target": "refrigerator_0", "support_goal": None, "init": "(and)", "goal": "(open refrigerator_0)"}
    visit["flow"] = [17]
    data["sub_tasks"][2] |= visit | {"task_activity_name": "look_into_refrigerator"}
    data["sub_tasks"].pop()
    data["goal"] = "(open refrigerator_0)"
    return data


def test_undoing_another_subtasks_goal_is_said() -> None:
    report = verify(careless(), "T1")
    assert report.verdict is oag.Verdict.PROVED
    assert_golden("clobbers", str(report))


def test_a_refuted_plan_names_who_undid_it_with_what_lacks_it() -> None:
    data = careless()
    data["goal"] = "(ontop glass_0 table_0)"
    report = verify(data, "T1")
    assert [error.code for error in report.errors] == ["goal/undone"]
    assert "locality/clobbers" not in {finding.code for finding in report.diagnostics}


def test_driving_off_with_something_else_is_outside_the_scope() -> None:
    data = task_json("T1")
    data["sub_tasks"][1] |= {"goal": "(inside glass_0 gripper)", "flow": [17, 1, 2, 3]}
    data["sub_tasks"][2] |= {"target": "refrigerator_0", "support_goal": None, "goal": "(and)", "flow": [17]}
    data["sub_tasks"].pop()
    data["goal"] = "(inside glass_0 gripper)"
    report = verify(data, "T1")
    said = [(finding.code, finding.message) for finding in report.diagnostics if finding.code.startswith("locality")]
    message = "undoes ontop(glass_0, table_0), while the subtask is about refrigerator_0"
    assert said == [("locality/outside-scope", message)]


def test_the_papers_plans_stay_within_their_scope() -> None:
    for name in ("T1", "T2", "T3", "T4"):
        report = verify(task_json(name), name)
        assert not [
            finding for finding in report.diagnostics if finding.severity == "warning" and "locality" in finding.code
        ]
