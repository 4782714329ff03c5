"""Pictures of plans as SVG, without Graphviz: one row a subtask, one box a step; and of a verdict, for notebooks.

Everything that is shown of a plan is escaped.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from html import escape
from itertools import pairwise
from typing import NamedTuple

from oag.model.actions import Action
from oag.model.symbols import Parameter, Primitive
from oag.task_definition import SimpleTask, Task

# Pixels: a row of eight boxes is as wide as a page.
_MOST_PER_ROW = 8
_BOX_W, _BOX_H = 116, 52
_GAP_X, _GAP_Y = 16, 18
_MARGIN = 12
_TITLE_H = 26

_Place = tuple[int, int]
"""Index of a subtask, and of a step in its flow."""


class Box(NamedTuple):
    """A step: upper left corner [px], its state, its whole text, and its lines with font size [px] and class."""

    x: float
    y: float
    state: str
    title: str
    lines: tuple[tuple[str, float, str], ...]


class Drawing(NamedTuple):
    """What a picture has.

    Attributes:
        arrows: Classes and path of each edge.
        titles: Place [px] and text of each subtask's name.
    """

    width_px: float
    height_px: float
    arrows: tuple[tuple[str, str], ...]
    titles: tuple[tuple[float, float, str], ...]
    boxes: tuple[Box, ...]


def drawing(task: Task, states: Mapping[_Place, str], broken: Collection[_Place] = ()) -> Drawing:
    """Return the drawing of a plan: flow edges solid, transfer edges dashed, steps tinted by their states.

    A flow longer than a row goes on in the next line.

    Args:
        task: The plan.
        states: Class of a step, such as "done" or "failed"; those left out are plain.
        broken: Steps that the edge from the step before cannot lead to.
    """
    longest = max((len(subtask.flow or ()) for subtask in task.subtasks), default=1)
    per_row = max(1, min(_MOST_PER_ROW, longest))
    titles: list[tuple[float, float, str]] = []
    places: dict[_Place, tuple[float, float]] = {}
    boxes: list[Box] = []
    y = float(_MARGIN)
    for index, subtask in enumerate(task.subtasks):
        titles.append((_MARGIN, y + 15, f"T{index + 1}  {subtask.name.replace('_', ' ')}"))
        y += _TITLE_H
        flow = subtask.flow or ()
        for k, action in enumerate(flow):
            left = float(_MARGIN + (k % per_row) * (_BOX_W + _GAP_X))
            places[index, k] = left, y + (k // per_row) * (_BOX_H + _GAP_Y)
            boxes.append(
                Box(*places[index, k], states.get((index, k), ""), *_words(action, object_of(subtask, action)))
            )
        y += max(1, -(-len(flow) // per_row)) * (_BOX_H + _GAP_Y) + 6
    arrows = tuple(
        _arrow(start, end, transfer=one[0] != other[0], broken=other in broken)
        for (one, start), (other, end) in pairwise(places.items())
    )
    width = 2 * _MARGIN + per_row * (_BOX_W + _GAP_X) - _GAP_X
    return Drawing(width, y + _MARGIN, arrows, tuple(titles), tuple(boxes))


def object_of(subtask: SimpleTask, action: Action) -> str:
    """Return the id of the object that a step is done to, or goes to."""
    if action.primitive is Primitive.NAVIGATE_TO_SUPPORT and subtask.support_goal is not None:
        return subtask.support_goal
    return subtask.target


def _words(action: Action, name: str) -> tuple[str, tuple[tuple[str, float, str], ...]]:
    words = action.primitive.name.replace("_TO_", " TO ").replace("MOVE_BASE_", "BASE ").replace("MOVE_EEF_", "EEF ")
    words = words.replace("LIFT_EEF_", "LIFT ").replace("_", " ")
    below = name + _numbers(action.parameter)
    parts = words.split(" TO ")
    above = [parts[0], "TO " + parts[1]] if len(parts) == 2 else [words]
    return f"{action.primitive.name} {below}", (*((line, 11.5, "") for line in above), (below, 10.5, "small"))


def _numbers(parameter: Parameter) -> str:
    if parameter is None:
        return ""
    values = parameter if isinstance(parameter, tuple) else (parameter,)
    # Below a millionth counts as zero: no length or angle is finer.
    return "  " + " ".join("0" if abs(value) < 1e-6 else f"{value:.4g}" for value in values)


def _arrow(start: tuple[float, float], end: tuple[float, float], *, transfer: bool, broken: bool) -> tuple[str, str]:
    classes = " ".join(["edge", *(["transfer"] if transfer else []), *(["broken"] if broken else [])])
    (x0, y0), (x1, y1) = start, end
    if y0 == y1:
        return classes, f"M{x0 + _BOX_W} {y0 + _BOX_H / 2} H{x1 - 1}"
    # From the right end of one row to the left end of a later one, through the free band above that row.
    band = y1 - (_TITLE_H + 4 if transfer else _GAP_Y / 2)
    right = x0 + _BOX_W + _GAP_X / 2
    return classes, f"M{x0 + _BOX_W} {y0 + _BOX_H / 2} H{right} V{band} H{x1 - 7} V{y1 + _BOX_H / 2} H{x1 - 1}"


def svg(drawn: Drawing, sheet: str = "") -> str:
    """Return a drawing as an SVG element; with a style sheet it is a file of its own."""
    own = f' xmlns="http://www.w3.org/2000/svg"><style>{sheet}</style>' if sheet else ">"
    size = f'viewBox="0 0 {drawn.width_px} {drawn.height_px:.0f}"'
    lines = [
        f'<svg {size} role="img" aria-label="object-action graph"{own}',
        '<defs><marker id="head" viewBox="0 0 8 8" refX="7" refY="4" markerWidth="7" markerHeight="7" orient="auto">',
        '<path class="head" d="M0 0 8 4 0 8z"/></marker></defs>',
        *(f'<path class="{classes}" d="{path}" marker-end="url(#head)"/>' for classes, path in drawn.arrows),
        *(f'<text x="{x}" y="{y}" font-size="13" font-weight="600">{escape(t)}</text>' for x, y, t in drawn.titles),
    ]
    for box in drawn.boxes:
        lines.append(f"<g><title>{escape(box.title)}</title>")
        lines.append(
            f'<rect class="node {box.state}" x="{box.x}" y="{box.y}" width="{_BOX_W}" height="{_BOX_H}" rx="9"/>'
        )
        for number, (words, font, kind) in enumerate(box.lines):
            down = box.y + _BOX_H / 2 - (len(box.lines) - 1) * 7.5 + 4 + 15 * number
            # A long line is fitted into its box; the factor is a usual letter's width.
            fitted = f' textLength="{_BOX_W - 10}" lengthAdjust="spacingAndGlyphs"'
            wide = len(words) * font * 0.62 > _BOX_W - 10
            lines.append(
                f'<text class="{kind}" x="{box.x + _BOX_W / 2}" y="{down:.1f}" font-size="{font}" '
                f'text-anchor="middle"{fitted if wide else ""}>{escape(words)}</text>'
            )
        lines.append("</g>")
    return "\n".join([*lines, "</svg>"])


_LIGHT = """.oag text{font-family:system-ui,sans-serif;fill:#1d2430}.oag .small{fill:#5d6878}
.oag .node{fill:#fff;stroke:#c8cfda;stroke-width:1.5}.oag .done{fill:#e7f6ec;stroke:#2c8a4b}
.oag .open{fill:#fff6dd;stroke:#b98900}.oag .failed{fill:#fdeaea;stroke:#c23434;stroke-width:2.5}
.oag .edge{stroke:#5d6878;stroke-width:1.5;fill:none}.oag .transfer{stroke:#3a66c4;stroke-dasharray:5 4}
.oag .broken{stroke:#c23434;stroke-width:2.5}.oag .head{fill:#5d6878}"""
_COLOURS = {"PROVED": "#2c8a4b", "CONDITIONAL": "#b98900", "REFUTED": "#c23434"}
_GREY = "#9aa4b2"
_BAR_W, _BAR_GAP, _BARS_H, _AXIS = 56, 26, 220, 46


def html(verdict: str, head: str, drawn: Drawing, findings: str) -> str:
    """Return a verdict with its heading, a drawing, and findings as text, as one element for a notebook."""
    text = f"<pre>{escape(findings)}</pre>" if findings else ""
    bold = f'<b style="color:{_COLOURS.get(verdict, "inherit")}">{escape(verdict)}</b>'
    picture = f'<div style="max-width:{drawn.width_px:.0f}px">{svg(drawn)}</div>' if drawn.boxes else ""
    return f'<div class="oag"><style>{_LIGHT}</style><p>{bold} {escape(head)}</p>{picture}{text}</div>'


def bars(title: str, across: str, up: str, rows: Sequence[tuple[str, Sequence[tuple[int, str, str]]]]) -> str:
    """Return a bar chart as an SVG file.

    Args:
        title: Its heading.
        across: What the bars are by.
        up: What their heights count.
        rows: For each bar its label, and its parts from below: count, verdict that colours it, and text.
    """
    most = max((sum(count for count, *_ in parts) for _, parts in rows), default=1)
    legend = [
        name for name in (*_COLOURS, "none") if any(name == verdict for _, parts in rows for _, verdict, _ in parts)
    ]
    width = max(2 * _AXIS + len(rows) * (_BAR_W + _BAR_GAP), 420)
    height, floor = _BARS_H + 3 * _AXIS, _BARS_H + _AXIS
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" width="{width}" role="img" '
        f'aria-label="{escape(title)}" font-family="system-ui,sans-serif" font-size="12" fill="#1d2430">',
        f'<text x="{width / 2}" y="20" text-anchor="middle" font-size="14">{escape(title[:60])}</text>',
        f'<path d="M{_AXIS} {_AXIS - 8} V{floor} H{width - 12}" stroke="#5d6878" fill="none"/>',
        f'<text x="{width / 2}" y="{floor + 36}" text-anchor="middle">{escape(across)}</text>',
        f'<text transform="translate(14 {floor - _BARS_H / 2}) rotate(-90)" text-anchor="middle">{escape(up)}</text>',
    ]
    for tick in sorted({0, most // 2, most}):
        y = floor - _BARS_H * tick / most
        lines.append(f'<text x="{_AXIS - 6}" y="{y + 4:.1f}" text-anchor="end">{tick}</text>')
    for number, (label, parts) in enumerate(rows):
        x, y = _AXIS + _BAR_GAP + number * (_BAR_W + _BAR_GAP), float(floor)
        for count, verdict, text in parts:
            tall = _BARS_H * count / most
            y -= tall
            lines.append(
                f'<rect x="{x}" y="{y:.1f}" width="{_BAR_W}" height="{tall:.1f}" fill="{_COLOURS.get(verdict, _GREY)}" '
                f'stroke="#fff"><title>{escape(text)}</title></rect>'
            )
            lines.append(
                f'<text x="{x + _BAR_W / 2}" y="{y + tall / 2 + 4:.1f}" text-anchor="middle" fill="#fff">{count}</text>'
            )
        lines.append(f'<text x="{x + _BAR_W / 2}" y="{floor + 16}" text-anchor="middle">{escape(label)}</text>')
    for number, name in enumerate(legend):
        x = _AXIS + 110 * number
        words = "no task" if name == "none" else name
        lines.append(f'<rect x="{x}" y="{floor + 50}" width="12" height="12" fill="{_COLOURS.get(name, _GREY)}"/>')
        lines.append(f'<text x="{x + 18}" y="{floor + 60}">{words}</text>')
    return "\n".join([*lines, "</svg>", ""])
