"""The five answers: flat schemas for the wire, the paper's forms, and bounds on everything."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import jsonschema
import pytest
from pydantic import ValidationError

from llm.client.transport import BOUNDS
from llm.proposing.modules import Decomposition, Flows
from llm.proposing.understanding import Understanding
from llm.structured.schema import LONGEST_NAME, MOST_ACTIONS, MOST_SUBTASKS, Admitted, wire_schema
from llm.structured.values import as_ordinal
from oag import Primitive
from tests.json_edits import altered
from tests.llm.scripted_modules import SCHEMAS, TASKS, right_answers, scene_of

RIGHT = right_answers("T1")


def nodes(schema: dict[str, Any]) -> Iterator[dict[str, Any]]:
    """Yield a schema and those inside it."""
    yield schema
    for inner in (*schema.get("properties", {}).values(), *([schema["items"]] if "items" in schema else ())):
        yield from nodes(inner)


@pytest.mark.parametrize("module", SCHEMAS)
def test_schemas_of_the_wire_are_flat(module: int) -> None:
    for node in nodes(wire_schema(SCHEMAS[module])):
        assert node["type"] in ("object", "array", "string", "number", "integer")
        kept = {"type", "description", "enum", "items", "properties", "required", "additionalProperties"}
        assert set(node) <= kept | {*BOUNDS}
        if node["type"] == "object":
            assert node["required"] == list(node["properties"])
            assert node["additionalProperties"] is False


def asked_for(value: Any, schema: dict[str, Any]) -> Any:
    """Return an answer without the fields that a schema of the wire leaves out."""
    if isinstance(value, list):
        return [asked_for(item, schema["items"]) for item in value]
    if not isinstance(value, dict):
        return value
    return {key: asked_for(value[key], inner) for key, inner in schema["properties"].items()}


@pytest.mark.parametrize("name", TASKS)
@pytest.mark.parametrize("module", [1, 2, 3, 4])
def test_right_answers_fit_both_the_wire_and_the_reader(name: str, module: int) -> None:
    """What is not asked for is read where it is given, and need not be."""
    answer = right_answers(name)[module]
    ids, entries = [*scene_of(name).objects], len(answer.get("sub_tasks", ()))
    wire: Any = wire_schema(SCHEMAS[module], Admitted(ids, entries))
    plain = asked_for(answer, wire)
    jsonschema.validate(plain, wire)
    SCHEMAS[module].model_validate(plain)
    read = SCHEMAS[module].model_validate(answer)
    assert read.model_dump() == answer


def test_both_forms_of_a_flow_are_read() -> None:
    paper = Flows.model_validate({"sub_tasks": [{"sub_task": 1, "flow": [18, {"15": 0.3}, {"19": [0.0, 0.6]}, 5]}]})
    wire = {
        "sub_tasks": [
            {
                "sub_task": 1,
                "flow": [
                    {"primitive": 18, "parameters": []},
                    {"primitive": 15, "parameters": [0.3]},
                    {"primitive": 19, "parameters": [0.0, 0.6]},
                    {"primitive": 5, "parameters": []},
                ],
            }
        ]
    }
    assert Flows.model_validate(wire) == paper
    assert paper.model_dump() == wire
    written = ["NAVIGATE_TO_SUPPORT", "15(0.3)", "ARTICULATE_CLOSE(0.0, 0.6)", "UNGRASP"]
    asked = {"sub_tasks": [{"sub_task": 1, "flow": written}]}
    jsonschema.validate(asked, wire_schema(Flows))
    assert Flows.model_validate(asked) == paper
    assert [step.action().primitive for step in paper.sub_tasks[0].flow][1] is Primitive.MOVE_BASE_LEFT


def test_the_papers_numbered_subtasks_are_read_as_a_list() -> None:
    numbered = {f"sub_task_{entry['sub_task']}": entry for entry in RIGHT[3]["sub_tasks"]}
    numbered = {key: {k: v for k, v in entry.items() if k != "sub_task"} for key, entry in numbered.items()}
    assert SCHEMAS[3].model_validate(dict(reversed(numbered.items()))) == SCHEMAS[3].model_validate(RIGHT[3])


@pytest.mark.parametrize("none", [None, "null", "None", ""])
def test_no_support_may_be_said_in_several_ways(none: object) -> None:
    answer = altered(RIGHT[2], ("sub_tasks", 0, "support_init"), none)
    assert SCHEMAS[2].model_validate(answer) == SCHEMAS[2].model_validate(RIGHT[2])


def test_what_is_not_asked_for_is_left_out() -> None:
    read = Understanding.model_validate({**RIGHT[1], "command": "rm -rf /", "reasoning": "..."})
    assert read.model_dump() == RIGHT[1]


WRONG = {
    "no object": (1, "text"),
    "a number for a text": (1, altered(RIGHT[1], ("goal",), 3)),
    "a list for a text": (1, altered(RIGHT[1], ("goal",), ["(open a)", 3])),
    "a text that steers a terminal": (1, altered(RIGHT[1], ("task_name",), "put \x1b[2J away")),
    "half a surrogate": (1, altered(RIGHT[1], ("task_message_detail",), "\ud800")),
    "right-to-left marks": (1, altered(RIGHT[1], ("task_name",), "put \u202e away")),
    "a name that is too long": (1, altered(RIGHT[1], ("task_name",), "x" * (LONGEST_NAME + 1))),
    "a path for a name": (1, altered(RIGHT[1], ("task_activity_name",), "../../etc/passwd")),
    "no subtask": (2, {"sub_tasks": []}),
    "too many subtasks": (2, {"sub_tasks": RIGHT[2]["sub_tasks"] * MOST_SUBTASKS}),
    "true for a number": (3, altered(RIGHT[3], ("sub_tasks", 0, "sub_task"), True)),
    "subtask 0": (3, altered(RIGHT[3], ("sub_tasks", 0, "sub_task"), 0)),
    "an empty condition": (3, altered(RIGHT[3], ("sub_tasks", 0, "init"), "")),
    "an infinite factor": (4, altered(RIGHT[4], ("sub_tasks", 0, "scale"), float("inf"))),
    "a factor below zero": (4, altered(RIGHT[4], ("sub_tasks", 0, "scale"), -1.0)),
    "a factor as a text": (4, altered(RIGHT[4], ("sub_tasks", 0, "scale"), "0.05/0.07")),
    "a huge integer": (4, altered(RIGHT[4], ("sub_tasks", 0, "scale"), 10**400)),
    "no flow": (5, altered(RIGHT[5], ("sub_tasks", 0, "flow"), [])),
    "a flow that is too long": (5, altered(RIGHT[5], ("sub_tasks", 0, "flow"), [1] * (MOST_ACTIONS + 1))),
    "primitive 22": (5, altered(RIGHT[5], ("sub_tasks", 0, "flow"), [22])),
    "three numbers": (5, altered(RIGHT[5], ("sub_tasks", 0, "flow"), [{"primitive": 7, "parameters": [1, 2, 3]}])),
    "an action in an action": (5, altered(RIGHT[5], ("sub_tasks", 0, "flow"), [{"primitive": {"7": 1}}])),
}


@pytest.mark.parametrize("case", WRONG)
def test_wrong_types_and_unbounded_values_are_refused(case: str) -> None:
    module, data = WRONG[case]
    with pytest.raises(ValidationError):
        SCHEMAS[module].model_validate(data)


def test_a_misspelt_field_is_named() -> None:
    data = {key: value for key, value in RIGHT[1].items() if key != "task_message_detail"}
    with pytest.raises(ValidationError, match="task_message_detail is missing; task_message_details is no field"):
        Understanding.model_validate({**data, "task_message_details": "..."})


def flow_of(*actions: object) -> list[object]:
    """Return the actions of a flow as they are read."""
    read = Flows.model_validate({"sub_tasks": [{"sub_task": 1, "flow": list(actions)}]})
    return [(int(step.action().primitive), step.parameters) for step in read.sub_tasks[0].flow]


@pytest.mark.parametrize(
    ("action", "read"),
    [
        ({"id": 3}, (3, [])),
        ({"id": 3, "name": "GRASP"}, (3, [])),
        ({"id": 3, "skill": "GRASP"}, (3, [])),
        ({"name": "GRASP", "target": "glass_0"}, (3, [])),
        ({"primitive": 3, "id": 1}, (3, [])),
        ({"primitive": 3, "comment": "take it"}, (3, [])),
        ({"primitive": "LIFT_EEF_UP", "value": "0.2"}, (7, [0.2])),
        ({"id": 7, "distance_m": 0.2}, (7, [0.2])),
        ({"primitive": 7, "parameters": {"distance": 0.2}}, (7, [0.2])),
        ({"primitive": 20, "angle_deg": 30.0}, (20, [30.0])),
        ({"primitive": 19, "limits": [0.0, 0.6]}, (19, [0.0, 0.6])),
    ],
)
def test_an_action_with_keys_is_read_as_what_they_name(action: object, read: object) -> None:
    assert flow_of(action) == [read]


@pytest.mark.parametrize(
    ("action", "problem"),
    [
        ({"id": 1, "skill": "GRASP"}, "more than one primitive"),
        ({"id": 1, "skill": "take the glass"}, "may name the primitive"),
        ({"name": "lift", "skill": "take the glass"}, "may name the primitive"),
        ({"primitive": 3, "name": "OPEN_GRIPPER", "skill": "LIFT_EEF_UP"}, "more than one primitive"),
        ({"primitive": 1, "name": "GRASP"}, "more than one primitive"),
        ({"primitive": 13, "angle_deg": 0.5}, "MOVE_BASE_FORWARD takes one distance"),
        ({"primitive": 13, "parameters": {"degrees": 0.5}}, "MOVE_BASE_FORWARD takes one distance"),
        ({"primitive": 20, "distance_m": 0.5}, "takes one angle"),
        ({"primitive": 19, "angle": [0.0, 0.6]}, "takes joint limits"),
        ({"primitive": "GRASP", "distance": 0.1}, "takes no parameter"),
    ],
)
def test_an_action_whose_keys_contradict_each_other_is_refused(action: object, problem: str) -> None:
    with pytest.raises(ValidationError, match=problem):
        flow_of(action)


@pytest.mark.parametrize(
    ("value", "number"),
    [("2", 2), (2.0, 2), ("#2", 2), ("sub_task_2", 2), ("sub-task-2", 2), ("Step 2", 2), ("step - 2", 2), ("t2", 2)],
)
def test_a_number_of_a_subtask_is_read(value: object, number: int) -> None:
    assert as_ordinal(value) == number


@pytest.mark.parametrize("value", ["-2", " -2", "#-2", "_-2", "step -2", "sub_task_-2", "step--2", "-sub_task_2", "2-"])
def test_a_number_below_zero_is_no_number_of_a_subtask(value: str) -> None:
    assert as_ordinal(value) == value


def test_picking_up_and_putting_down_in_one_are_two_simple_tasks() -> None:
    """A model that names where a held item came from means one thing, and one that carries in a single step another."""
    whole = [entry for entry in RIGHT[2]["sub_tasks"]]
    opened, picked, put, closed = whole
    both = {**put, "support_init": picked["support_init"]}
    carried = Decomposition.model_validate(
        {"sub_tasks": [{**opened}, {**both, "sub_task": 2}, {**closed, "sub_task": 3}]}
    )
    named = Decomposition.model_validate({"sub_tasks": [opened, picked, both, closed]})
    right = [
        (part.target, part.support_init, part.support_goal)
        for part in Decomposition.model_validate(RIGHT[2]).subtasks()
    ]
    assert [(part.target, part.support_init, part.support_goal) for part in carried.subtasks()] == right
    itself = Decomposition.model_validate({"sub_tasks": [{**opened, "support_goal": opened["target"]}]})
    assert (itself.subtasks()[0].support_init, itself.subtasks()[0].support_goal) == (None, None)
    assert [part.name for part in named.subtasks()] == [entry["task_activity_name"] for entry in whole]
