"""Scenes and tasks that a Python program builds: texts are read, and what would be passed over is refused."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

import bddl
import oag
from oag.model.actions import flow_from_json
from oag.model.diagnostics import FlowError
from tests.oag.paper import scene, task_json

# Most of this does not pass the type checker, which is the point.
untyped: Any = oag
untyped_flow: Any = flow_from_json
FACTS = ("(ontop glass_0 table_0)", "(not (open refrigerator_0))")


def built(**changes: Any) -> oag.Scene:
    """The scene of T1, built anew with other arguments."""
    whole = scene("T1")
    given: dict[str, Any] = {"facts": whole.facts, "closed": whole.closed, "objects": whole.objects} | changes
    return oag.Scene("mine", whole.robot, given["objects"], given["facts"], given["closed"])


def task(scene: oag.Scene, **changes: Any) -> oag.Task:
    """One subtask that opens the refrigerator."""
    given: dict[str, Any] = {
        "target": "refrigerator_0",
        "init": "(not (open refrigerator_0))",
        "goal": "(open refrigerator_0)",
        "flow": [17, 1, 2, 3, {"4": [0.0, 0.6]}, 5],
    }
    given |= changes
    part = untyped.SimpleTask("open", "", given["target"], None, None, given["init"], given["goal"], given["flow"])
    return oag.Task("t", "", part.goal, True, (part,), scene=scene)


def test_facts_given_as_texts_count() -> None:
    """They were ignored: a scene that says the refrigerator is open had a plan PROVED that needs it shut."""
    assert built(facts=FACTS).facts == tuple(bddl.parse_formula(fact) for fact in FACTS)
    assert built(facts=list(FACTS)) == built(facts=tuple(map(bddl.parse_formula, FACTS)))
    contrary = built(facts=("(open refrigerator_0)",))
    assert oag.compose(task(contrary)).verify().verdict is oag.Verdict.REFUTED
    assert oag.compose(task(built(facts=FACTS))).verify()


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"facts": "(open refrigerator_0)"}, "facts: expected a list"),
        ({"facts": ("(open",)}, "facts[0]: "),
        ({"facts": ("(or (open refrigerator_0) (ontop glass_0 table_0))",)}, "a fact must be a literal"),
        ({"facts": (bddl.Or((bddl.Atom("open", ("refrigerator_0",)),)),)}, "a fact must be a literal"),
        ({"facts": ("(ontop glas_0 table_0)",)}, "unknown object 'glas_0' (did you mean glass_0?)"),
        ({"facts": ("(opened refrigerator_0)",)}, "has no predicate `opened`"),
        ({"facts": ("(open refrigerator_0)", "(not (open refrigerator_0))")}, "contradicts an earlier fact"),
        ({"facts": (("open", "refrigerator_0"),)}, "facts[0]: expected a string"),
        ({"closed": "inside open"}, 'closed: expected a list, got "inside open"'),
        ({"closed": {"insid"}}, "unknown predicate 'insid'"),
        ({"objects": {"glass_0": {"category": "glass"}}}, "objects.glass_0: expected a SceneObject"),
        ({"objects": None}, "objects"),
    ],
)
def test_what_a_scene_would_pass_over_is_refused(changes: dict[str, Any], said: str) -> None:
    with pytest.raises(oag.SceneError) as caught:
        built(**changes)
    assert said in str(caught.value)


def test_closed_may_be_any_collection_of_predicates() -> None:
    assert built(closed=["open", "inside"]).closed == built(closed={"open", "inside"}).closed == {"open", "inside"}


def test_a_changed_scene_is_checked_as_well() -> None:
    with pytest.raises(oag.SceneError, match="unknown object"):
        replace(scene("T1"), facts=("(ontop nothing_0 table_0)",))


def test_a_task_of_texts_is_the_task_of_its_file() -> None:
    data = task_json("T1")
    first = data["sub_tasks"][0]
    read = oag.Task.from_json(data, scene=scene("T1")).subtasks[0]
    given = untyped.SimpleTask(
        first["task_activity_name"],
        first["task_detail_message"],
        first["target"],
        first["support_init"],
        first["support_goal"],
        first["init"],
        first["goal"],
        first["flow"],
    )
    assert given == read and given.flow == read.flow
    mixed = replace(read, flow=untyped_flow([17, 1]) + (2, {"7": 0.2}))
    assert mixed.flow == flow_from_json([17, 1, 2, {"7": 0.2}])


@pytest.mark.parametrize(
    ("changes", "kind", "said"),
    [
        ({"init": "(open"}, oag.TaskError, "(argument): init: "),
        ({"goal": None}, oag.TaskError, "goal: expected a formula or its text, got None"),
        ({"goal": "open refrigerator_0"}, oag.TaskError, "goal: "),
        ({"target": None}, oag.TaskError, "target: expected the id of an object, got None"),
        ({"flow": [17, "GRISP"]}, FlowError, "item 1: unknown primitive 'GRISP'"),
        ({"flow": "17 1"}, FlowError, "expected a list such as [17, 1, 2, 3]"),
        ({"flow": 17}, FlowError, "expected a list"),
    ],
)
def test_what_is_no_condition_and_no_flow_is_refused(changes: dict[str, Any], kind: type[Exception], said: str) -> None:
    with pytest.raises(kind) as caught:
        task(scene("T1"), **changes)
    assert said in str(caught.value)


def test_a_task_takes_simple_tasks_and_a_goal() -> None:
    good = task(scene("T1"))
    assert replace(good, goal="(open refrigerator_0)") == good
    assert replace(good, subtasks=list(good.subtasks)) == good
    with pytest.raises(oag.TaskError, match=r"subtasks\[0\]: expected a SimpleTask"):
        replace(good, subtasks=({"target": "refrigerator_0"},))
    with pytest.raises(oag.TaskError, match="goal: "):
        replace(good, goal="(open")


@pytest.mark.parametrize("held", ["robot", "gripper", "table_0", "refrigerator_0"])
def test_the_gripper_holds_items_only(held: str) -> None:
    with pytest.raises(oag.SceneError, match=rf"facts\[0\]: the gripper cannot hold {held}"):
        built(facts=(f"(inside {held} gripper)",))
    assert built(facts=("(inside glass_0 gripper)",)) and built(facts=(f"(not (inside {held} gripper))",))
