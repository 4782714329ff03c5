"""The object-action graph as SVG in the report's style: one row a subtask, one box a step, coloured by its outcome."""

from __future__ import annotations

from executor.records import Rollout
from executor.reports.html import in_light_colours, style
from oag import ObjectActionGraph
from oag.picture import Drawing, drawing, svg


def graph_picture(graph: ObjectActionGraph, rollout: Rollout | None = None) -> str:
    """Return an SVG element: flow edges solid, transfer edges dashed, steps tinted when a rollout is given.

    The colours come from the page's style sheet.
    """
    return svg(graph_drawing(graph, rollout))


def graph_file(graph: ObjectActionGraph) -> str:
    """Return the picture as a standalone SVG file, styled as in the report."""
    return svg(graph_drawing(graph), in_light_colours(style("graph")).replace(".graph ", "")) + "\n"


def graph_drawing(graph: ObjectActionGraph, rollout: Rollout | None = None) -> Drawing:
    """Return the drawing of a graph; steps that a rollout ran are done or failed."""
    ran = [] if rollout is None else [step for subtask in rollout.subtasks for step in subtask.steps]
    states = {(step.subtask, step.step): "failed" if step.failure else "done" for step in ran}
    broken = {(edge.target.subtask, edge.target.t - 1) for edge in graph.edges if not edge.feasible}
    return drawing(graph.task, states, broken)
