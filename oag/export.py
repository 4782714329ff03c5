"""The graph as text and data for reports: Mermaid, and plain lists that a drawing needs."""

from __future__ import annotations

from oag.actions import Action
from oag.graph import Node, ObjectActionGraph


def to_mermaid(graph: ObjectActionGraph) -> str:
    """Returns a Mermaid flowchart: one box a subtask, solid flow edges, dashed transfer edges."""
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


def to_drawing(graph: ObjectActionGraph) -> dict[str, list[dict[str, object]]]:
    """Returns the nodes and edges as plain data: indices into `nodes`, and names in words.

    Returns:
        `nodes` with `subtask`, `step` (both from 0), `subtask_name`, `primitive`, `object` and `parameter`; `edges`
        with `source`, `target`, `kind` and `feasible`.
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
    """Returns a node's name in Mermaid."""
    return f"s{node.subtask + 1}_{node.t}"


def _quoted(text: str) -> str:
    """Returns text that may stand between Mermaid's quotes."""
    return text.replace("&", "&amp;").replace('"', "&quot;").replace("<", "&lt;")
