"""Furniture told apart by what stands on it and by its side, drawers of things, and names with "of" in them."""

from __future__ import annotations

import math

import pytest

import bddl
import llm
from llm import QueryError
from llm.offline.viewpoint import gap_m, is_under
from oag import Scene

CABINET = {"category": "bottom_cabinet", "bbox_extent": [0.6, 0.8, 0.75]}


def _box(category: str, size: list[float], position: list[float], yaw_rad: float = 0.0) -> dict[str, object]:
    turn = [math.cos(yaw_rad / 2), 0.0, 0.0, math.sin(yaw_rad / 2)]
    return {"category": category, "bbox_extent": size, "position": position, "orientation": turn}


SCENE = Scene.from_json(
    {
        "name": "rooms",
        "objects": {
            "cabinet_0": {**CABINET, "position": [1.4, 1.0, 0.375]},
            "cabinet_1": {**CABINET, "position": [1.4, -1.0, 0.375]},
            "microwave_0": _box("microwave", [0.45, 0.5, 0.3], [1.4, 1.0, 0.9]),
            "orange_0": _box("orange", [0.07, 0.07, 0.07], [1.2, -1.1, 0.785]),
            "nightstand_0": _box("nightstand", [0.45, 0.5, 0.55], [-1.0, 1.4, 0.275]),
            "table_0": _box("table", [0.6, 1.2, 0.7], [0.0, -2.0, 0.35], math.pi / 2),
            "table_1": _box("table", [0.6, 1.2, 0.7], [0.0, 2.0, 0.35]),
            "medicine_0": _box("medicine_bottle", [0.05, 0.05, 0.09], [0.0, -1.8, 0.745]),
            "bottle_0": _box("bottle", [0.06, 0.06, 0.2], [0.3, -2.0, 0.8]),
            "apple_0": _box("apple", [0.07, 0.07, 0.07], [0.0, 1.9, 0.735]),
            "apple_1": _box("apple", [0.07, 0.07, 0.07], [-0.3, -1.9, 0.735]),
            "teddy_bear_0": _box("teddy_bear", [0.08, 0.1, 0.13], [-1.0, 1.4, 0.615]),
        },
        "facts": [
            "(ontop microwave_0 cabinet_0)",
            "(ontop orange_0 cabinet_1)",
            "(ontop medicine_0 table_0)",
            "(ontop bottle_0 table_0)",
            "(ontop apple_0 table_1)",
            "(ontop apple_1 table_0)",
            "(ontop teddy_bear_0 nightstand_0)",
            *(f"(not (open {key}))" for key in ("cabinet_0", "cabinet_1", "microwave_0", "nightstand_0")),
        ],
        "closed": ["ontop", "inside", "open"],
    }
)


@pytest.mark.parametrize(
    ("query", "goal"),
    [
        ("open the cabinet under the microwave", "(open cabinet_0)"),
        ("open cabinet beneath the orange", "(open cabinet_1)"),
        ("open the cabinet that is below the orange", "(open cabinet_1)"),
        ("open the left cabinet", "(open cabinet_0)"),
        ("open the cabinet on the right", "(open cabinet_1)"),
        ("open the drawer of the nightstand", "(open nightstand_0)"),
        ("open the nightstand drawer", "(open nightstand_0)"),
        ("pull the nightstand's drawer open", "(open nightstand_0)"),
        ("pick up the bottle of medicine", "(inside medicine_0 gripper)"),
        ("pick up the bottle of medicine on the table", "(inside medicine_0 gripper)"),
        ("pick up the water bottle", "(inside bottle_0 gripper)"),
        ("pick up the apple on the left table", "(inside apple_0 gripper)"),
        ("take the apple from the right table", "(inside apple_1 gripper)"),
        ("put the orange on the left table", "(ontop orange_0 table_1)"),
        ("pick up the teddy", "(inside teddy_bear_0 gripper)"),
        ("put the toy next to nothing on the right table", None),
        ("put the orange under the microwave", None),
        ("open the cabinet under the teddy bear", None),
    ],
)
def test_the_thing_that_is_meant(query: str, goal: str | None) -> None:
    if goal is None:
        with pytest.raises(QueryError):
            llm.propose(query, SCENE)
    else:
        assert bddl.format(llm.propose(query, SCENE).task.goal) == goal


def test_nothing_can_be_put_under_something() -> None:
    with pytest.raises(QueryError) as refusal:
        llm.propose("put the orange under table_0", SCENE)
    assert refusal.value.code == "unsupported-relation"


def test_what_is_under_something_has_its_middle_above_it() -> None:
    assert is_under("cabinet_0", "microwave_0", SCENE)
    assert not is_under("microwave_0", "cabinet_0", SCENE)
    assert not is_under("cabinet_1", "microwave_0", SCENE)


def test_gaps_are_measured_to_furniture_as_it_is_turned() -> None:
    # Turned by a quarter, the table reaches 0.3 m to its sides in y and 0.6 m in x.
    assert gap_m("table_0", "cabinet_1", SCENE) == pytest.approx(math.hypot(0.5, 0.3))
    assert gap_m("table_1", "cabinet_0", SCENE) == pytest.approx(0.8)
