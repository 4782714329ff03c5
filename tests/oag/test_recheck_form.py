"""What a checker refuses though every link is right, and whether a certificate is about this task and this scene."""

from __future__ import annotations

import copy
import json
import math
from collections.abc import Callable
from typing import Any

import pytest

import bddl
import oag
from oag.certificate.formulas import read_formula
from oag.certificate.schema import schema_check
from tests.forgeries import VALIDATOR, rehashed, single_changes
from tests.json_edits import altered
from tests.oag.paper import DATA, NAMES, scene, task_json, verify
from tests.oag.test_recheck import SMALL, certificate, small

# A box on a table, which the robot only drives about and reaches for.
OBJECTS = {
    "table_0": {"category": "table", "bbox_extent": [1.0, 1.0, 0.7]},
    "box_0": {"category": "box", "bbox_extent": [0.05, 0.05, 0.05]},
}


def harmless(flow: list[Any], target: str = "table_0") -> Any:
    """The certificate of a plan that needs nothing, with another flow that needs nothing either."""
    room = oag.Scene.from_json({"objects": OBJECTS})
    subtask = {"target": target, "support_goal": None, "init": "(and)", "goal": "(and)", "flow": [6]}
    made = oag.compose({"goal": "(and)", "sub_tasks": [subtask]}, room).verify().certificate
    assert made is not None and oag.recheck(made)
    data: Any = json.loads(json.dumps(made.to_json()))
    data["plan"]["subtasks"][0]["flow"] = flow
    return rehashed(data)


def test_another_flow_that_needs_nothing_passes() -> None:
    assert oag.recheck(harmless([17, 6, {"7": 0.2}, {"13": None}, {"20": 30}]))


@pytest.mark.parametrize(
    ("flow", "said"),
    [
        ([18], "NAVIGATE_TO_SUPPORT is about no support"),
        ([{"7": math.nan}], "LIFT_EEF_UP takes"),
        ([{"7": -5}], "LIFT_EEF_UP takes"),
        ([{"7": math.inf}], "LIFT_EEF_UP takes"),
        ([{"7": 1e308}], "LIFT_EEF_UP takes"),
        ([{"7": 10**400}], "malformed certificate"),
        ([{"7": True}], "LIFT_EEF_UP takes"),
        ([{"7": "0.2"}], "LIFT_EEF_UP takes"),
        ([{"7": [0.1, 0.2]}], "LIFT_EEF_UP takes"),
        ([{"7": [0.1]}], "LIFT_EEF_UP takes"),
        ([{"6": 0.1}], "RETREAT takes no parameter"),
        ([{"20": -90}], "TURN_BASE_LEFT takes"),
        ([{"7": 0.1, "8": 0.1}], "malformed certificate"),
        ([99], "malformed certificate"),
    ],
)
def test_no_robot_could_be_told_so(flow: list[Any], said: str) -> None:
    result = oag.recheck(harmless(flow))
    assert not result and said in result.reason


@pytest.mark.parametrize(("primitive", "said"), [(4, "what has no joint"), (19, "what has no joint"), (3, "furniture")])
def test_a_primitive_is_about_what_it_can_be_about(primitive: int, said: str) -> None:
    """A table that is opened: the hand grips it by the certificate's own scene, so that every link is right."""
    data = harmless([17, 1, 2, primitive])
    assert said in oag.recheck(data).reason
    assert "furniture" not in oag.recheck(harmless([17, 1, 2, 3], "box_0")).reason


@pytest.mark.parametrize("name", NAMES)
def test_a_certificate_is_about_its_own_task_and_scene(name: str) -> None:
    data = certificate(name)
    task = oag.Task.from_json(task_json(name))
    assert oag.recheck(data, task=task, scene=scene(name))
    assert oag.recheck(data, task=DATA / f"{name}.json", scene=DATA / f"{name}_scene.json")
    assert oag.recheck(data, task=task) and oag.recheck(data, scene=scene(name))
    assert oag.recheck(data, task=oag.Task.from_json(task_json(name), scene=scene(name)))
    for other in set(NAMES) - {name}:
        assert not oag.recheck(data, task=oag.Task.from_json(task_json(other)))
        assert "it is about another scene" in oag.recheck(data, scene=scene(other)).reason


@pytest.mark.parametrize(
    ("path", "value", "said"),
    [
        (("goal",), "(open refrigerator_0)", "another task: goal is"),
        (("goal",), ..., "another task: goal is"),
        (("sub_tasks", 1, "target"), "table_0", "another task: subtasks[1].target is 'glass_0' there"),
        (("sub_tasks", 2, "support_goal"), None, "another task: subtasks[2].support_goal"),
        (("sub_tasks", 1, "flow", 3), {"7": 0.1}, "another task: subtasks[1].flow"),
        (("sub_tasks", 3), ..., "another task: subtasks is"),
        (("sub_tasks", 0, "init"), "(and)", "another task: subtasks[0].init"),
    ],
)
def test_of_another_task_it_says_what_differs(path: tuple[Any, ...], value: Any, said: str) -> None:
    result = oag.recheck(certificate(), task=altered(task_json("T1"), path, value))
    assert not result and said.casefold() in result.reason.casefold()


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda d: d["facts"].pop(), "another scene: start"),
        (lambda d: d["objects"]["glass_0"].update(category="mug"), "another scene: objects.glass_0 is 'water_glass'"),
        (lambda d: d["objects"].pop("glass_0") and d["facts"].clear(), "another scene"),
        (lambda d: d.update(closed=[]), "another scene: start"),
        (lambda d: d["objects"]["glass_0"].update(bbox_extent=[0.5, 0.5, 0.1]), "not well formed in this scene: task/"),
    ],
)
def test_of_another_scene_it_says_what_differs(change: Callable[[Any], object], said: str) -> None:
    data = copy.deepcopy(scene("T1").to_json())
    change(data)
    result = oag.recheck(certificate(), task=task_json("T1") | {"scales": {}}, scene=data)
    assert not result and said in result.reason


