"""Nested quantifiers multiply: what is too much is said, by the verifier and by the checker, and not waited for."""

from __future__ import annotations

import json
import re
from typing import Any

import pytest

import bddl
import oag
from bddl.grounding import count_ground_parts
from oag.exact import MOST_ASSUMED
from oag.wellformed import MOST_INSTANCES
from tests.forgeries import rehashed

OPENING: dict[str, Any] = {
    "target": "drawer_0",
    "init": "(and)",
    "goal": "(open drawer_0)",
    "flow": [17, 1, 2, 3, {"4": [0.0, 0.3]}, 5, 6],
}


def room(cups: int, *closed: str) -> oag.Scene:
    """A drawer, and cups of which it is known what they are in and on, and what else is listed."""
    objects: dict[str, Any] = {f"cup_{n}": {"category": "cup", "bbox_extent": [0.05] * 3} for n in range(cups)}
    objects["drawer_0"] = {"category": "drawer", "bbox_extent": [0.5, 0.5, 0.5]}
    return oag.Scene.from_json({"objects": objects, "closed": ["ontop", "inside", "open", *closed]})


def nested(word: str, depth: int) -> str:
    """So many quantifiers over cups, one in the other."""
    head = " ".join(f"({word} (?c{n} - cup)" for n in range(depth))
    return f"{head} (nextto ?c0 ?c{depth - 1})" + ")" * depth


def report(scene: oag.Scene, goal: str, *changes: dict[str, Any]) -> oag.Report:
    """The verdict on opening the drawer for a goal."""
    task = {"goal": goal, "sub_tasks": [OPENING | change for change in changes or ({},)]}
    return oag.compose(task, scene).verify()


@pytest.mark.parametrize(("word", "depth", "cups"), [("exists", 6, 20), ("forall", 3, 500), ("exists", 1500, 2)])
@pytest.mark.parametrize("field", ["init", "goal", "task goal"])
def test_too_many_instances_are_a_diagnostic(word: str, depth: int, cups: int, field: str) -> None:
    goal = nested(word, depth)
    change = {} if field == "task goal" else {field: goal}
    found = report(room(cups), goal if field == "task goal" else "(open drawer_0)", change)
    assert found.verdict is oag.Verdict.CONDITIONAL and found.errors == () and found.certificate is None
    (warning,) = found.diagnostics
    assert (warning.code, warning.severity) == ("bddl/too-many-instances", "warning")
    assert warning.place.endswith(field) and str(MOST_INSTANCES) in warning.message
    assert not oag.recheck(found) and json.loads(json.dumps(found.to_json()))["verdict"] == "CONDITIONAL"
    assert oag.canonical(found.task, found.scene) is not None


def test_without_a_flow_nothing_is_searched() -> None:
    assert not report(room(20), nested("exists", 6), {"flow": None})


def test_all_conditions_of_a_task_count_together() -> None:
    scene, once = room(60, "nextto"), "(forall (?a - cup) (forall (?b - cup) (not (nextto ?a ?b))))"
    assert report(scene, once)
    found = report(scene, once, {"init": once})
    assert [(said.code, said.place) for said in found.diagnostics] == [("bddl/too-many-instances", "task goal")]


def test_a_mistake_beside_too_many_instances_refutes_the_plan() -> None:
    found = report(room(20), nested("exists", 6), {"target": "lid_0"})
    assert found.verdict is oag.Verdict.REFUTED
    assert [error.code for error in found.errors] == ["bddl/unknown-object"]
    assert [said.code for said in found.diagnostics][-1] == "bddl/too-many-instances"


def test_a_category_without_objects_is_no_work() -> None:
    formula = bddl.parse_formula("(forall (?a - cup) (exists (?x - unicorn) (forall (?b - cup) (nextto ?a ?b))))")
    assert count_ground_parts(formula, room(10).categories, 1000) == 11


@pytest.mark.parametrize(
    ("text", "parts"),
    [
        ("(nextto cup_0 cup_1)", 1),
        ("(and (open drawer_0) (not (open drawer_0)))", 4),
        ("(forall (?a - cup) (nextto ?a cup_0))", 11),
        ("(exists (?a - object) (not (open ?a)))", 23),
        ("(forn (3) (?a - cup) (nextto ?a cup_0))", 11),
        ("(forpairs (?a - cup) (?b - cup) (nextto ?a ?b))", 101),
        ("(fornpairs (2) (?a - cup) (?b - drawer) (nextto ?a ?b))", 11),
    ],
)
def test_parts_are_counted_as_they_are_spelled_out(text: str, parts: int) -> None:
    assert count_ground_parts(bddl.parse_formula(text), room(10).categories, 1000) == parts


def test_a_checker_does_not_wait_for_a_forged_certificate() -> None:
    made = report(room(20), "(open drawer_0)").certificate
    assert made is not None
    data = made.to_json()
    for field in ("goal", "init"):
        forged: Any = rehashed(data)
        forged["plan"]["subtasks"][0][field] = nested("exists", 6)
        result = oag.recheck(rehashed(forged))
        assert not result and "more than" in result.reason
    forged = rehashed(data)
    forged["plan"]["goal"] = nested("forall", 6)
    result = oag.recheck(rehashed(forged))
    assert not result and re.search("more than [0-9]+", result.reason)


@pytest.mark.slow
def test_too_much_unknown_is_a_warning() -> None:
    """What the cups are next to is unknown, so that some 2,400 values would be assumed one by one."""
    cups = 50
    assert (cups * (cups - 1)) ** 2 > MOST_ASSUMED
    found = report(room(cups), "(forall (?a - cup) (forall (?b - cup) (not (nextto ?a ?b))))")
    assert found.verdict is oag.Verdict.CONDITIONAL
    assert "context/undecided" in [warning.code for warning in found.diagnostics]


@pytest.mark.slow
def test_a_distinction_of_too_many_cases_is_given_up() -> None:
    """Each cup is next to each other one or not, so that a tautology has 2 to the 400 cases of 1,600 parts each."""
    goal = "(forall (?a - cup) (forall (?b - cup) (or (nextto ?a ?b) (not (nextto ?a ?b)))))"
    found = report(room(20), goal)
    assert found and found.certificate is None


@pytest.mark.slow
def test_a_checker_gives_up_a_forged_distinction_of_cases() -> None:
    goal = "(forall (?a - cup) (forall (?b - cup) (or (nextto ?a ?b) (not (nextto ?a ?b)))))"
    made = report(room(40), "(open drawer_0)").certificate
    assert made is not None
    forged: Any = made.to_json()
    forged["plan"]["goal"] = goal
    tree: list[Any] = []

    def split(depth: int) -> None:
        if depth == 12:
            tree.append(None)
            return
        tree.append(["nextto", "cup_39", f"cup_{depth}"])
        split(depth + 1), split(depth + 1)

    split(0)
    forged["cases"] = [{"consumer": ["task-goal", 1, -1], "tree": tree}]
    assert not oag.recheck(rehashed(forged))
