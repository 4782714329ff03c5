"""The object-action graph of a task: what is done to what in which order, over networkx.

Nodes project into O x A x N+: object, primitive, and the position t in the flow, which restarts at 1 in every subtask.
Flow edges join successive steps of one subtask; a transfer edge joins the last step of a subtask to the first of the
next.

A step can directly follow another (`feasible`) when some state lets the first run and leaves a state that lets the
second run. That depends on the two primitives, on the kinds of their objects and on whether they are one object, and
on nothing else; so it is a finite table, although the graph over O x A x N+ is not.

Source: the paper's universal object-action graph G = (V, E), V = O x A x N+, whose edges are "physically or
semantically feasible transitions", and its scene-specific subgraph.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from functools import cache, cached_property
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

from bddl.visible import counted
from oag.flows.completion import complete
from oag.model.categories import Kind
from oag.model.facts import EMPTY, HAND, Condition, Fact, Value, gripping, holding
from oag.model.jsonfile import Source
from oag.model.primitives import Parameter, Primitive, applicable
from oag.model.scene import Scene
from oag.report import Report
from oag.table.library import Clause, Context, effect, requirements
from oag.task.task import SimpleTask, Task, chosen_scene
from oag.verify import verify

if TYPE_CHECKING:
    import networkx

_FIRST, _SECOND, _THIRD = "x", "y", "z"  # Names of objects that the question is asked of.


class Node(NamedTuple):
    """One step of the plan as a vertex.

    Attributes:
        subtask: Index of the subtask, from 0.
        t: Position in its flow, from 1.
        primitive: What is done.
        object: Id of the object it is done to or goes to.
        parameter: Its number, None where it takes none or none is filled in.
    """

    subtask: int
    t: int
    primitive: Primitive
    object: str
    parameter: Parameter


class Edge(NamedTuple):
    """One edge; `kind` is "flow" within a subtask and "transfer" between two.

    `feasible` says whether the edge is in E_{S_0}: what the first step does must not exclude what the second needs.
    """

    source: Node
    target: Node
    kind: str
    feasible: bool


class ObjectActionGraph:
    """The graph of one task in one scene; immutable.

    Attributes:
        task: The plan, with the flows that were searched for it.
        scene: The scene it is for.
        searched: Indices of the subtasks whose flow was searched.
        nodes: All steps, in order.
    """

    def __init__(self, task: Task, scene: Scene, searched: tuple[int, ...] = ()) -> None:
        self.task = task
        self.scene = scene
        self.searched = searched
        self.nodes = tuple(
            Node(index, t, action.primitive, _object(subtask, action.primitive), action.parameter)
            for index, subtask in enumerate(task.subtasks)
            for t, action in enumerate(subtask.flow or (), 1)
        )

    def __repr__(self) -> str:
        return f"<ObjectActionGraph of {self.task!r} in {self.scene!r}: {counted(len(self.nodes), 'step')}>"

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
        """Decides whether an edge is in E; an object that the scene lacks is reported elsewhere, not here."""
        one, other = (self.scene.objects.get(node.object) for node in (first, second))
        if one is None or other is None:
            return True
        return feasible(first.primitive, second.primitive, kinds=(one.kind, other.kind), same_object=one is other)

    def verify(self) -> Report:
        """Decides whether the plan reaches its goal; the report is the same on every call."""
        return self._report

    @cached_property
    def _report(self) -> Report:
        return verify(self.task, self.scene, self.searched)


def compose(task: Task | Source, scene: Scene | None = None) -> ObjectActionGraph:
    """Returns the object-action graph of a task; never raises for a wrong plan.

    A subtask without a flow gets one by search (`complete`); where none exists, the graph has no nodes for it and
    `verify` says why.

    Args:
        task: The plan: a `Task`, or the path or the mapping of a task's JSON.
        scene: The scene to judge it in; by default the one that the task carries.

    Raises:
        MissingScene: There is no scene, neither here nor with the task.
        TaskError: JSON that does not have the documented form, or something that is none of these.
        SceneError: The scene is no `Scene`.

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


def _object(subtask: SimpleTask, primitive: Primitive) -> str:
    if primitive is Primitive.NAVIGATE_TO_SUPPORT and subtask.support_goal is not None:
        return subtask.support_goal
    return subtask.target


@cache
def feasible(first: Primitive, second: Primitive, *, kinds: tuple[Kind, Kind], same_object: bool) -> bool:
    """Decides whether one primitive can directly follow another.

    Args:
        first: What ran.
        second: What is to run.
        kinds: Kind of the object that each of them acts on or goes to.
        same_object: Whether that is one object; its two kinds are then equal.

    Returns:
        True when some state satisfies what the first needs and, after what the first does, what the second needs.
        False for a step that its object's kind rules out, and for a sequence such as RETREAT, GRASP.
    """
    if not all(map(applicable, (first, second), kinds)):
        return False
    names = (_FIRST, _FIRST if same_object else _SECOND)
    before, after = (Context(name, name, None, kind is Kind.ITEM, ()) for name, kind in zip(names, kinds, strict=True))
    return any(_follows(first, second, before, after, hand) for hand in _hands(before, after))


def _follows(first: Primitive, second: Primitive, before: Context, after: Context, hand: Value) -> bool:
    """Decides `feasible` for one value of the hand at the start; everything else is free to fit."""
    state: dict[Fact, Value] = {HAND: hand}
    for clause in requirements(first, before, hand):
        if not _admit(clause, state):
            return False
    state.update(effect(first, before, hand))
    return all(_admit(clause, state) for clause in requirements(second, after, state[HAND]))


def _admit(clause: Clause, state: dict[Fact, Value]) -> bool:
    """Decides whether a clause can hold in a partial state, and if a single literal was free, fixes it."""
    graded = [condition.grade(state.get(condition.fact)) for condition in clause]
    if len(clause) == 1 and graded[0] is None:
        only: Condition = clause[0]
        state[only.fact] = only.value
    return any(grade is not False for grade in graded)


def _hands(before: Context, after: Context) -> Iterator[Value]:
    """Yields what the hand can be doing: nothing, or holding or gripping either object or a third one."""
    yield EMPTY
    yield holding(_THIRD)
    yield gripping(_THIRD)
    for context in (before, after):
        yield holding(context.target) if context.target_is_item else gripping(context.target)
