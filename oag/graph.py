"""The object-action graph of a task, over networkx, and its export: Mermaid, Graphviz, GraphML and JSON lists.

Nodes project into O x A x N+: object, primitive, and the position t in the flow, which restarts at 1 in every subtask.
Flow edges join successive steps of one subtask. A transfer edge joins the last step of a subtask to the first of the
next.

A step can directly follow another (`feasible`) when some state lets the first run and leaves a state that lets the
second run. That depends only on the two primitives, the kinds of their objects, and whether they are one object. So it
is a finite table, although the graph over O x A x N+ is not.

Source: the paper's universal object-action graph G = (V, E), V = O x A x N+, whose edges are "physically or
semantically feasible transitions", and its scene-specific subgraph.
"""

from __future__ import annotations

import io
import os
from collections.abc import Iterator, Mapping
from functools import cache, cached_property
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

from bddl.terminal import pluralize
from oag.flows import complete
from oag.model.actions import Action
from oag.model.codec import Source, brief
from oag.model.scene import Scene
from oag.model.symbols import (
    EMPTY,
    HAND,
    Condition,
    Fact,
    Kind,
    Parameter,
    Primitive,
    Value,
    applicable,
    gripping,
    holding,
)
from oag.picture import object_of
from oag.primitives.table import Clause, Context, effect, requirements
from oag.task_definition import Task, chosen_scene
from oag.verify.edits import Fix
from oag.verify.verify import Report, verify

if TYPE_CHECKING:
    import networkx

_FIRST, _SECOND, _THIRD = "x", "y", "z"  # Names of the objects in question.


class Node(NamedTuple):
    """One step of the plan as a vertex.

    Attributes:
        t: Position in its flow, from 1.
        object: Id of the object it is done to or goes to.
    """

    subtask: int
    t: int
    primitive: Primitive
    object: str
    parameter: Parameter

    def __repr__(self) -> str:
        action = Action(self.primitive, self.parameter)
        return brief(f"<Node T{self.subtask + 1}.{self.t} {action} {self.object}>")


class Edge(NamedTuple):
    """One edge; `kind` is "flow" within a subtask and "transfer" between two.

    `feasible`: the edge is in E_{S_0}, since the effect of the first step does not exclude the needs of the second.
    """

    source: Node
    target: Node
    kind: str
    feasible: bool

    def __repr__(self) -> str:
        ends = " to ".join(f"T{n.subtask + 1}.{n.t} {n.primitive.name} {n.object}" for n in (self.source, self.target))
        return brief(f"<Edge {self.kind}{'' if self.feasible else ', infeasible'}: {ends}>")


class ObjectActionGraph:
    """The graph of one task in one scene; immutable.

    Attributes:
        task: The plan, with the flows that were searched for it.
        searched: Indices of the subtasks whose flow was searched.
    """

    def __init__(self, task: Task, scene: Scene, searched: tuple[int, ...] = ()) -> None:
        self.task = task
        self.scene = scene
        self.searched = searched

    def __repr__(self) -> str:
        counted = pluralize(len(self.nodes), "step")
        return brief(f"<ObjectActionGraph of {counted} in {self.scene!r}, for {self.task!r}>")

    def _repr_html_(self) -> str:
        """Return the graph's picture with its verdict for a notebook."""
        return self.verify()._repr_html_()

    @cached_property
    def nodes(self) -> tuple[Node, ...]:
        """All steps of the plan, in order."""
        return tuple(
            Node(index, t, action.primitive, object_of(subtask, action), action.parameter)
            for index, subtask in enumerate(self.task.subtasks)
            for t, action in enumerate(subtask.flow or (), 1)
        )

    @cached_property
    def edges(self) -> tuple[Edge, ...]:
        """All edges, in order: every node has one to its successor."""
        kinds = {True: "flow", False: "transfer"}
        return tuple(Edge(a, b, kinds[a.subtask == b.subtask], self._feasible(a, b)) for a, b in pairwise(self.nodes))

    @cached_property
    def graph(self) -> networkx.DiGraph:
        """The graph for networkx: nodes are `Node`s, edges carry `kind` and `feasible`."""
        # networkx takes longer to import than everything else here together, and only drawing and analysis need it.
        import networkx

        graph = networkx.DiGraph(name=self.task.name)
        graph.add_nodes_from(self.nodes)
        graph.add_edges_from((e.source, e.target, {"kind": e.kind, "feasible": e.feasible}) for e in self.edges)
        return graph

    def _feasible(self, first: Node, second: Node) -> bool:
        """Decide whether an edge is in E; an object that the scene lacks is reported elsewhere, not here."""
        one, other = (self.scene.objects.get(node.object) for node in (first, second))
        if one is None or other is None:
            return True
        return feasible(first.primitive, second.primitive, kinds=(one.kind, other.kind), same_object=one is other)

    def verify(self) -> Report:
        """Decide whether the plan reaches its goal; the report is the same on every call."""
        return self._report

    @cached_property
    def _report(self) -> Report:
        return verify(self.task, self.scene, self.searched, repair=_fixes)


