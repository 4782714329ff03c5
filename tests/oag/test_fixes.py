"""Fixes: verified, said in words, applied, and written as JSON."""

from __future__ import annotations

import json
from typing import Any

import pytest

import bddl
import oag
from oag.model.diagnostics import FixError
from oag.model.symbols import ParameterKind, parameter_kind
from oag.verify.verify import verify as verify_alone
from tests.oag.paper import INVALID, invalid, scene, task_json, verify


@pytest.mark.parametrize("name", INVALID)
def test_the_first_fix_of_every_variant_proves_it(name: str) -> None:
    report = invalid(name)
    fix = report.fixes[0]
    assert fix.proves
    assert oag.compose(fix.apply(report.task), fix.apply_to_scene(report.scene)).verify()


def test_a_plan_that_is_proved_offers_none() -> None:
    report = verify(task_json("T1"), "T1")
    assert report.fixes == () and report.findings == report.diagnostics


def test_a_repaired_task_survives_json() -> None:
    report = invalid("dropped_open")
    repaired = report.fixes[0].apply(report.task)
    again = oag.Task.from_json(json.loads(json.dumps(repaired.to_json())), scene=report.scene)
    assert again == repaired
    assert oag.compose(again).verify()


@pytest.mark.parametrize(
    ("subtask", "field", "wrong", "right"),
    [
        (3, "goal", "(exists (?r - fridge) (open ?r))", "(exists (?r - fridge) (not (open ?r)))"),
        (2, "init", "(forall (?r - fridge) (not (open ?r)))", "(forall (?r - fridge) (open ?r))"),
        (
            0,
            "goal",
            "(and (open refrigerator_0) (exists (?g - water_glass) (inside ?g refrigerator_0)))",
            "(and (open refrigerator_0) (exists (?g - water_glass) (not (inside ?g refrigerator_0))))",
        ),
    ],
)
def test_a_literal_below_a_quantifier_is_negated_too(subtask: int, field: str, wrong: str, right: str) -> None:
    data = task_json("T1")
    data["sub_tasks"][subtask][field] = wrong
    report = verify(data, "T1")
    fix = next(fix for fix in report.fixes if fix.kind == "change-condition")
    assert str(fix).startswith(f"change T{subtask + 1}'s {field} from {wrong} to {right}")
    assert fix.proves and verify_alone(fix.apply(report.task), report.scene)


def test_why_an_insertion_comes_no_later_is_said() -> None:
    fix = invalid("dropped_open").fixes[0]
    assert (fix.kind, fix.subtask, fix.cause) == ("insert-subtask", 0, 0)
    assert fix.remark == "not before T2: the hand holds glass_0 since T1 step 4 GRASP"
    assert str(fix) == (
        'insert "open refrigerator_0" before T1   [checked: all obligations hold]\n'
        "(not before T2: the hand holds glass_0 since T1 step 4 GRASP)"
    )


def test_fixes_are_json() -> None:
    written = invalid("dropped_converge").to_json()
    fixes: Any = written["fixes"]
    assert fixes[0]["edits"][0] == {
        "op": "insert-step",
        "subtask": 3,
        "step": 2,
        "flow": [17, 1, 2, 3, {"19": [0.0, 0.5]}, 5],
    }
    diagnostics: Any = written["diagnostics"]
    assert diagnostics[0]["fixes"][0].startswith("(1) insert CONVERGE in T4 before step 3 GRASP")
    assert json.loads(json.dumps(written)) == written


def test_several_mistakes_are_mended_together() -> None:
    """The refrigerator is never opened, and the glass is never lifted."""
    data = task_json("T1")
    data["sub_tasks"].pop(0)
    data["sub_tasks"][0]["flow"].pop()
    report = verify(data, "T1")
    assert len(report.errors) == 2
    whole, *others = report.fixes
    assert whole.kind == "several" and whole.cause is None and whole.proves
    assert verify_alone(whole.apply(report.task), report.scene)
    assert {fix.cause for fix in others} == {0, 1}
    assert not any(fix.proves for fix in others)
    assert "all of it together" in str(report)


def test_several_errors_of_one_mistake_are_printed_as_one() -> None:
    data = task_json("T1")
    order = data["sub_tasks"]
    order[0], order[2] = order[2], order[0]
    report = verify(data, "T1")
    errors = [finding for finding in report.findings if finding.severity == "error"]
    assert len(errors) == 1 and errors[0].dependent > 0
    assert report.fixes[0].kind == "swap-subtasks"


def test_a_fact_that_is_missing_in_the_scene_is_only_assumed() -> None:
    """Nothing says where the glass is, and the scene claims to know: either the plan or the scene is wrong."""
    kitchen = oag.Scene.from_json({**scene("T1").to_json(), "facts": []})
    report = oag.compose(task_json("T1"), kitchen).verify()
    fact = next(fix for fix in report.fixes if fix.kind == "add-fact")
    assert fact.assumption and fact.proves
    assert "look before you trust it" in str(fact)
    changed = fact.apply_to_scene(report.scene)
    assert len(changed.facts) == 1 and oag.compose(fact.apply(report.task), changed).verify()
    carried = oag.compose(oag.Task.from_json(task_json("T1"), scene=kitchen)).verify()
    assert oag.compose(carried.fixes[carried_index(carried)].apply(carried.task)).verify()


def carried_index(report: oag.Report) -> int:
    return next(index for index, fix in enumerate(report.fixes) if fix.kind == "add-fact")