def test_a_flow_that_the_task_leaves_out_may_be_any() -> None:
    data = task_json("T1")
    for subtask in data["sub_tasks"]:
        del subtask["flow"]
    report = verify(data, "T1")
    assert report and oag.recheck(report, task=data, scene=scene("T1"))
    assert oag.recheck(certificate(), task=data, scene=scene("T1"))


def test_what_is_rejected_anyway_is_not_compared() -> None:
    assert "there is no certificate" in oag.recheck(None, task=task_json("T1"), scene=scene("T1")).reason
    with pytest.raises(oag.TaskError):
        oag.recheck(certificate(), task={"sub_tasks": 3})


@pytest.mark.parametrize(
    "text",
    [
        "(and)",
        "(or (open box_0) (not (inside cup_0 box_0)))",
        "(imply (open box_0) (exists (?x - cup) (inside ?x box_0)))",
        "(forall (?x - cup) (forn (2) (?y - object) (nextto ?x ?y)))",
        "(forpairs (?x - cup) (?y - box) (inside ?x ?y))",
        "(fornpairs (1) (?x - cup) (?y - box) (inside ?x ?y))",
        "(not " * 3000 + "(open box_0)" + ")" * 3000,
    ],
    ids=lambda text: text[:30],
)
def test_the_checker_reads_formulas_as_the_language_does(text: str) -> None:
    assert read_formula(text) == bddl.parse_formula(text)


@pytest.mark.parametrize(
    "text",
    [
        "open",
        "()",
        "(open box_0",
        "(open box_0))",
        "(open box_0) (open box_1)",
        "((open box_0))",
        "(on cup_0 box_0)",
        "(inside cup_0)",
        "(not)",
        "(not (open box_0) (open box_1))",
        "(and (open box_0) box_1)",
        "(open ?x)",
        "(exists (?x - cup) (open x))",
        "(exists (?x cup) (open ?x))",
        "(exists (?x - cup) (?y - box) (inside ?x ?y))",
        "(forn 2 (?x - cup) (open ?x))",
        "(?x - cup)",
        "(3)",
    ],
)
def test_the_checker_reads_nothing_else(text: str) -> None:
    with pytest.raises(ValueError, match="as the language prints it"):
        read_formula(text)


@pytest.mark.parametrize("index", [0, 3, 5])
@pytest.mark.slow
def test_the_form_is_that_of_the_schema(index: int) -> None:
    """Of one certificate of each verdict, whatever is changed; but that 1.0 is no whole number here."""
    assert [SMALL[number][3] for number in (0, 3, 5)] == ["CONDITIONAL", "REFUTED", "PROVED"]
    for changed in single_changes(small(index), (None, True, "", -1, [], {})):
        assert (schema_check()(changed) is None) is VALIDATOR.is_valid(changed)


@pytest.mark.parametrize("index", [0, 3, 5])
@pytest.mark.parametrize(
    ("place", "said"),
    [("", ".note"), ("plan", "plan.note"), ("scene", "scene.note"), ("plan.subtasks.0", "subtasks[0].note")]
    + [("assumptions.0", "assumptions[0]")],
)
def test_what_is_in_no_schema_does_not_belong(index: int, place: str, said: str) -> None:
    data: Any = small(index)
    at = data
    for key in place.split(".") if place else ():
        at = at[int(key) if key.isdecimal() else key]
    at["note"] = "trust me"
    result = oag.recheck(rehashed(data))
    assert not result and result.reason.startswith("malformed certificate: ") and said in result.reason


@pytest.mark.parametrize(
    ("path", "value", "said"),
    [
        (("cases", 0, "consumer", 1), True, "cases[0].consumer[1]"),
        (("counterexample", 0, 2), 0, ""),
        (("counterexample", 1), [0, ["open", "refrigerator_0"], True, "so it is"], "counterexample"),
        (("links",), "", "links"),
        (("search",), False, ""),
        (("plan", "goal_given"), "yes", "plan.goal_given"),
        (("plan", "goal"), {}, "plan.goal"),
    ],
)
def test_a_malformed_refutation_is_rejected(path: tuple[Any, ...], value: Any, said: str) -> None:
    data = altered(small(4), path, value)
    result = oag.recheck(rehashed(data))
    assert not result and said in result.reason
