"""Subtasks without a flow get one by search, or a proof that none exists."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

import pytest

import oag
from oag.model.actions import flow_to_json
from oag.model.diagnostics import MissingScene
from tests.json_edits import altered
from tests.oag.paper import NAMES, assert_golden, scene, task_json


def without_flows(name: str, *indices: int) -> dict[str, Any]:
    """A task of the paper without some of its flows, or without any."""
    data = task_json(name)
    for index, subtask in enumerate(data["sub_tasks"]):
        if not indices or index in indices:
            del subtask["flow"]
    return data


def primitives(task: oag.Task, index: int) -> list[str]:
    flow = task.subtasks[index].flow
    assert flow is not None
    return [action.primitive.name for action in flow]


@pytest.mark.parametrize("name", NAMES)
def test_all_flows_of_the_papers_tasks_are_found(name: str) -> None:
    graph = oag.compose(without_flows(name), scene(name))
    report = graph.verify()
    assert report.verdict is oag.Verdict.PROVED, str(report)
    assert graph.searched == tuple(range(len(graph.task.subtasks)))
    assert [note.subtask for note in report.diagnostics if note.code == "flow/searched"] == list(graph.searched)
    assert oag.recheck(report.certificate)


def test_the_found_flows_are_the_templates_with_open_numbers() -> None:
    task = oag.complete(oag.Task.from_json(without_flows("T1"), scene=scene("T1"))).task
    assert [flow_to_json(subtask.flow or ()) for subtask in task.subtasks] == [
        [17, 1, 2, 3, {"4": None}, 5, 6],
        [17, 1, 2, 3, {"7": None}],
        [18, {"13": None}, {"8": None}, 5, 6],
        [17, 1, 2, 3, {"19": None}, 5, 6],
    ]


def test_given_flows_are_kept() -> None:
    graph = oag.compose(without_flows("T1", 1), scene("T1"))
    given = oag.Task.from_json(task_json("T1"))
    assert graph.searched == (1,)
    assert [s.flow for i, s in enumerate(graph.task.subtasks) if i != 1] == [
        s.flow for i, s in enumerate(given.subtasks) if i != 1
    ]


def test_a_flow_is_found_where_no_template_works() -> None:
    """The hand still has the handle of the refrigerator, and the subtask has to let go of it first."""
    data = without_flows("T1", 1)
    data["sub_tasks"] = data["sub_tasks"][:2]
    data["sub_tasks"][0]["flow"] = [1, 2, 3, 4]
    data["goal"] = "(and (open refrigerator_0) (not (ontop glass_0 table_0)))"
    task = oag.complete(oag.Task.from_json(data, scene=scene("T1"))).task
    assert "UNGRASP" in primitives(task, 1)
    assert oag.compose(task).verify()


def picked_up_first(*without: int) -> dict[str, Any]:
    """T1 with the glass picked up before the refrigerator is opened, and some subtasks without their flows."""
    data = without_flows("T1", *without) if without else task_json("T1")
    data["sub_tasks"][0], data["sub_tasks"][1] = data["sub_tasks"][1], data["sub_tasks"][0]
    return data


@pytest.mark.parametrize("without", [(0,), (0, 1), (0, 1, 2, 3)])
def test_no_flow_lets_go_of_what_its_subtask_is_not_about(without: tuple[int, ...]) -> None:
    """Opening with a glass in the hand could only drop it: no flow exists, and the order is what is to be mended."""
    graph = oag.compose(picked_up_first(*without), scene("T1"))
    assert graph.task.subtasks[1].flow is None
    report = graph.verify()
    assert [error.code for error in report.errors] == ["flow/no-flow"]
    assert oag.recheck(report.certificate)
    first = report.fixes[0]
    assert first.proves and first.kind == "swap-subtasks"
    assert oag.complete(first.apply(report.task), scene("T1")).missing == ()


def test_a_plan_of_pick_and_open_alone_is_mended_as_well() -> None:
    data = picked_up_first(0, 1)
    data["sub_tasks"] = data["sub_tasks"][:2]
    del data["goal"]
    report = oag.compose(data, scene("T1")).verify()
    assert report.verdict is oag.Verdict.REFUTED
    assert report.fixes and report.fixes[0].proves


def test_a_given_flow_that_drops_a_thing_is_refuted() -> None:
    """The glass would lie on the floor, and the opening is not about it."""
    data = picked_up_first()
    data["sub_tasks"][1]["flow"] = [17, 1, 2, 5, 3, 4]
    data["sub_tasks"] = data["sub_tasks"][:2]
    data["goal"] = "(open refrigerator_0)"
    report = oag.compose(data, scene("T1")).verify()
    (error,) = report.errors
    assert (error.code, error.subtask, error.step) == ("flow/precondition", 1, 3)
    assert error.literal == "not inside(glass_0, gripper)"
    assert oag.recheck(report.certificate)
    first = report.fixes[0]
    assert first.proves and first.kind == "insert-subtask" and "put glass_0 on table_0" in first.summary


def test_a_flow_is_chosen_so_that_the_rest_goes_through() -> None:
    """Without its UNGRASP the opening would be shorter, and the next subtask could not grasp."""
    data = without_flows("T1", 0)
    graph = oag.compose(data, scene("T1"))
    assert graph.verify()
    assert "UNGRASP" in primitives(graph.task, 0)


def test_nothing_has_to_be_done_for_a_goal_that_holds() -> None:
    subtask = {"target": "refrigerator_0", "init": "(not (open refrigerator_0))", "goal": "(not (open refrigerator_0))"}
    task = oag.complete(oag.Task.from_json({"sub_tasks": [subtask]}, scene=scene("T1"))).task
    assert task.subtasks[0].flow == ()


def unreachable() -> oag.Report:
    """The glass cannot be put into the refrigerator, because nobody holds it and the subtask is about the table."""
    data = without_flows("T1", 2)
    data["sub_tasks"].pop(0)
    return oag.compose(data, scene("T1")).verify()


def test_where_no_flow_exists_the_error_says_so_and_the_certificate_proves_it() -> None:
    report = unreachable()
    assert report.verdict is oag.Verdict.REFUTED
    assert [error.code for error in report.errors] == ["flow/no-flow"]
    assert report.certificate is not None
    assert oag.recheck(report.certificate).reason == "('no-flow', 1, -1) fails, as claimed"
    assert_golden("no_flow", str(report))


def test_the_fix_for_a_missing_flow_is_what_it_needs_before() -> None:
    report = unreachable()
    assert report.fixes[0].proves
    assert oag.compose(report.fixes[0].apply(report.task)).verify()
    assert report.fixes[0].summary == 'insert "open refrigerator_0" before T1'


def test_an_altered_proof_is_rejected() -> None:
    certificate = unreachable().certificate
    assert certificate is not None
    data = json.loads(json.dumps(certificate.to_json()))
    states = data["search"]["states"]
    assert oag.recheck(data)
    assert not oag.recheck(altered(data, ("search", "states"), states[:-1]))
    assert not oag.recheck(altered(data, ("search", "states"), states[1:]))
    assert not oag.recheck(altered(data, ("search", "start"), states[-1]))
    assert not oag.recheck(altered(data, ("search", "facts"), data["search"]["facts"][::-1]))
    assert not oag.recheck(altered(data, ("search",), None))


def test_an_unknown_start_makes_the_search_conditional() -> None:
    kitchen = oag.Scene.from_json({**scene("T1").to_json(), "closed": [], "facts": ["(ontop glass_0 table_0)"]})
    report = oag.compose(without_flows("T1", 0), kitchen).verify()
    assert report.verdict is oag.Verdict.CONDITIONAL
    assert next(finding.literal for finding in report.diagnostics if finding.code == "context/open") == (
        "not open(refrigerator_0)"
    )


def half_known(goal: str) -> tuple[oag.Graph, oag.Report]:
    """Open the drawer and reach a goal for the glass, in a kitchen of which only the glass's place is known."""
    things = {"refrigerator_0": "refrigerator", "drawer_0": "drawer", "table_0": "table", "glass_0": "water_glass"}
    size = {"glass_0": [0.05, 0.05, 0.1]}
    objects = {key: {"category": name, "bbox_extent": size.get(key, [1, 1, 1])} for key, name in things.items()}
    kitchen = oag.Scene.from_json({"objects": objects, "facts": ["(ontop glass_0 table_0)"]})
    opening = {"target": "drawer_0", "init": "(and)", "goal": "(open drawer_0)"}
    moving = {"target": "glass_0", "support_goal": "drawer_0", "init": "(and)", "goal": goal}
    graph = oag.compose(oag.Task.from_json({"sub_tasks": [opening, moving]}, scene=kitchen))
    return graph, graph.verify()


