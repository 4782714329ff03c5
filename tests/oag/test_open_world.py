"""What is unknown makes a plan conditional; formulas beyond literals are decided by Kleene evaluation."""

from __future__ import annotations

from typing import Any

import pytest

import oag
from oag.verify.verify import verify
from tests.oag.paper import scene, task_json


def report_with(data: dict[str, Any], **changes: Any) -> oag.Report:
    """The report on a variant of T1 in a variant of its scene."""
    kitchen = oag.Scene.from_json({**scene("T1").to_json(), **changes})
    return oag.compose(oag.Task.from_json(data, scene=kitchen)).verify()


def test_an_unknown_start_makes_the_plan_conditional() -> None:
    report = report_with(task_json("T1"), facts=["(not (open refrigerator_0))"], closed=[])
    assert report.verdict is oag.Verdict.CONDITIONAL
    assert not report
    opened = [finding for finding in report.diagnostics if finding.code == "context/open"]
    # Whether the glass is inside does not matter for grasping it: by then the refrigerator is open.
    assert [finding.literal for finding in opened] == ["ontop(glass_0, table_0)"]
    assert oag.recheck(report.certificate)


def test_stating_the_assumptions_proves_the_plan() -> None:
    facts = ["(not (open refrigerator_0))", "(ontop glass_0 table_0)"]
    assert report_with(task_json("T1"), facts=facts, closed=[]).verdict is oag.Verdict.PROVED


def test_each_unknown_fact_is_assumed_once() -> None:
    data = task_json("T1")
    for subtask in data["sub_tasks"][:2]:
        subtask["init"] = f"(and {subtask['init']} (inroom robot kitchen))"
    report = report_with(data)
    opened = [finding.literal for finding in report.diagnostics if finding.code == "context/open"]
    assert opened == ["inroom(robot, kitchen)"]


def test_what_carrying_makes_unknown_is_unknown() -> None:
    data = task_json("T1")
    data["goal"] = "(and (inside glass_0 refrigerator_0) (not (nextto glass_0 table_0)))"
    report = report_with(data, facts=["(ontop glass_0 table_0)", "(nextto glass_0 table_0)"])
    assert report.verdict is oag.Verdict.CONDITIONAL
    finding = next(finding for finding in report.diagnostics if finding.code == "context/open")
    assert "carrying something made it unknown" in finding.message


@pytest.mark.parametrize(
    ("goal", "verdict"),
    [
        ("(or (open refrigerator_0) (inside glass_0 refrigerator_0))", "PROVED"),
        ("(imply (open refrigerator_0) (ontop glass_0 table_0))", "PROVED"),
        ("(exists (?x - water_glass) (inside ?x refrigerator_0))", "PROVED"),
        ("(forall (?x - object) (not (open ?x)))", "PROVED"),
        ("(forn (1) (?x - object) (inside ?x refrigerator_0))", "PROVED"),
        ("(forn (0) (?x - water_glass) (inside ?x refrigerator_0))", "REFUTED"),
        ("(forpairs (?x - water_glass) (?y - fridge) (inside ?x ?y))", "PROVED"),
        ("(fornpairs (2) (?x - water_glass) (?y - fridge) (inside ?x ?y))", "REFUTED"),
        ("(or (open refrigerator_0) (ontop glass_0 table_0))", "REFUTED"),
        ("(or (open refrigerator_0) (hot glass_0))", "CONDITIONAL"),
        ("(not (or (hot glass_0) (inside glass_0 refrigerator_0)))", "REFUTED"),
    ],
)
def test_formulas_beyond_literals(goal: str, verdict: str) -> None:
    report = report_with({**task_json("T1"), "goal": goal})
    assert report.verdict.value == verdict, str(report)
    result = oag.recheck(report.certificate)
    assert result, result.reason


