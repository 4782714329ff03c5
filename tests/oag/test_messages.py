"""What reports say beside the verdict: one mistake once, two mistakes twice, and what a person needs to act on them."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import oag
from tests.oag.other_tasks import OTHERS
from tests.oag.paper import task_json, verify

EXTENTS = {"water_glass": [0.05, 0.05, 0.1]}
OBJECTS = {
    "glass_0": "water_glass",
    "glass_1": "water_glass",
    "refrigerator_0": "refrigerator",
    "drawer_0": "drawer",
    "table_0": "breakfast_table",
}
ALL = ("ontop", "inside", "open")
PICK = [17, 1, 2, 3, 7]


def kitchen(facts: Iterable[str], closed: Iterable[str] = ALL) -> oag.Scene:
    """A kitchen with two glasses and two things that open."""
    objects = {key: {"category": kind, "bbox_extent": EXTENTS.get(kind, [1, 1, 1])} for key, kind in OBJECTS.items()}
    return oag.Scene.from_json({"objects": objects, "facts": list(facts), "closed": list(closed)})


def report(subtask: dict[str, Any], world: oag.Scene, goal: str | None = None) -> oag.Report:
    """The report on a task of one subtask."""
    given = {} if goal is None else {"goal": goal}
    return oag.compose({**given, "sub_tasks": [subtask]}, world).verify()


def test_independent_mistakes_of_one_flow_are_all_shown() -> None:
    """A flow written anew mends them all, which does not make them one mistake."""
    data = task_json("T1")
    data["sub_tasks"][1]["flow"] = [1, 2, "GRAPS", 99, 4.0, {"4": "x"}]
    found = verify(data, "T1")
    shown = [finding for finding in found.findings if finding.severity == "error"]
    assert [(finding.code, finding.step) for finding in shown] == [
        ("flow/unknown-primitive", 2),
        ("flow/unknown-primitive", 3),
        ("flow/unknown-primitive", 4),
        ("flow/parameter", 5),
    ]
    assert [finding.dependent for finding in shown] == [0, 0, 0, 0]
    assert str(found).count("give T2 the flow") == 1


def test_no_two_fixes_lead_to_the_same_plan() -> None:
    data = task_json("T1")
    data["goal"] = "(and (inside glass_0 gripper) (inside refrigerator_0 gripper))"
    for found in (verify(data, "T1"), report(held("(and (inside glass_0 gripper) (inside glass_1 gripper))"), full())):
        repaired = [fix.apply(found.task) for fix in found.fixes]
        assert repaired and all(plan not in repaired[:index] for index, plan in enumerate(repaired))


def test_errors_that_one_change_mends_are_named_with_it() -> None:
    """Following the plan finds two errors, and exchanging two subtasks mends both: nothing of that is hidden."""
    world, data = OTHERS["between_two_drawers"]
    order = data["sub_tasks"]
    swapped = {**data, "sub_tasks": [order[3], *order[1:3], order[0], *order[4:]]}
    found = oag.compose(swapped, oag.Scene.from_json(world)).verify()
    assert len(found.errors) == 2
    (shown,) = [finding for finding in found.findings if finding.severity == "error"]
    assert shown.also == (found.errors[1].brief,)
    assert f"  also    {found.errors[1].brief}" in str(found).splitlines()
    written: Any = found.to_json()["diagnostics"]
    assert written[0]["also"] == list(shown.also)


def held(goal: str) -> dict[str, Any]:
    """A subtask that starts with a glass in the hand."""
    return {"target": "glass_0", "init": "(inside glass_0 gripper)", "goal": goal, "support_goal": "drawer_0"}


def full() -> oag.Scene:
    """The kitchen with a glass in the hand, and everything open."""
    facts = ["(inside glass_0 gripper)", "(open drawer_0)", "(open refrigerator_0)", "(ontop glass_1 table_0)"]
    return kitchen(facts)


def test_a_thing_on_itself_is_one_mistake() -> None:
    for goal in (None, "(inside glass_0 glass_0)"):
        subtask = {**held("(inside glass_0 glass_0)"), "support_goal": "glass_0"}
        errors = report(subtask, full(), goal).errors
        assert [error.code for error in errors] == ["task/contradictory"]
        assert ("also in task goal" in errors[0].message) is (goal is not None)


def test_why_no_flow_can_exist_is_said() -> None:
    shut = kitchen(["(inside glass_0 gripper)"])
    cases = {
        "(or (inside glass_0 refrigerator_0) (inside glass_0 drawer_0))": "such as (inside glass_0 drawer_0), and see",
        "(exists (?d - drawer) (inside glass_0 ?d))": "no way to meet it was found to have a flow",
    }
    for goal, said in cases.items():
        assert report(held(goal), full())
        (error,) = report(held(goal), shut).errors
        assert error.code == "flow/no-flow" and error.hint is not None and said in error.hint, error
        assert "?d" not in error.hint
    cases = {
        "(and (inside glass_0 drawer_0) (ontop glass_0 table_0))": "and not (ontop glass_0 table_0)",
        "(inside glass_1 drawer_0)": "give glass_1 a subtask of its own",
    }
    for goal, said in cases.items():
        (error,) = report(held(goal), full()).errors
        assert error.code == "flow/no-flow" and error.hint is not None and said in error.hint, error
    (error,) = report(held("(inside glass_0 drawer_0)"), shut).errors
    assert error.hint is None


def test_the_alternative_of_a_need_is_said() -> None:
    """A glass can be grasped when it is in no refrigerator, and when that is open."""
    picking = {
        "target": "glass_0",
        "init": "(ontop glass_0 table_0)",
        "goal": "(not (ontop glass_0 table_0))",
        "flow": PICK,
    }
    open_world = report(picking, kitchen(["(ontop glass_0 table_0)"], closed=["ontop"]))
    warning = next(finding for finding in open_world.diagnostics if finding.code == "context/open")
    assert warning.literal == "not inside(glass_0, refrigerator_0)"
    assert "GRASP would also run with open(refrigerator_0)" in warning.message
    inside = {**picking, "init": "(inside glass_0 refrigerator_0)", "goal": "(not (inside glass_0 refrigerator_0))"}
    (error,) = report(inside, kitchen(["(inside glass_0 refrigerator_0)"])).errors
    assert error.literal == "open(refrigerator_0)"
    assert "GRASP would also run with not inside(glass_0, refrigerator_0), which is not so either" in error.message
    # The refrigerator is shut: that it could be open instead is no alternative.
    shut = report(picking, kitchen(["(ontop glass_0 table_0)", "(not (open refrigerator_0))"], closed=["ontop"]))
    warning = next(finding for finding in shut.diagnostics if finding.literal == "not inside(glass_0, refrigerator_0)")
    assert "would also run" not in warning.message
    assert "open(refrigerator_0) would do, and is known not to be so" in warning.message
    (error,) = report({**picking, "flow": [1, 2, 3, 3, 7]}, kitchen(["(ontop glass_0 table_0)"])).errors
    assert "would also run" not in error.message


def test_the_start_shows_what_refutes_a_formula() -> None:
    opening = {"target": "drawer_0", "init": "(and)", "goal": "(open drawer_0)", "flow": [17, 1, 2, 3, 4, 5]}
    world = kitchen(["(inside glass_1 refrigerator_0)"])
    for goal in (
        "(forall (?g - water_glass) (inside ?g refrigerator_0))",
        "(forn (2) (?g - water_glass) (inside ?g refrigerator_0))",
    ):
        (error,) = report(opening, world, goal).errors
        assert "not inside(glass_0, refrigerator_0)" in error.start
    init = "(forall (?g - water_glass) (ontop ?g table_0))"
    (error,) = report({**opening, "init": init}, world).errors
    assert "not ontop(glass_0, table_0)" in error.start