def _fixes(report: Report) -> tuple[Fix, ...]:
    # The search for plans is loaded where one is refuted.
    from oag.whole_fixes import find_all_fixes

    return find_all_fixes(report)


def compose(task: Task | Source, scene: Scene | None = None) -> ObjectActionGraph:
    """Return the object-action graph of a task; never raises for a wrong plan.

    A subtask without a flow gets one by search (`complete`); where none exists, the graph has no nodes for it and
    `verify` says why.

    Args:
        task: The plan: a `Task`, or the path or the mapping of a task's JSON.
        scene: The scene to judge it in; by default the one that the task carries.

    Raises:
        MissingScene: There is no scene, neither here nor with the task.
        TaskError: JSON that does not have the documented form, or something that is none of these.

    Example:
        >>> import oag
        >>> scene = oag.Scene.from_json({"objects": {"box_0": {"category": "drawer", "bbox_extent": [1, 1, 1]}}})
        >>> task = oag.Task.from_json({"sub_tasks": []}, scene=scene)
        >>> oag.compose(task).verify().verdict
        <Verdict.PROVED: 'PROVED'>
    """
    plan = Task.from_json(task, scene=scene) if isinstance(task, str | os.PathLike | Mapping) else task
    chosen = chosen_scene(plan, scene)
    completion = complete(plan, chosen)
    return ObjectActionGraph(completion.task, chosen, completion.searched)


@cache
def feasible(first: Primitive, second: Primitive, *, kinds: tuple[Kind, Kind], same_object: bool) -> bool:
    """Decide whether one primitive can directly follow another, given the kinds of their objects.

    True when some state meets the needs of the first and, after its effect, those of the second. False for a step that
    its object's kind rules out, and for a sequence such as RETREAT, GRASP.
    """
    if not all(map(applicable, (first, second), kinds)):
        return False
    names = (_FIRST, _FIRST if same_object else _SECOND)
    before, after = (Context(name, name, None, kind is Kind.ITEM, ()) for name, kind in zip(names, kinds, strict=True))
    return any(_follows(first, second, before, after, hand) for hand in _hands(before, after))


def _follows(first: Primitive, second: Primitive, before: Context, after: Context, hand: Value) -> bool:
    """Decide `feasible` for one value of the hand at the start; everything else is free to fit."""
    state: dict[Fact, Value] = {HAND: hand}
    for clause in requirements(first, before, hand):
        if not _admit(clause, state):
            return False
    state.update(effect(first, before, hand))
    return all(_admit(clause, state) for clause in requirements(second, after, state[HAND]))


def _admit(clause: Clause, state: dict[Fact, Value]) -> bool:
    """Decide whether a clause can hold in a partial state; a single literal that was free is fixed."""
    graded = [condition.grade(state.get(condition.fact)) for condition in clause]
    if len(clause) == 1 and graded[0] is None:
        only: Condition = clause[0]
        state[only.fact] = only.value
    return any(grade is not False for grade in graded)