def test_a_quantifier_over_nothing_is_an_error() -> None:
    report = report_with({**task_json("T1"), "goal": "(forall (?x - glass) (inside ?x refrigerator_0))"})
    assert [(error.code, error.hint) for error in report.errors] == [
        ("bddl/unknown-category", "did you mean water_glass?")
    ]


def test_a_false_formula_says_what_makes_it_false() -> None:
    report = report_with({**task_json("T1"), "goal": "(or (open refrigerator_0) (ontop glass_0 table_0))"})
    message = report.errors[0].message
    assert "not open(refrigerator_0) since T4 step 5 ARTICULATE_CLOSE" in message
    assert "not ontop(glass_0, table_0) since" in message


def test_a_subtask_without_a_flow_leaves_the_rest_undecided_where_none_is_searched() -> None:
    data = task_json("T1")
    del data["sub_tasks"][1]["flow"]
    report = verify(oag.Task.from_json(data), scene("T1"))
    assert report.verdict is oag.Verdict.CONDITIONAL
    finding = next(finding for finding in report.diagnostics if finding.code == "flow/no-flow")
    assert (finding.subtask, finding.severity) == (1, "warning")
    assert report.certificate is None
    assert oag.compose(report.task, scene("T1")).verify()


def test_a_goal_that_holds_already_is_a_warning() -> None:
    data = task_json("T1")
    data["sub_tasks"].append({**data["sub_tasks"][3], "init": "(not (open refrigerator_0))"})
    report = report_with(data)
    assert report.verdict is oag.Verdict.PROVED
    finding = next(finding for finding in report.diagnostics if finding.code == "task/vacuous")
    assert (finding.subtask, finding.eai_label) == (4, "ADDITIONAL_STEP")


def test_cargo_is_noted() -> None:
    data = task_json("T3")
    facts = ["(ontop bowl_0 table_0)", "(inside apple_0 bowl_0)"]
    kitchen = oag.Scene.from_json({**scene("T3").to_json(), "facts": facts})
    pick = data["sub_tasks"][0]
    pick |= {"target": "bowl_0", "support_init": "table_0", "init": "(ontop bowl_0 table_0)"}
    pick["goal"] = "(inside bowl_0 gripper)"
    data |= {"sub_tasks": [pick], "goal": "(inside apple_0 bowl_0)"}
    report = oag.compose(oag.Task.from_json(data, scene=kitchen)).verify()
    assert report.verdict is oag.Verdict.PROVED
    notes = [finding for finding in report.diagnostics if finding.code == "locality/cargo"]
    assert [note.message for note in notes] == ["what is on or in bowl_0 moves along: inside(apple_0, bowl_0)"]


def test_letting_go_of_something_else_is_refused() -> None:
    data = task_json("T1")
    data["sub_tasks"][2]["target"] = "refrigerator_0"
    data["sub_tasks"][2] |= {"support_goal": None, "goal": "(open refrigerator_0)", "flow": [17, 5]}
    data["sub_tasks"].pop()
    data["goal"] = "(open refrigerator_0)"
    report = report_with(data)
    (error,) = report.errors
    assert (error.code, error.subtask, error.step) == ("flow/precondition", 2, 1)
    assert error.literal == "not inside(glass_0, gripper)"


def test_scene_facts_that_no_state_satisfies() -> None:
    report = report_with(task_json("T1"), facts=["(ontop glass_0 table_0)", "(ontop table_0 glass_0)"])
    assert [error.code for error in report.errors] == ["task/contradictory"]
    assert "excludes its converse" in report.errors[0].message


def test_holding_something_at_the_start() -> None:
    """A scene may say what is held; the reset then does not empty the hand."""
    data = task_json("T1")
    data["sub_tasks"] = data["sub_tasks"][2:]
    report = report_with(data, facts=["(inside glass_0 gripper)", "(open refrigerator_0)"])
    assert report.verdict is oag.Verdict.PROVED, str(report)
    assert not any("handempty" in text for text in report.assumptions)
    assert oag.recheck(report.certificate)
