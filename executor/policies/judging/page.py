"""An evaluation as one HTML page that needs no network: tables, success by what varied, curves of loss and success."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from executor.bench.summary import Rate
from executor.policies.judging.axes import AxisScore
from executor.policies.judging.comparison import PairedTest, PolicyScore, TrainingScore
from executor.results.report.html import badge, card, document, soft, style, table, text

_WIDTH, _HEIGHT, _LEFT, _BOTTOM = 640, 220, 52, 26
_COLOURS = ("var(--accent)", "var(--good)", "var(--bad)", "var(--warn)", "var(--soft)")


@dataclass(frozen=True, slots=True)
class Curve:
    """A line of a diagram.

    Attributes:
        name: What it is of.
        points: Step of training and value, by rising steps.
        bands: Least and largest value that an interval allows, at each of the steps; empty for none.
    """

    name: str
    points: tuple[tuple[float, float], ...]
    bands: tuple[tuple[float, float], ...] = ()


@dataclass(frozen=True, slots=True)
class Judged:
    """What a page tells of.

    Attributes:
        what: What the episodes are of.
        scores: Policy -> its score.
        trainings: Policies that differ in their seed only, as rows.
        tests: Each two compared.
        axes: Policy -> success by what varied.
        losses, successes: Curves over the steps of training.
        failed: Policy, seed and what went wrong of each failure.
    """

    what: str
    scores: Mapping[str, PolicyScore]
    trainings: Sequence[TrainingScore]
    tests: Sequence[PairedTest]
    axes: Mapping[str, Sequence[AxisScore]]
    losses: Sequence[Curve]
    successes: Sequence[Curve]
    failed: Sequence[tuple[str, int, str]]


def evaluation_page(judged: Judged) -> str:
    """Returns the whole page as text."""
    body = [
        f"<header><h1>Policies</h1><p class='lead'>{text(judged.what)}</p></header>",
        f"<h2>Success</h2>{card(_scores(judged.scores), soft('Intervals are exact, 95 %.'), kind='scroll')}",
        f"<h2>By training</h2>{card(_trainings(judged.trainings), kind='scroll')}",
    ]
    if judged.tests:
        body.append(f"<h2>In pairs</h2>{card(_pairs(judged.tests), kind='scroll')}")
    if judged.losses:
        body.append(f"<h2>Loss by step of training</h2>{card(diagram(judged.losses))}")
    if judged.successes:
        body.append(f"<h2>Success by step of training</h2>{card(diagram(judged.successes, top=1.0))}")
    for name, scores in judged.axes.items():
        body.append(f"<h2>By what varied: {text(name)}</h2>{card(_axes(scores), kind='scroll')}")
    rows = [(text(name), text(seed), badge(kind, "bad")) for name, seed, kind in judged.failed]
    failures = table(rows, ("policy", "seed", "failure")) if rows else "<p>Nothing failed.</p>"
    body.append(f"<h2>What failed</h2>{card(failures, kind='scroll')}")
    return document("Policies", body, style("page", "bench"))


def diagram(curves: Sequence[Curve], top: float | None = None) -> str:
    """Returns curves over the steps of training as a drawing in HTML.

    Args:
        curves: The lines; at least one has a point.
        top: The value at the upper edge; by default the largest of all.
    """
    steps = [step for curve in curves for step, _ in curve.points]
    values = [value for curve in curves for _, value in curve.points]
    last, most = max(steps, default=1.0) or 1.0, top or max(values, default=1.0) or 1.0

    def at(step: float, value: float) -> str:
        x = _LEFT + step / last * (_WIDTH - _LEFT - 8)
        return f"{x:.1f},{8 + (1.0 - min(value / most, 1.0)) * (_HEIGHT - _BOTTOM - 8):.1f}"

    drawn, names = [], []
    for curve, colour in zip(curves, _COLOURS * len(curves), strict=False):
        if curve.bands:
            there = [at(step, high) for (step, _), (_, high) in zip(curve.points, curve.bands, strict=True)]
            back = [at(step, low) for (step, _), (low, _) in zip(curve.points, curve.bands, strict=True)]
            drawn.append(f"<polygon points='{' '.join(there + back[::-1])}' style='fill:{colour};opacity:.15'/>")
        line = " ".join(at(step, value) for step, value in curve.points)
        drawn.append(f"<polyline points='{line}' style='fill:none;stroke:{colour};stroke-width:1.6'/>")
        drawn += [_dot(at(*point), colour) for point in curve.points] if len(curve.points) < 40 else []
        names.append(f"<span style='color:{colour}'>{text(curve.name)}</span>")
    marks = "".join(
        f"<text x='{_LEFT - 6}' y='{12 + (1.0 - share) * (_HEIGHT - _BOTTOM - 8):.0f}' text-anchor='end'>"
        f"{share * most:.3g}</text>"
        for share in (0.0, 0.5, 1.0)
    )
    marks += f"<text x='{_WIDTH - 8}' y='{_HEIGHT - 6}' text-anchor='end'>{last:.0f} steps</text>"
    size = f"viewBox='0 0 {_WIDTH} {_HEIGHT}' style='width:100%;font-size:11px;fill:var(--soft)'"
    return f"<svg role='img' {size}>{''.join(drawn)}{marks}</svg><p class='row'>{' '.join(names)}</p>"


def loss_curve(name: str, lines: Iterable[str]) -> Curve | None:
    """Returns the curve that a training's log draws; None where it has no numbers.

    Args:
        name: The policy's.
        lines: Of `training.jsonl`.
    """
    points = []
    for line in lines:
        try:
            told: Any = json.loads(line)
            points.append((float(told["step"]), float(told["loss"])))
        except (ValueError, KeyError, TypeError, RecursionError):
            continue
    return Curve(name, tuple(sorted(points))) if points else None


def success_curve(name: str, scores: Mapping[int, Rate]) -> Curve:
    """Returns the curve of success over the steps of training.

    Args:
        name: The policy's.
        scores: Step -> success at some time.
    """
    steps = sorted(scores)
    bands = tuple(scores[step].interval_percent or (0.0, 100.0) for step in steps)
    points = tuple((float(step), scores[step].successes / max(scores[step].trials, 1)) for step in steps)
    return Curve(name, points, tuple((low / 100.0, high / 100.0) for low, high in bands))


def rate_words(rate: Rate) -> str:
    """Returns a rate with its interval in words."""
    low, high = rate.interval_percent or (0.0, 100.0)
    return f"{rate.successes} of {rate.trials} ({low:.1f} to {high:.1f} %)"


def _dot(place: str, colour: str) -> str:
    x, y = place.split(",")
    return f"<circle cx='{x}' cy='{y}' r='2.5' style='fill:{colour}'/>"


def _scores(scores: Mapping[str, PolicyScore]) -> str:
    head = ("policy", "once", "at the end", "with help", "failures", "seen by monitors in failures")
    rows = [
        (
            text(name),
            text(rate_words(score.once)),
            text(rate_words(score.at_end)),
            text(rate_words(score.with_help)) if score.with_help is not None else "",
            text(_counts(score.failures)),
            text(_counts(score.monitors)),
        )
        for name, score in scores.items()
    ]
    return table(rows, head)


def _counts(counts: Mapping[str, int]) -> str:
    return ", ".join(f"{count} {kind}" for kind, count in counts.items())


def _trainings(rows: Sequence[TrainingScore]) -> str:
    head = ("policies", "seeds", "each", "all together", "spread between seeds")
    cells = [
        (
            text(", ".join(row.names)),
            text(", ".join(map(str, row.seeds))),
            text(", ".join(f"{100 * share:.0f} %" for share in row.shares)),
            text(rate_words(row.once)),
            "" if row.spread is None else text(f"{100 * row.spread:.1f} %"),
        )
        for row in rows
    ]
    return table(cells, head)


def _pairs(tests: Sequence[PairedTest]) -> str:
    cells = [
        (text(one.first), text(one.second), text(one.only_first), text(one.only_second), text(f"{one.p:.3g}"))
        for one in tests
    ]
    return table(cells, ("first", "second", "only the first did", "only the second did", "p (McNemar, exact)"))


def _axes(scores: Sequence[AxisScore]) -> str:
    cells = [
        (
            text(score.axis),
            *(text(f"{low:.3g} to {high:.3g}: {rate_words(rate)}") for low, high, rate in score.parts),
            *[""] * (3 - len(score.parts)),
            "" if score.p is None else text(f"{score.p:.3g}"),
        )
        for score in scores
    ]
    return table(cells, ("axis", "low", "middle", "high", "p (ranks)"))
