"""The object-action graph as inline SVG: one row a subtask, one box a step, coloured by its outcome."""

from __future__ import annotations

from executor.records import Rollout, number_text, readable
from executor.reports.html import in_light_colours, render, style
from oag import Node, ObjectActionGraph

# Pixels: a row of eight boxes is as wide as the report's page.
_MOST_PER_ROW = 8
_BOX_W, _BOX_H = 116, 52
_GAP_X, _GAP_Y = 16, 18
_MARGIN = 12
_TITLE_H = 26


def graph_picture(graph: ObjectActionGraph, rollout: Rollout | None = None) -> str:
    """Return an SVG element: flow edges solid, transfer edges dashed, steps tinted when a rollout is given.

    A flow longer than a row goes on in the next line. The colours come from the page's style sheet.
    """
    return render("graph.html", drawing=drawing(graph, rollout), sheet="")


def graph_file(graph: ObjectActionGraph) -> str:
    """Return the picture as a standalone SVG file, styled as in the report."""
    rules = in_light_colours(style("graph")).replace(".graph ", "")
    return render("graph.html", drawing=drawing(graph), sheet=rules) + "\n"


def drawing(graph: ObjectActionGraph, rollout: Rollout | None = None) -> dict[str, object]:
    """Return what the template of the picture draws: its size, arrows, titles and boxes [px]."""
    ran = [] if rollout is None else [step for subtask in rollout.subtasks for step in subtask.steps]
    states = {(step.subtask, step.step): "failed" if step.failure else "done" for step in ran}
    longest = max((len(subtask.flow or ()) for subtask in graph.task.subtasks), default=1)
    per_row = max(1, min(_MOST_PER_ROW, longest))
    titles: list[tuple[float, float, str]] = []
    places: dict[Node, tuple[float, float]] = {}
    y = float(_MARGIN)
    for index, subtask in enumerate(graph.task.subtasks):
        mine = [node for node in graph.nodes if node.subtask == index]
        titles.append((_MARGIN, y + 15, f"T{index + 1}  {readable(subtask.name)}"))
        y += _TITLE_H
        for k, node in enumerate(mine):
            left = float(_MARGIN + (k % per_row) * (_BOX_W + _GAP_X))
            places[node] = left, y + (k // per_row) * (_BOX_H + _GAP_Y)
        lines = max(1, -(-len(mine) // per_row))
        y += lines * (_BOX_H + _GAP_Y) + 6
    return {
        "width": 2 * _MARGIN + per_row * (_BOX_W + _GAP_X) - _GAP_X,
        "height": y + _MARGIN,
        "box_px": (_BOX_W, _BOX_H),
        "arrows": [_arrow(places[e.source], places[e.target], e.kind, e.feasible) for e in graph.edges],
        "titles": titles,
        "boxes": [(*at, states.get((node.subtask, node.t - 1), ""), *_words(node)) for node, at in places.items()],
    }


def _words(node: Node) -> tuple[str, list[tuple[str, float, str]]]:
    """Return the title of a box, and its lines, each with its font size [px] and its class."""
    words = node.primitive.name.replace("_TO_", " TO ").replace("MOVE_BASE_", "BASE ").replace("MOVE_EEF_", "EEF ")
    words = words.replace("LIFT_EEF_", "LIFT ").replace("_", " ")
    below, parameter = node.object, node.parameter
    if parameter is not None:
        values = parameter if isinstance(parameter, tuple) else [parameter]
        below += "  " + " ".join(number_text(value) for value in values)
    parts = words.split(" TO ")
    above = [parts[0], "TO " + parts[1]] if len(parts) == 2 else [words]
    return f"{node.primitive.name} {below}", [*((line, 11.5, "") for line in above), (below, 10.5, "small")]


def _arrow(start: tuple[float, float], end: tuple[float, float], kind: str, feasible: bool) -> tuple[str, str]:
    classes = " ".join(["edge", *(["transfer"] if kind == "transfer" else []), *([] if feasible else ["broken"])])
    (x0, y0), (x1, y1) = start, end
    if y0 == y1:
        return classes, f"M{x0 + _BOX_W} {y0 + _BOX_H / 2} H{x1 - 1}"
    # From the right end of one row to the left end of a later one, through the free band above that row.
    band = y1 - (_TITLE_H + 4 if kind == "transfer" else _GAP_Y / 2)
    right = x0 + _BOX_W + _GAP_X / 2
    return classes, f"M{x0 + _BOX_W} {y0 + _BOX_H / 2} H{right} V{band} H{x1 - 7} V{y1 + _BOX_H / 2} H{x1 - 1}"
