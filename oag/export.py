"""The graph as text and data: Mermaid, Graphviz, GraphML, and plain lists that are JSON and that a drawing needs."""

from __future__ import annotations

import io

from oag.graph import Node, ObjectActionGraph
from oag.model.actions import Action


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


def to_dot(graph: ObjectActionGraph) -> str:
    """Returns the graph in Graphviz's language: a cluster a subtask, dashed transfer edges, infeasible edges red."""
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
    """Returns the graph as GraphML, for yEd, Gephi or networkx: nodes named `s1_1`, with their parts as attributes."""
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
    return f"s{node.subtask + 1}_{node.t}"


def _escaped(text: str) -> str:
    """Returns text that may stand between Graphviz's quotes."""
    return text.replace("\\", "\\\\").replace('"', '\\"')


def _quoted(text: str) -> str:
    """Returns text that may stand between Mermaid's quotes."""
    return text.replace("&", "&amp;").replace('"', "&quot;").replace("<", "&lt;")
