"""Property 15: the shape of the object-action graph."""

from __future__ import annotations

import networkx
import pytest
from hypothesis import given, settings

import oag
from tests.properties.plans import Case, cases


@given(cases())
@settings(max_examples=100, deadline=None)
def test_p15_nodes_edges_and_their_projections(case: Case) -> None:
    check_shape(case)


@pytest.mark.slow
@given(cases())
@settings(max_examples=2000, deadline=None)
def test_p15_at_length(case: Case) -> None:
    check_shape(case)


def check_shape(case: Case) -> None:
    """Nodes project into O x A x N+, edges into E; one source, one sink, a transfer edge between two flows."""
    graph = oag.compose(case.task())
    objects = set(graph.scene.objects)
    for node in graph.nodes:
        assert node.object in objects
        assert node.primitive in oag.Primitive
        assert node.t >= 1
    starts = [node for node in graph.nodes if node.t == 1]
    flows = [part.flow for part in case.parts if part.flow]
    assert len(starts) == len(flows)
    if not graph.nodes:
        return
    drawn = graph.graph
    assert networkx.is_directed_acyclic_graph(drawn)
    assert [node for node in drawn if drawn.in_degree(node) == 0] == [graph.nodes[0]]
    assert [node for node in drawn if drawn.out_degree(node) == 0] == [graph.nodes[-1]]
    kinds = [kind for _, _, kind in drawn.edges(data="kind")]
    assert kinds.count("transfer") == len(flows) - 1
    assert len(kinds) == len(graph.nodes) - 1
    if graph.verify().verdict is oag.Verdict.PROVED:
        assert all(feasible for _, _, feasible in drawn.edges(data="feasible"))