def assumed(report: oag.Report) -> list[str]:
    assert report.certificate is not None
    return [str(entry["text"]) for entry in report.certificate.assumptions if entry["kind"] == "assumed"]


def test_goals_are_reached_not_assumed_where_little_is_known() -> None:
    graph, report = half_known("(inside glass_0 drawer_0)")
    assert report.verdict is oag.Verdict.CONDITIONAL
    assert assumed(report) == ["not inside(glass_0, refrigerator_0)"]
    assert "ARTICULATE_OPEN" in primitives(graph.task, 0)
    assert {"GRASP", "UNGRASP"} <= set(primitives(graph.task, 1))
    assert oag.recheck(report.certificate)


def test_of_a_goal_only_what_no_primitive_brings_about_is_assumed() -> None:
    graph, report = half_known("(and (hot glass_0) (inside glass_0 drawer_0))")
    assert assumed(report) == ["not inside(glass_0, refrigerator_0)", "hot(glass_0)"]
    assert "UNGRASP" in primitives(graph.task, 1)


def test_a_flow_does_not_assume_what_its_goal_denies() -> None:
    """Taking the glass out of the refrigerator needs an open one, and the goal wants it closed."""
    facts = ["(inside glass_0 refrigerator_0)"]
    kitchen = oag.Scene.from_json({**scene("T1").to_json(), "closed": ["inside"], "facts": facts})
    goal = "(and (not (open refrigerator_0)) (not (ontop glass_0 table_0)))"
    task = oag.Task.from_json({"sub_tasks": [{"target": "glass_0", "init": "(and)", "goal": goal}]}, scene=kitchen)
    report = oag.compose(task).verify()
    assert report.verdict is oag.Verdict.CONDITIONAL, str(report)
    assert set(assumed(report)) == {"not open(refrigerator_0)", "not ontop(glass_0, table_0)"}


