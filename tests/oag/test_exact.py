"""Plans that three-valued progression leaves open are decided exactly; what it decides needs no solver."""

from __future__ import annotations

import json
import subprocess
import sys
from functools import partial
from typing import Any

import pytest

import oag
from bddl.smt import SolverAnswer
from oag import exact, progression
from oag.primitives.table import needed
from oag.progression import case_tree
from oag.verify.verify import verify
from tests.oag.paper import NAMES, scene, task_json
from tests.source_tree import ROOT

OBJECTS = {
    "cup_0": {"category": "cup", "bbox_extent": [0.05, 0.05, 0.1]},
    "cup_1": {"category": "cup", "bbox_extent": [0.05, 0.05, 0.1]},
    "box_0": {"category": "cabinet", "bbox_extent": [0.6, 0.6, 1.0]},
    "table_0": {"category": "table", "bbox_extent": [0.6, 0.6, 0.7]},
}


def report(goal: str, *facts: str, init: str = "(and)", closed: tuple[str, ...] = ()) -> oag.Report:
    """What is decided of taking cup_0 from the table, with a goal that is looked at in the end."""
    kitchen = oag.Scene.from_json({"objects": OBJECTS, "facts": list(facts), "closed": list(closed)})
    taking = {
        "target": "cup_0",
        "support_init": "table_0",
        "support_goal": None,
        "init": init,
        "goal": "(inside cup_0 gripper)",
        "flow": [17, 1, 2, 3, {"7": 0.1}],
    }
    return oag.compose(oag.Task.from_json({"goal": goal, "sub_tasks": [taking]}, scene=kitchen)).verify()


APART = "(not (inside cup_0 box_0))"
# What a thing might carry, its motion makes unknown: here the cup that is moved carries nothing.
EMPTY = ("(not (ontop cup_1 cup_0))", "(not (inside cup_1 cup_0))")


@pytest.mark.parametrize(
    "goal",
    [
        "(or (open box_0) (not (open box_0)))",
        "(imply (ontop cup_1 table_0) (ontop cup_1 table_0))",
        "(not (and (ontop cup_1 box_0) (ontop box_0 cup_1)))",
        "(forall (?x - cup) (not (ontop ?x ?x)))",
        "(not (ontop cup_1 cup_1))",
        "(forall (?x - cup) (imply (ontop ?x box_0) (not (ontop box_0 ?x))))",
        "(or (forn (0) (?x - cup) (inside ?x box_0)) (exists (?x - cup) (inside ?x box_0)))",
        "(or (fornpairs (1) (?x - cup) (?y - cabinet) (nextto ?x ?y)) (forall (?x - cup) (not (nextto ?x box_0))))",
    ],
)
def test_what_holds_either_way_is_proved_and_can_be_checked(goal: str) -> None:
    found = report(goal, APART, *EMPTY)
    assert found.verdict is oag.Verdict.PROVED, str(found)
    assert found.obligations[-1].cases
    assert oag.recheck(json.loads(json.dumps(found.certificate.to_json() if found.certificate else None)))


def test_a_converse_is_remembered_after_the_fact_is_gone() -> None:
    """That the cup stood on the table excludes that the table stood on the cup, and lifting it does not change that."""
    goal = "(not (ontop table_0 cup_0))"
    assert report(goal, APART, "(ontop cup_0 table_0)").verdict is oag.Verdict.PROVED
    assert report(goal, APART, init="(ontop cup_0 table_0)").assumptions[-1].startswith("ontop(cup_0, table_0)")
    assert report(goal, APART).verdict is oag.Verdict.CONDITIONAL


@pytest.mark.parametrize(
    ("goal", "facts", "assumed"),
    [
        ("(or (open box_0) (ontop cup_1 box_0))", (APART,), ["open(box_0)"]),
        (
            "(and (or (open box_0) (ontop cup_1 box_0)) (not (open box_0)))",
            (APART,),
            ["not open(box_0)", "ontop(cup_1, box_0)"],
        ),
        ("(forn (1) (?x - cup) (ontop ?x box_0))", (APART,), ["ontop(cup_1, box_0)"]),
        ("(and (ontop cup_1 box_0) (not (ontop box_0 cup_1)))", (APART,), ["ontop(cup_1, box_0)"]),
        ("(and)", (), ["not inside(cup_0, box_0)"]),
        ("(open box_0)", (), ["open(box_0)"]),
    ],
)
def test_a_conditional_plan_lists_what_it_needs_and_no_more(
    goal: str, facts: tuple[str, ...], assumed: list[str]
) -> None:
    found = report(goal, *facts)
    assert found.verdict is oag.Verdict.CONDITIONAL
    assert found.trace is not None
    said = [assumption.condition.text() for assumption in found.trace.assumptions if assumption.condition is not None]
    assert sorted(said) == sorted(assumed), str(found)
    assert oag.recheck(found.certificate)


def test_no_run_means_refuted_with_one_run_that_fails() -> None:
    found = report(
        "(and (or (open box_0) (ontop cup_1 box_0)) (not (ontop cup_1 box_0)))", APART, init="(not (open box_0))"
    )
    assert found.verdict is oag.Verdict.REFUTED
    assert [(o.kind, o.grade.value) for o in found.obligations][-1] == ("task-goal", "FAILS")
    run = found.counterexample
    assert run is not None
    start = dict(run.start)
    assert start["open", "box_0"] is False
    assert start["ontop", "cup_1", "box_0"] is False
    assert [moment.step.primitive.name for moment in run.moments][-1] == "LIFT_EEF_UP"
    assert str(run).splitlines()[-2:] == ["T1.5 LIFT_EEF_UP: eef(free)", "fails: the task goal"]
    assert oag.recheck(found.certificate)
    assert "in every state in which the plan gets here" in found.errors[0].message


