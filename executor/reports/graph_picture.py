"""The object-action graph as inline SVG: one row a subtask, one box a step, coloured by its outcome."""

from __future__ import annotations

from executor.records import Rollout, number_text, readable
from executor.reports.html import in_light_colours, style, text
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
    ran = [] if rollout is None else [step for subtask in rollout.subtasks for step in subtask.steps]
    states = {(step.subtask, step.step): "failed" if step.failure else "done" for step in ran}
    longest = max((len(subtask.flow or ()) for subtask in graph.task.subtasks), default=1)
    per_row = max(1, min(_MOST_PER_ROW, longest))
    parts: list[str] = []
    places: dict[Node, tuple[float, float]] = {}
    y = float(_MARGIN)
    for index, subtask in enumerate(graph.task.subtasks):
        mine = [node for node in graph.nodes if node.subtask == index]
        title = f"T{index + 1}  {readable(subtask.name)}"
        parts.append(f'<text x="{_MARGIN}" y="{y + 15}" font-size="13" font-weight="600">{text(title)}</text>')
        y += _TITLE_H
        for k, node in enumerate(mine):
            left = float(_MARGIN + (k % per_row) * (_BOX_W + _GAP_X))
            places[node] = left, y + (k // per_row) * (_BOX_H + _GAP_Y)
        lines = max(1, -(-len(mine) // per_row))
        y += lines * (_BOX_H + _GAP_Y) + 6
    parts += [_box(node, *place, states.get((node.subtask, node.t - 1), "")) for node, place in places.items()]
    arrows = [_arrow(places[e.source], places[e.target], e.kind, e.feasible) for e in graph.edges]
    width = 2 * _MARGIN + per_row * (_BOX_W + _GAP_X) - _GAP_X
    head = (
        '<defs><marker id="head" viewBox="0 0 8 8" refX="7" refY="4" markerWidth="7" markerHeight="7" orient="auto">'
        '<path class="head" d="M0 0 8 4 0 8z"/></marker></defs>'
    )
    return (
        f'<svg viewBox="0 0 {width} {y + _MARGIN:.0f}" role="img" aria-label="object-action graph">'
        f"{head}{''.join(arrows)}{''.join(parts)}</svg>"
    )


def graph_file(graph: ObjectActionGraph) -> str:
    """Return the picture as a standalone SVG file, styled as in the report."""
    picture = graph_picture(graph)
    rules = in_light_colours(style("graph")).replace(".graph ", "")
    head, body = picture.split(">", 1)
    return f'{head} xmlns="http://www.w3.org/2000/svg"><style>{rules}</style>{body}\n'


def _box(node: Node, x: float, y: float, state: str) -> str:
    primitive = node.primitive.name
    words = primitive.replace("_TO_", " TO ").replace("MOVE_BASE_", "BASE ").replace("MOVE_EEF_", "EEF ")
    words = words.replace("LIFT_EEF_", "LIFT ").replace("_", " ")
    below, parameter = node.object, node.parameter
    if parameter is not None:
        values = parameter if isinstance(parameter, tuple) else [parameter]
        below += "  " + " ".join(number_text(value) for value in values)
    lines = words.split(" TO ")
    first, second = (lines[0], "TO " + lines[1]) if len(lines) == 2 else (words, "")
    label = f"{primitive} {below}"
    rows = [(first, 11.5, ""), *([(second, 11.5, "")] if second else []), (below, 10.5, "small")]
    start = y + _BOX_H / 2 - (len(rows) - 1) * 7.5 + 4
    written = "".join(
        f'<text class="{kind}" x="{x + _BOX_W / 2}" y="{start + 15 * k:.1f}" font-size="{size}" '
        f'text-anchor="middle"{_squeeze(row, size)}>{text(row)}</text>'
        for k, (row, size, kind) in enumerate(rows)
    )
    return (
        f'<g><title>{text(label)}</title><rect class="node {state}" x="{x}" y="{y}" width="{_BOX_W}" '
        f'height="{_BOX_H}" rx="9"/>{written}</g>'
    )


def _squeeze(row: str, size: float) -> str:
    """Return an attribute that fits a long row into its box; the factor is a usual letter's width."""
    room = _BOX_W - 10
    return f' textLength="{room}" lengthAdjust="spacingAndGlyphs"' if len(row) * size * 0.62 > room else ""


def _arrow(start: tuple[float, float], end: tuple[float, float], kind: str, feasible: bool) -> str:
    classes = " ".join(["edge", *(["transfer"] if kind == "transfer" else []), *([] if feasible else ["broken"])])
    (x0, y0), (x1, y1) = start, end
    if y0 == y1:
        path = f"M{x0 + _BOX_W} {y0 + _BOX_H / 2} H{x1 - 1}"
    else:
        # From the right end of one row to the left end of a later one, through the free band above that row.
        band = y1 - (_TITLE_H + 4 if kind == "transfer" else _GAP_Y / 2)
        right = x0 + _BOX_W + _GAP_X / 2
        path = f"M{x0 + _BOX_W} {y0 + _BOX_H / 2} H{right} V{band} H{x1 - 7} V{y1 + _BOX_H / 2} H{x1 - 1}"
    return f'<path class="{classes}" d="{path}" marker-end="url(#head)"/>'