def test_a_stated_fact_is_never_contradicted() -> None:
    kitchen = oag.Scene.from_json({**scene("T1").to_json(), "facts": ["(not (ontop glass_0 table_0))"]})
    report = oag.compose(task_json("T1"), kitchen).verify()
    assert report.verdict is oag.Verdict.REFUTED
    assert not any(fix.kind == "add-fact" for fix in report.fixes)


def test_a_given_goal_is_the_last_thing_to_change() -> None:
    data = task_json("T1")
    data["goal"] = "(and (ontop glass_0 refrigerator_0) (not (open refrigerator_0)))"
    fixes = verify(data, "T1").fixes
    assert fixes[-1].kind == "change-task-goal"
    assert fixes[-1].summary == (
        "if that is what was meant, change the task goal from (ontop glass_0 refrigerator_0) to "
        "(inside glass_0 refrigerator_0)"
    )


@pytest.mark.parametrize("goal", ["(open refrigerator_0)", "(not (inside glass_0 refrigerator_0))"])
def test_what_was_wanted_is_not_denied(goal: str) -> None:
    """A plan that misses its goal meets the opposite; to want that instead is no repair."""
    data = task_json("T1")
    data["goal"] = goal
    fixes = verify(data, "T1").fixes
    assert fixes and "change-task-goal" not in {fix.kind for fix in fixes}
    del data["goal"]
    data["sub_tasks"] = data["sub_tasks"][:1]
    data["sub_tasks"][0]["flow"] = [17]
    fixes = verify(data, "T1").fixes
    assert fixes and "(not (open refrigerator_0))" not in " ".join(fix.summary for fix in fixes)


def test_another_relation_is_the_first_fix_of_a_wrong_one() -> None:
    """A glass on the refrigerator is not in it; a bowl on a table cannot be in it."""
    data = task_json("T1")
    data["sub_tasks"][2]["goal"] = "(ontop glass_0 refrigerator_0)"
    first = verify(data, "T1").fixes[0]
    assert first.proves and first.kind == "change-condition"
    assert first.summary == ("change T3's goal from (ontop glass_0 refrigerator_0) to (inside glass_0 refrigerator_0)")
    changed = first.apply(oag.Task.from_json(data)).subtasks[2]
    assert bddl.format(changed.goal) == "(inside glass_0 refrigerator_0)"


def test_no_condition_is_emptied() -> None:
    data = task_json("T1")
    data["sub_tasks"][2]["init"] = "(hot glass_0)"
    for fix in verify(data, "T1").fixes:
        changed = fix.apply(oag.Task.from_json(data))
        assert all(bddl.atoms(subtask.init) and bddl.atoms(subtask.goal) for subtask in changed.subtasks), fix


@pytest.mark.parametrize(
    ("item", "said"),
    [({"25": 0.3}, "LIFT_EEF_UP(0.3)"), ({"LIFT_UP": 0.3}, "LIFT_EEF_UP(0.3)"), (99, "LIFT_EEF_UP")],
)
def test_an_unknown_primitive_with_a_number_is_one_that_takes_it(item: object, said: str) -> None:
    data = task_json("T1")
    data["sub_tasks"][1]["flow"][-1] = item
    replaced = [fix for fix in verify(data, "T1").fixes if fix.kind == "replace-step"]
    assert replaced and replaced[0].proves
    assert said in replaced[0].summary if isinstance(item, dict) else replaced[0].summary
    written = data["sub_tasks"][2]["flow"] = [18, {"25": 0.3}, {"9": 0.45}, 5]
    data["sub_tasks"][1]["flow"][-1] = {"7": 0.2}
    for fix in verify(data, "T1").fixes:
        if fix.kind == "replace-step":
            (action,) = (a for a in fix.apply(oag.Task.from_json(data)).subtasks[2].flow or () if a.parameter == 0.3)
            assert len(written) == 4 and parameter_kind(action.primitive) is ParameterKind.DISTANCE_M


def test_a_goal_that_was_read_off_is_not_emptied() -> None:
    """Leaving out what fails would prove anything, so the goal of the whole plan has to be reached nevertheless."""
    data = task_json("T1")
    del data["goal"]
    data["sub_tasks"][3]["flow"].pop(2)
    report = verify(data, "T1")
    assert [fix.kind for fix in report.fixes if fix.kind == "delete-subtask"] == []
    assert report.fixes[0].kind == "insert-step"


def test_an_unknown_start_stays_unknown_after_a_fix() -> None:
    kitchen = oag.Scene.from_json({**scene("T1").to_json(), "closed": ["inside", "open"], "facts": []})
    data = task_json("T1")
    del data["sub_tasks"][3]["flow"][2]
    report = oag.compose(data, kitchen).verify()
    fix = report.fixes[0]
    assert not fix.proves and fix.remaining == 0
    assert "some things stay unknown" in str(fix)
    assert oag.compose(fix.apply(report.task), kitchen).verify().verdict is oag.Verdict.CONDITIONAL


def test_a_fix_does_not_fit_another_task() -> None:
    report = invalid("dropped_converge")
    short = oag.Task.from_json({"sub_tasks": []}, scene=scene("T1"))
    with pytest.raises(FixError, match="the task has 0"):
        report.fixes[0].apply(short)


def test_plans_without_the_scene_of_the_task_are_repaired() -> None:
    data = task_json("T1")
    data["sub_tasks"].pop(0)
    report = oag.compose(oag.Task.from_json(data), scene("T1")).verify()
    assert oag.compose(report.fixes[0].apply(report.task), scene("T1")).verify()