def test_picking_up_and_putting_down_in_one_subtask_lifts_the_thing() -> None:
    data = without_flows("T1")
    pick, put = data["sub_tasks"][1:3]
    data["sub_tasks"][1:3] = [{**put, "support_init": pick["support_init"], "init": pick["init"]}]
    graph = oag.compose(data, scene("T1"))
    assert graph.verify()
    names = primitives(graph.task, 1)
    assert names.index("GRASP") < names.index("LIFT_EEF_UP") < names.index("NAVIGATE_TO_SUPPORT")
    assert names[-2:] == ["UNGRASP", "RETREAT"]


def test_a_plan_that_is_not_well_formed_is_not_searched() -> None:
    data = without_flows("T1")
    data["sub_tasks"][0]["target"] = "refrigerator_9"
    completion = oag.complete(oag.Task.from_json(data, scene=scene("T1")))
    assert completion.searched == () and completion.missing == (0, 1, 2, 3)
    assert {error.code for error in oag.compose(completion.task).verify().errors} == {"bddl/unknown-object"}


def test_many_subtasks_without_flows() -> None:
    """The search goes over hundreds of subtasks without reaching a limit of the interpreter."""
    data = without_flows("T1")
    opening, closing = data["sub_tasks"][0], data["sub_tasks"][3]
    data |= {"sub_tasks": [opening, closing] * 300, "goal": "(not (open refrigerator_0))"}
    assert oag.compose(data, scene("T1")).verify()


def test_completion_needs_a_scene() -> None:
    task = replace(oag.Task.from_json(without_flows("T1")), scene=None)
    with pytest.raises(MissingScene):
        oag.complete(task)
