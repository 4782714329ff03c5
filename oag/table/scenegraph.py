"""The scene-specific object-action graph G_{S_0}: what can be done to what in a scene, and what can follow it.

The graph over O x A x N+ repeats one layer for every t, so it is kept folded: a vertex is a pair (o, a), and an edge
stands for the edges from (o, a, t) to (o', a', t + 1) of all t. A flow is a walk through it; a walk that can run has
feasible edges only, and `verify` decides which of those walks reach a goal.

Source: the paper's scene-specific graph, V_{S_0} = O_{S_0} x A_prim x N+.
"""

from __future__ import annotations

from collections.abc import Iterable
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

from oag.model.primitives import Primitive
from oag.model.scene import Scene
from oag.table.feasible import applicable, feasible

if TYPE_CHECKING:
    import networkx


class Vertex(NamedTuple):
    """An object and what is done to it."""

    object: str
    primitive: Primitive

    def __str__(self) -> str:
        return f"{self.primitive.name}({self.object})"


class SceneGraph:
    """The scene-specific graph of one scene; immutable.

    Attributes:
        scene: The scene.
        vertices: Every pair of an object and a primitive, objects in the scene's order; those whose kinds do not fit
            have no edges.
    """

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        self.vertices = tuple(Vertex(name, primitive) for name in scene.objects for primitive in Primitive)

    def has_edge(self, source: Vertex, target: Vertex) -> bool:
        """Decides whether the second step can directly follow the first.

        Raises:
            SceneError: The scene has no such object.
        """
        return feasible(
            source.primitive,
            target.primitive,
            kinds=(self.scene[source.object].kind, self.scene[target.object].kind),
            same_object=source.object == target.object,
        )

    def first_break(self, walk: Iterable[Vertex]) -> int | None:
        """Returns the position of the first step that cannot follow the one before it, or None for a walk in the graph.

        A walk of one step is in the graph when its object's kind admits the primitive.

        Raises:
            SceneError: The scene has no such object.
        """
        steps = tuple(walk)
        for position, step in enumerate(steps):
            if position == 0:
                if not applicable(step.primitive, self.scene[step.object].kind):
                    return 0
            elif not self.has_edge(steps[position - 1], step):
                return position
        return None

    def shortest_walk(self, source: Vertex, target: Vertex) -> tuple[Vertex, ...] | None:
        """Returns a shortest walk between two vertices, both included, or None when there is none.

        Of several shortest ones it is the first in the order of the vertices, so the answer is always the same.

        Raises:
            SceneError: The scene has no such object.
        """
        import networkx

        ends = [Vertex(self.scene[vertex.object].id, vertex.primitive) for vertex in (source, target)]
        try:
            walk: list[Vertex] = networkx.shortest_path(self.folded, *ends)
        except networkx.NetworkXNoPath:
            return None
        return tuple(walk)

    @cached_property
    def folded(self) -> networkx.DiGraph:
        """The graph over (o, a) for networkx, with all feasible edges, self-loops included."""
        import networkx

        graph = networkx.DiGraph(name=self.scene.name)
        graph.add_nodes_from(self.vertices)
        graph.add_edges_from(
            (source, target) for source in self.vertices for target in self.vertices if self.has_edge(source, target)
        )
        return graph

    def unrolled(self, length: int) -> networkx.DiGraph:
        """Returns the graph over (o, a, t) for t from 1 to `length`, for networkx.

        Raises:
            ValueError: The length is less than 1.
        """
        import networkx

        if length < 1:
            raise ValueError(f"A flow has at least one step, so the length is 1 or more, not {length}.")
        graph = networkx.DiGraph(name=self.scene.name)
        graph.add_nodes_from((*vertex, t) for t in range(1, length + 1) for vertex in self.vertices)
        for source, target in self.folded.edges:
            graph.add_edges_from(((*source, t), (*target, t + 1)) for t in range(1, length))
        return graph
