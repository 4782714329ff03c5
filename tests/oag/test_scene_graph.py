"""The scene-specific graph: its size, its edges, walks through it, and flows as walks."""

from __future__ import annotations

import networkx
import pytest

import oag
from oag import Primitive, Vertex
from tests.oag.paper import DATA, scene

GLASS, FRIDGE, TABLE = "glass_0", "refrigerator_0", "table_0"


@pytest.fixture(scope="module")
def kitchen() -> oag.SceneGraph:
    return oag.SceneGraph(scene("T1"))


def test_vertices_are_all_pairs_of_objects_and_primitives(kitchen: oag.SceneGraph) -> None:
    assert len(kitchen.vertices) == 21 * len(kitchen.scene.objects)
    assert isinstance(kitchen.folded, networkx.DiGraph)
    assert set(kitchen.folded) == set(kitchen.vertices)


def test_what_a_kind_rules_out_has_no_edges(kitchen: oag.SceneGraph) -> None:
    for vertex in (Vertex(TABLE, Primitive.GRASP), Vertex(GLASS, Primitive.ARTICULATE_OPEN)):
        assert kitchen.folded.degree(vertex) == 0
        assert kitchen.first_break([vertex]) == 0


@pytest.mark.parametrize("name", ["T1", "T2", "T3", "T4"])
def test_every_flow_of_the_paper_is_a_walk(name: str) -> None:
    graph = oag.compose(oag.Task.from_json(DATA / f"{name}.json", scene=scene(name)))
    assert graph.broken_edges == ()
    for index, subtask in enumerate(graph.task.subtasks):
        walk = graph.path(index)
        assert len(walk) == len(subtask.flow or ())
        assert graph.scene_graph.first_break(walk) is None


def test_a_walk_breaks_where_a_step_cannot_follow(kitchen: oag.SceneGraph) -> None:
    walk = [Vertex(GLASS, Primitive(step)) for step in (17, 1, 3)]
    assert kitchen.first_break(walk) == 2


def test_the_shortest_walk_to_an_open_door(kitchen: oag.SceneGraph) -> None:
    start, end = Vertex(FRIDGE, Primitive.NAVIGATE_TO_TARGET), Vertex(FRIDGE, Primitive.ARTICULATE_OPEN)
    walk = kitchen.shortest_walk(start, end)
    assert walk is not None
    assert walk[0] == start and walk[-1] == end
    assert kitchen.first_break(walk) is None
    # The relation speaks of neighbours only: whoever already grips the door may step about before opening it.
    assert [str(vertex) for vertex in walk] == [
        "NAVIGATE_TO_TARGET(refrigerator_0)",
        "ARTICULATE_OPEN(refrigerator_0)",
    ]


def test_there_is_no_walk_to_what_cannot_be_done(kitchen: oag.SceneGraph) -> None:
    source = Vertex(GLASS, Primitive.NAVIGATE_TO_TARGET)
    assert kitchen.shortest_walk(source, Vertex(GLASS, Primitive.ARTICULATE_OPEN)) is None


def test_an_unknown_object_is_named_with_near_ones(kitchen: oag.SceneGraph) -> None:
    with pytest.raises(oag.SceneError, match="did you mean glass_0"):
        kitchen.has_edge(Vertex("cup_0", Primitive.GRASP), Vertex(GLASS, Primitive.GRASP))


def test_the_unrolled_graph_has_a_layer_for_each_step(kitchen: oag.SceneGraph) -> None:
    unrolled = kitchen.unrolled(3)
    assert unrolled.number_of_nodes() == 3 * len(kitchen.vertices)
    assert unrolled.number_of_edges() == 2 * kitchen.folded.number_of_edges()
    assert all(later == earlier + 1 for (_, _, earlier), (_, _, later) in unrolled.edges)
    with pytest.raises(ValueError, match="1 or more"):
        kitchen.unrolled(0)


def test_a_plan_as_it_concerns_one_object() -> None:
    graph = oag.compose(oag.Task.from_json(DATA / "T1.json", scene=scene("T1")))
    doors = graph.slice_of(FRIDGE)
    assert {node.subtask for node in doors} == {0, 2, 3}
    between = graph.between(graph.nodes[3], graph.nodes[6])
    assert [node.primitive.name for node in between] == [node.primitive.name for node in graph.nodes[3:7]]
    assert graph.between(graph.nodes[6], graph.nodes[3]) == ()
