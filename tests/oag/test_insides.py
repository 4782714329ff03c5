"""Nothing is put into what has no inside: it is said wherever that is written, with what can be meant."""

from __future__ import annotations

import json

import pytest

import oag
from oag.certificate.recheck import digest
from oag.model.symbols import has_inside
from tests.oag.paper import scene, task_json, verify


@pytest.mark.parametrize(
    ("category", "expected"),
    [
        ("breakfast_table", False),
        ("apple", False),
        ("apples", False),
        ("plate.n.04", False),
        ("countertop", False),
        ("bottom_cabinet", True),
        ("refrigerator", True),
        ("bowl", True),
        ("apple_box", True),
        ("shelf", True),
        ("gizmo", True),
    ],
)
def test_the_last_word_of_a_category_says_whether_it_has_an_inside(category: str, expected: bool) -> None:
    assert has_inside(category) is expected


def test_a_goal_inside_a_table_is_put_on_it() -> None:
    """One mistake, said once, and mended in subtask, supports and task goal together."""
    data = task_json("T1")
    data["sub_tasks"][2] |= {"goal": "(inside glass_0 table_0)", "support_goal": "table_0"}
    data["goal"] = "(and (inside glass_0 table_0) (not (open refrigerator_0)))"
    report = verify(data, "T1")
    (error,) = report.errors
    assert (error.code, error.subtask) == ("bddl/kind", 2)
    assert error.hint == "what is on it is (ontop glass_0 table_0)"
    assert "also in task goal" in error.message
    first = report.fixes[0]
    assert first.proves and first.summary == "write (ontop glass_0 table_0) instead of (inside glass_0 table_0)"


def test_another_container_is_offered_with_its_support() -> None:
    data = task_json("T1")
    data["sub_tasks"][2]["goal"] = "(inside glass_0 table_0)"
    first = verify(data, "T1").fixes[0]
    assert first.proves
    assert first.summary == "write (inside glass_0 refrigerator_0) instead of (inside glass_0 table_0)"


@pytest.mark.parametrize("place", ["init", "goal", "task goal", "below a quantifier"])
def test_it_is_said_wherever_it_stands(place: str) -> None:
    data = task_json("T1")
    if place == "task goal":
        data["goal"] = "(inside glass_0 table_0)"
    elif place == "below a quantifier":
        data["goal"] = "(exists (?g - water_glass) (inside ?g table_0))"
    else:
        data["sub_tasks"][1][place] = "(inside glass_0 table_0)"
    report = verify(data, "T1")
    assert report.verdict is oag.Verdict.REFUTED
    assert [error.code for error in report.errors] == ["bddl/kind"]


@pytest.mark.parametrize(
    "denial", ["(not (inside glass_0 table_0))", "(not (open table_0))", "(not (ontop glass_0 glass_0))"]
)
@pytest.mark.parametrize("closed", [True, False])
@pytest.mark.parametrize("place", ["init", "goal", "task goal", "in a formula"])
def test_its_denial_holds(denial: str, closed: bool, place: str) -> None:
    data, world = task_json("T1"), scene("T1").to_json()
    if not closed:
        facts = ["(ontop glass_0 table_0)", "(not (open refrigerator_0))", "(not (inside glass_0 refrigerator_0))"]
        world |= {"closed": [], "facts": facts}
    if place in ("init", "goal"):
        data["sub_tasks"][0][place] = f"(and {data['sub_tasks'][0][place]} {denial})"
    else:
        said = denial if place == "task goal" else f"(imply (hot glass_0) (and {denial}))"
        data["goal"] = f"(and {data['goal']} {said})"
    report = oag.compose(data, oag.Scene.from_json(world)).verify()
    assert report.verdict is oag.Verdict.PROVED, report
    assert oag.recheck(report.certificate)


def test_that_nothing_is_in_the_robot_is_about_the_gripper() -> None:
    data = task_json("T1")
    data["goal"] = "(and (inside glass_0 refrigerator_0) (not (inside glass_0 robot)))"
    (error,) = verify(data, "T1").errors
    assert error.code == "bddl/kind" and error.hint == "the hand is called gripper: (inside glass_0 gripper)"


def test_a_scene_cannot_say_it() -> None:
    world = scene("T1").to_json() | {"facts": ["(inside glass_0 table_0)", "(not (inside refrigerator_0 table_0))"]}
    report = oag.compose(task_json("T1"), oag.Scene.from_json(world)).verify()
    error = report.errors[0]
    assert (error.code, error.subtask) == ("bddl/kind", None)
    assert error.message == "nothing can be inside table_0 (breakfast_table): it has no inside"


def test_the_hand_is_not_called_robot() -> None:
    data = task_json("T1")
    data["sub_tasks"][2]["init"] = "(inside glass_0 robot)"
    report = verify(data, "T1")
    (error,) = report.errors
    assert error.code == "bddl/kind" and error.hint == "the hand is called gripper: (inside glass_0 gripper)"
    first = report.fixes[0]
    assert first.proves and first.summary == "write (inside glass_0 gripper) instead of (inside glass_0 robot)"


IMPOSSIBLE = {
    "a table is open": "(exists (?x - breakfast_table) (open ?x))",
    "something is inside a table": "(exists (?x - breakfast_table) (inside glass_0 ?x))",
    "nothing else is open": "(exists (?x - object) (and (open ?x) (not (open refrigerator_0))))",
}


@pytest.mark.parametrize("goal", IMPOSSIBLE.values(), ids=IMPOSSIBLE)
def test_what_no_kind_allows_is_not_assumed_in_an_open_world(goal: str) -> None:
    """Kinds count for what a quantifier speaks of as for what is named: nothing has to be stated for it."""
    world = scene("T1").to_json() | {"facts": ["(not (open refrigerator_0))"], "closed": []}
    data = task_json("T1") | {"goal": goal}
    data["sub_tasks"] = data["sub_tasks"][:1]
    data["sub_tasks"][0]["flow"] = [17]
    data["sub_tasks"][0]["goal"] = "(and)"
    report = oag.compose(data, oag.Scene.from_json(world)).verify()
    assert report.verdict is oag.Verdict.REFUTED
    assert report.errors[0].code == "goal/not-reached"
    assert oag.recheck(report.certificate, scene=report.scene)


def test_a_certificate_cannot_assume_what_no_kind_allows() -> None:
    world = scene("T1").to_json() | {"facts": [], "closed": []}
    data = task_json("T1") | {"goal": "(exists (?x - object) (open ?x))", "sub_tasks": []}
    report = oag.compose(data, oag.Scene.from_json(world)).verify()
    assert report.verdict is oag.Verdict.CONDITIONAL and report.certificate is not None
    forged = json.loads(
        json.dumps(report.certificate.to_json()).replace('["open", "refrigerator_0"]', '["open", "table_0"]')
    )
    for entry in forged["assumptions"]:
        entry["text"] = entry["text"].replace("refrigerator_0", "table_0")
    result = oag.recheck(forged)
    assert not result and "assumed though it is known" in result.reason


def test_a_certificate_cannot_start_from_what_no_kind_allows() -> None:
    report = verify(task_json("T1"), "T1")
    assert report.certificate is not None
    forged = report.certificate.to_json()
    forged["scene"]["start"].append([["open", "table_0"], True])
    forged["scene_sha"] = digest(forged["scene"])
    result = oag.recheck(forged)
    assert not result and "cannot be for the kinds" in result.reason
