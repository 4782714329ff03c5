"""The object-action graph of T1: nodes, edges, feasibility, and its export."""

from __future__ import annotations

import networkx

import oag
from oag.graph import Node, to_dot, to_drawing, to_graphml, to_mermaid
from tests.oag.paper import DATA, assert_golden, invalid, scene


def graph() -> oag.ObjectActionGraph:
    return oag.compose(oag.Task.from_json(DATA / "T1.json", scene=scene("T1")))


def test_nodes_of_t1() -> None:
    nodes = graph().nodes
    assert len(nodes) == 20
    assert nodes[0][1:4] == (1, oag.Primitive.APPROACH, "refrigerator_0")
    # Time restarts in every subtask, and the support is the object of the navigation to it.
    assert nodes[10][1:4] == (1, oag.Primitive.NAVIGATE_TO_SUPPORT, "refrigerator_0")
    assert nodes[11] == Node(2, 2, oag.Primitive.MOVE_BASE_FORWARD, "glass_0", 0.4)


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


def test_mermaid() -> None:
    assert_golden("T1_mermaid", to_mermaid(graph()).rstrip("\n"))


def test_graphviz() -> None:
    assert_golden("T1_graphviz", to_dot(graph()).rstrip("\n"))


def test_graphml_is_read_back() -> None:
    read = networkx.parse_graphml(to_graphml(graph()))
    assert len(read) == 20
    assert read.nodes["s1_1"] == {"subtask": 0, "t": 1, "primitive": "APPROACH", "object": "refrigerator_0"}
    assert read.nodes["s3_2"]["parameter"] == "MOVE_BASE_FORWARD(0.4)"
    assert [pair for *pair, kind in read.edges(data="kind") if kind == "transfer"] == [
        ["s1_5", "s2_1"],
        ["s2_5", "s3_1"],
        ["s3_4", "s4_1"],
    ]


def test_drawing_data() -> None:
    drawing = to_drawing(graph())
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