CARRIED = ("(open box_0)", "(not (inside cup_0 cup_1))")
CUP_IN_BOX = "(inside cup_0 box_0) (ontop cup_1 cup_0)"


@pytest.mark.parametrize(
    ("facts", "init"),
    [
        ((*CARRIED, "(ontop cup_1 cup_0)", "(not (inside cup_1 box_0))"), "(inside cup_0 box_0)"),
        ((*CARRIED, "(not (inside cup_1 box_0))"), f"(and {CUP_IN_BOX})"),
        ((*CARRIED, "(ontop cup_0 cup_1)"), "(inside cup_1 cup_0)"),
    ],
)
def test_a_plan_whose_assumptions_no_start_meets_is_refuted(facts: tuple[str, ...], init: str) -> None:
    """A thing is inside what its carrier is inside, and nothing carries what it stands on."""
    found = report("(and)", *facts, init=init)
    assert found.verdict is oag.Verdict.REFUTED, str(found)
    result = oag.recheck(found.certificate)
    assert result, result.reason


def test_what_follows_from_what_carries_what_is_not_assumed() -> None:
    found = report("(and)", *CARRIED, init=f"(and {CUP_IN_BOX} (inside cup_1 box_0))")
    assert found.verdict is oag.Verdict.CONDITIONAL, str(found)
    assert found.trace is not None
    said = [assumption.condition.text() for assumption in found.trace.assumptions if assumption.condition is not None]
    assert len(said) == 2 and set(said) < {"inside(cup_0, box_0)", "ontop(cup_1, cup_0)", "inside(cup_1, box_0)"}
    result = oag.recheck(found.certificate)
    assert result, result.reason


def test_what_contradicts_itself_is_refuted() -> None:
    found = report("(and (open box_0) (or (not (open box_0)) (ontop cup_1 cup_1)))", APART)
    assert found.verdict is oag.Verdict.REFUTED
    assert oag.recheck(found.certificate)


def test_a_wrong_first_choice_is_not_a_refutation() -> None:
    """That the cup is not in the box would do for GRASP, but in the end it has to be in it: so the box is open."""
    kitchen = oag.Scene.from_json({"objects": OBJECTS, "facts": []})
    taking: dict[str, Any] = {"target": "cup_0", "support_goal": None, "init": "(and)", "flow": [17, 1, 2, 3]}
    task = {"goal": "(inside cup_0 box_0)", "sub_tasks": [{**taking, "goal": "(inside cup_0 gripper)"}]}
    found = oag.compose(oag.Task.from_json(task, scene=kitchen)).verify()
    assert found.verdict is oag.Verdict.CONDITIONAL
    assert [line.partition(":")[0] for line in found.assumptions[-2:]] == ["inside(cup_0, box_0)", "open(box_0)"]
    assert oag.recheck(found.certificate)


def test_the_solver_is_not_loaded_where_progression_decides() -> None:
    code = (
        "import sys, oag\n"
        "task = oag.Task.from_json('tests/data/T1.json', scene=oag.Scene.from_json('tests/data/T1_scene.json'))\n"
        "assert oag.compose(task).verify()\n"
        "print('z3' in sys.modules)"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, timeout=600, check=True
    )
    assert done.stdout.strip() == "False"


@pytest.mark.parametrize("name", NAMES)
def test_the_solver_proves_the_papers_plans_too(name: str) -> None:
    task = oag.Task.from_json(task_json(name))
    assert verify(task, scene(name), exact=True).verdict is oag.Verdict.PROVED


def test_without_an_answer_nothing_is_claimed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(exact, "solve", lambda text: SolverAnswer("unknown", reason="timeout"))
    found = report("(or (open box_0) (not (open box_0)))", APART)
    assert found.verdict is oag.Verdict.CONDITIONAL
    assert found.certificate is None
    assert [finding.code for finding in found.diagnostics][-1] == "context/undecided"


def test_cases_that_are_too_many_are_left_to_the_solver(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(progression, "case_tree", partial(case_tree, largest=2))
    found = report("(or (and (open box_0) (ontop cup_1 box_0)) (not (open box_0)) (not (ontop cup_1 box_0)))", APART)
    assert found.verdict is oag.Verdict.PROVED
    assert found.certificate is None


def test_a_distinction_lists_every_case_and_no_more() -> None:
    """Half of the formula's cases are decided by the first fact alone."""
    formula = oag.Task.from_json(
        {"goal": "(or (and (open a) (open b)) (not (open a)) (not (open b)))", "sub_tasks": []}
    ).goal
    assert case_tree(needed(formula), lambda fact: None, {}) == (True, (("open", "a"), ("open", "b"), None, None, None))
    assert case_tree(needed(formula), lambda fact: None, {}, largest=2) is None


def test_a_formula_that_may_be_either_has_no_distinction() -> None:
    formula = oag.Task.from_json({"goal": "(or (open a) (open b))", "sub_tasks": []}).goal
    assert case_tree(needed(formula), lambda fact: None, {}) is None
