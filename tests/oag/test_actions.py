"""Actions and flows: JSON, parameters and their ranges."""

from __future__ import annotations

import math
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

import oag
from oag.model.actions import ActionFlow, flow_from_json, flow_to_json
from oag.model.diagnostics import FlowError
from oag.model.symbols import ParameterKind, parameter_kind, parameter_problem
from tests.oag.paper import EVOLVED, UNFILLED

PAPER_IDS = {
    1: "APPROACH",
    2: "CONVERGE",
    3: "GRASP",
    5: "UNGRASP",
    8: "LIFT_EEF_DOWN",
    9: "MOVE_EEF_FORWARD",
    13: "MOVE_BASE_FORWARD",
    15: "MOVE_BASE_LEFT",
    17: "NAVIGATE_TO_TARGET",
    18: "NAVIGATE_TO_SUPPORT",
    19: "ARTICULATE_CLOSE",
}


def test_there_are_twenty_one_primitives_with_the_papers_ids() -> None:
    assert [int(primitive) for primitive in oag.Primitive] == list(range(1, 22))
    for number, name in PAPER_IDS.items():
        assert oag.Primitive(number).name == name


@pytest.mark.parametrize("flow", [flow for _, _, flow in EVOLVED] + UNFILLED)
def test_the_papers_flows_survive_json(flow: list[Any]) -> None:
    assert flow_to_json(flow_from_json(flow)) == flow


def actions() -> st.SearchStrategy[oag.Action]:
    """Any action with a parameter of its kind, filled in or not."""
    numbers = st.floats(0, 3, allow_nan=False)
    values: dict[ParameterKind, st.SearchStrategy[Any]] = {
        ParameterKind.NONE: st.none(),
        ParameterKind.DISTANCE_M: st.none() | numbers,
        ParameterKind.ANGLE_DEG: st.none() | st.floats(0, 180),
        ParameterKind.JOINT_LIMITS: st.none() | st.tuples(numbers, numbers).map(lambda pair: (min(pair), max(pair))),
    }
    primitives = st.sampled_from(list(oag.Primitive))
    return primitives.flatmap(lambda p: values[parameter_kind(p)].map(lambda value: oag.Action(p, value)))


@given(st.lists(actions(), max_size=6).map(tuple))
def test_flows_round_trip(flow: ActionFlow) -> None:
    assert flow_from_json(flow_to_json(flow)) == flow
    assert all(parameter_problem(action.primitive, action.parameter) is None for action in flow)


@pytest.mark.parametrize(
    ("items", "code", "message"),
    [
        ("17, 1", "flow/parameter", "expected a list such as [17, 1, 2, 3]"),
        ([17, 99], "flow/unknown-primitive", "item 1: unknown primitive 99; primitives are the integers 1 to 21"),
        ([True], "flow/unknown-primitive", "unknown primitive True"),
        (["GRAPS"], "flow/unknown-primitive", "did you mean 3 GRASP?"),
        (["lift the eef up"], "flow/unknown-primitive", "did you mean 7 LIFT_EEF_UP or"),
        ([""], "flow/unknown-primitive", "unknown primitive ''"),
        ([{"0": 1}], "flow/unknown-primitive", "unknown primitive '0'"),
        ([{}], "flow/parameter", "expected one primitive a mapping"),
        ([{"13": 0.1, "9": 0.2}], "flow/parameter", "expected one primitive a mapping"),
        ([{"13": "far"}], "flow/parameter", "MOVE_BASE_FORWARD takes one distance from 0 to 3 m, got 'far'"),
        ([{"13": True}], "flow/parameter", "got True"),
        ([{"19": [0.1, 0.2, 0.3]}], "flow/parameter", "ARTICULATE_CLOSE takes joint limits [min, max]"),
    ],
)
def test_unreadable_flows_raise(items: Any, code: str, message: str) -> None:
    with pytest.raises(FlowError) as caught:
        flow_from_json(items)
    assert caught.value.code == code
    assert message in str(caught.value)


def test_names_are_read_in_the_place_of_ids() -> None:
    named = ["GRASP", "grasp", " Grasp ", {"LIFT_EEF_UP": 0.2}, {"lift eef up": None}, {"articulate-open": [0, 0.7]}]
    flow = flow_from_json(named)
    assert flow_to_json(flow) == [3, 3, 3, {"7": 0.2}, {"7": None}, {"4": [0.0, 0.7]}]
    assert all(flow_from_json([primitive.name]) == (oag.Action(primitive),) for primitive in oag.Primitive)


@pytest.mark.parametrize(
    ("primitive", "parameter", "fits"),
    [
        (oag.Primitive.MOVE_BASE_FORWARD, 0.0, True),
        (oag.Primitive.MOVE_BASE_FORWARD, 3.0, True),
        (oag.Primitive.MOVE_BASE_FORWARD, 3.01, False),
        (oag.Primitive.MOVE_BASE_FORWARD, -0.01, False),
        (oag.Primitive.MOVE_BASE_FORWARD, math.inf, False),
        (oag.Primitive.MOVE_BASE_FORWARD, (0.0, 1.0), False),
        (oag.Primitive.TURN_BASE_LEFT, 180.0, True),
        (oag.Primitive.TURN_BASE_LEFT, 181.0, False),
        (oag.Primitive.ARTICULATE_OPEN, (0.0, 0.7), True),
        (oag.Primitive.ARTICULATE_OPEN, (0.7, 0.7), True),
        (oag.Primitive.ARTICULATE_OPEN, (0.7, 0.0), False),
        (oag.Primitive.ARTICULATE_OPEN, (0.0, math.nan), False),
        (oag.Primitive.ARTICULATE_OPEN, (0.0, 90.0), False),
        (oag.Primitive.ARTICULATE_OPEN, 0.5, False),
        (oag.Primitive.GRASP, 0.1, False),
        (oag.Primitive.GRASP, None, True),
        (oag.Primitive.LIFT_EEF_UP, None, True),
    ],
)
def test_parameter_ranges(primitive: oag.Primitive, parameter: Any, fits: bool) -> None:
    assert (parameter_problem(primitive, parameter) is None) is fits
