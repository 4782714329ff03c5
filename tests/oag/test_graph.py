"""The object-action graph of T1: nodes, edges, feasibility, and its export."""

from __future__ import annotations

import networkx
import pytest

import oag
from oag.feasible import feasible
from tests.oag.paper import DATA, assert_golden, invalid, scene


def graph() -> oag.ObjectActionGraph:
    return oag.compose(oag.Task.from_json(DATA / "T1.json", scene=scene("T1")))


def test_nodes_of_t1() -> None:
    nodes = graph().nodes
    assert len(nodes) == 20
    assert nodes[0].projection == ("refrigerator_0", oag.Primitive.APPROACH, 1)
    # Time restarts in every subtask, and the support is the object of the navigation to it.
    assert nodes[10].projection == ("refrigerator_0", oag.Primitive.NAVIGATE_TO_SUPPORT, 1)
    assert nodes[11] == oag.Node(2, 2, oag.Primitive.MOVE_BASE_FORWARD, "glass_0", 0.4)


def test_edges_of_t1() -> None:
    drawn = graph().graph
    assert isinstance(drawn, networkx.DiGraph)
    transfers = [(a.subtask, b.subtask) for a, b, kind in drawn.edges(data="kind") if kind == "transfer"]
    assert transfers == [(0, 1), (1, 2), (2, 3)]
    assert all(feasible for _, _, feasible in drawn.edges(data="feasible"))


def test_an_infeasible_edge_is_marked() -> None:
    """Without CONVERGE the step from APPROACH to GRASP is in no plan that works."""
    edges = oag.compose(invalid("dropped_converge").task).edges
    assert [(e.source.primitive.name, e.target.primitive.name) for e in edges if not e.feasible] == [
        ("APPROACH", "GRASP")
    ]


@pytest.mark.parametrize(
    ("first", "second", "same_object", "expected"),
    [
        ("APPROACH", "CONVERGE", True, True),
        ("APPROACH", "CONVERGE", False, False),
        ("RETREAT", "GRASP", True, False),
        ("NAVIGATE_TO_TARGET", "APPROACH", True, True),
        ("NAVIGATE_TO_TARGET", "APPROACH", False, False),
        ("GRASP", "GRASP", True, False),
        ("UNGRASP", "ARTICULATE_OPEN", True, False),
        ("GRASP", "ARTICULATE_OPEN", True, True),
        ("UNGRASP", "NAVIGATE_TO_TARGET", False, True),
    ],
)
def test_feasibility(first: str, second: str, same_object: bool, expected: bool) -> None:
    assert feasible(oag.Primitive[first], oag.Primitive[second], same_object=same_object) is expected


def test_mermaid() -> None:
    assert_golden("T1_mermaid", oag.to_mermaid(graph()).rstrip("\n"))


def test_drawing_data() -> None:
    drawing = oag.to_drawing(graph())
    assert drawing["nodes"][4] == {
        "subtask": 0,
        "step": 4,
        "subtask_name": "open_refrigerator",
        "primitive": "UNGRASP",
        "object": "refrigerator_0",
        "parameter": None,
    }
    assert drawing["edges"][4] == {"source": 4, "target": 5, "kind": "transfer", "feasible": True}


def test_verifying_twice_is_the_same() -> None:
    once = graph()
    assert once.verify() is once.verify()
    assert str(once.verify()) == str(graph().verify())