def _hands(before: Context, after: Context) -> Iterator[Value]:
    yield EMPTY
    yield holding(_THIRD)
    yield gripping(_THIRD)
    for context in (before, after):
        yield holding(context.target) if context.target_is_item else gripping(context.target)


def to_mermaid(graph: ObjectActionGraph) -> str:
    """Return a Mermaid flowchart: one box a subtask, solid flow edges, dashed transfer edges."""
    lines = ["flowchart LR"]
    for index, subtask in enumerate(graph.task.subtasks):
        lines.append(f'    subgraph T{index + 1}["T{index + 1} {_quoted(subtask.name)}"]')
        lines.extend(
            f'        {_name(node)}["{Action(node.primitive, node.parameter)}<br/>{_quoted(node.object)}"]'
            for node in graph.nodes
            if node.subtask == index
        )
        lines.append("    end")
    for edge in graph.edges:
        arrow = "-->" if edge.kind == "flow" else "-.->"
        lines.append(f"    {_name(edge.source)} {arrow} {_name(edge.target)}")
    return "\n".join(lines) + "\n"


def to_dot(graph: ObjectActionGraph) -> str:
    """Return the graph in Graphviz's language: a cluster a subtask, dashed transfer edges, infeasible edges red."""
    lines = ["digraph {", "    rankdir=LR;", '    node [shape=box, style=rounded, fontname="sans-serif"];']
    for index, subtask in enumerate(graph.task.subtasks):
        lines += [f"    subgraph cluster_{index + 1} {{", f'        label="T{index + 1} {_escaped(subtask.name)}";']
        lines.extend(
            f'        {_name(node)} [label="{Action(node.primitive, node.parameter)}\\n{_escaped(node.object)}"];'
            for node in graph.nodes
            if node.subtask == index
        )
        lines.append("    }")
    for edge in graph.edges:
        style = ["style=dashed"] if edge.kind == "transfer" else []
        style += [] if edge.feasible else ["color=red"]
        ending = f" [{', '.join(style)}]" if style else ""
        lines.append(f"    {_name(edge.source)} -> {_name(edge.target)}{ending};")
    return "\n".join([*lines, "}"]) + "\n"


def to_graphml(graph: ObjectActionGraph) -> str:
    """Return the graph as GraphML, for yEd, Gephi or networkx: nodes named `s1_1`, with their parts as attributes."""
    import networkx

    drawn = networkx.DiGraph()
    for node in graph.nodes:
        parameter = {} if node.parameter is None else {"parameter": str(Action(node.primitive, node.parameter))}
        drawn.add_node(
            _name(node), subtask=node.subtask, t=node.t, primitive=node.primitive.name, object=node.object, **parameter
        )
    for edge in graph.edges:
        drawn.add_edge(_name(edge.source), _name(edge.target), kind=edge.kind, feasible=edge.feasible)
    written = io.BytesIO()
    networkx.write_graphml(drawn, written)
    return written.getvalue().decode() + "\n"


def to_drawing(graph: ObjectActionGraph) -> dict[str, list[dict[str, object]]]:
    """Return the nodes and edges as plain data: indices into `nodes`, and names in words.

    Subtasks and steps count from 0.
    """
    position = {node: index for index, node in enumerate(graph.nodes)}
    nodes: list[dict[str, object]] = [
        {
            "subtask": node.subtask,
            "step": node.t - 1,
            "subtask_name": graph.task.subtasks[node.subtask].name,
            "primitive": node.primitive.name,
            "object": node.object,
            "parameter": list(node.parameter) if isinstance(node.parameter, tuple) else node.parameter,
        }
        for node in graph.nodes
    ]
    edges: list[dict[str, object]] = [
        {"source": position[e.source], "target": position[e.target], "kind": e.kind, "feasible": e.feasible}
        for e in graph.edges
    ]
    return {"nodes": nodes, "edges": edges}


def _name(node: Node) -> str:
    return f"s{node.subtask + 1}_{node.t}"


def _escaped(text: str) -> str:
    return text.replace("\\", "\\\\").replace('"', '\\"')


def _quoted(text: str) -> str:
    return text.replace("&", "&amp;").replace('"', "&quot;").replace("<", "&lt;")
