"""The report of a benchmark: one HTML file that needs no network, in the same style as the report of a run."""

from __future__ import annotations

import shlex
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from executor.bench.summary import Cell
from executor.bench.table import DASH, FOOTNOTE, detail_rows, main_rows, number
from executor.bench.units import FAMILIES
from executor.records.captions import action_text, readable
from executor.results.report.html import badge, card, document, facts, fold, measurements, soft, style, text
from executor.results.report.page import versions


def bench_page(cells: Sequence[Cell], folder: Path) -> str:
    """Returns the whole page as text.

    Args:
        cells: What was measured.
        folder: Where it lies, for the commands that replay units.
    """
    failed = [_failure(result, folder) for cell in cells for result in cell.failed]
    body = [
        "<header><h1>Benchmark</h1><p class='lead'>Success rates, with everything that failed.</p></header>",
        f"<h2>Main table</h2>{card(_table(cells), soft(text(FOOTNOTE)), kind='scroll')}",
        f"<h2>Success by family</h2>{card('<div class=bars>', *_bars(cells), '</div>')}",
        "<h2>What stands behind each number</h2>",
        *(
            card(f"<h3>{_name(cell)}</h3>", facts((name, text(value)) for name, value in detail_rows(cell)))
            for cell in cells
        ),
        f"<h2>What failed</h2>{card(*(failed or ['<p>Nothing failed.</p>']))}",
        soft(text(versions())),
    ]
    return document("Benchmark", body, style("page", "bench"))


def _name(cell: Cell) -> str:
    return f"{cell.series.family}, {text(cell.series.setting.label.removeprefix('here: '))}"


def _table(cells: Sequence[Cell]) -> str:
    head = "".join(f"<th class='n'>{family}</th>" for family in FAMILIES)
    rows = "".join(
        f"<tr{' class=ours' if row[0].startswith('here') else ''}><td>{text(row[0])}</td>"
        + "".join(f"<td class='n'>{text(cell)}</td>" for cell in row[1:])
        + "</tr>"
        for row in main_rows(cells)
    )
    return f"<table><thead><tr><th>Method</th>{head}</tr></thead><tbody>{rows}</tbody></table>"


def _bars(cells: Sequence[Cell]) -> Iterator[str]:
    """Yields one bar a cell: its length is the success rate, the thin line in it the 95 % interval."""
    for cell in cells:
        rate, interval = cell.all.percent, cell.all.interval_percent
        if rate is None or interval is None:
            yield f"<span>{_name(cell)}</span><span class='soft'>nothing run yet</span><span>{DASH}</span>"
            continue
        low, high = interval
        yield (
            f"<span>{_name(cell)}</span><div class='bar' title='95 % interval {low:.1f} to {high:.1f} %'>"
            f"<i style='width:{rate:.2f}%'></i><u style='left:{low:.2f}%;width:{high - low:.2f}%'></u></div>"
            f"<span>{number(rate)} % of {cell.all.trials}</span>"
        )


def _failure(result: Mapping[str, Any], folder: Path) -> str:
    failure = result.get("failure") or {}
    where = ""
    if failure.get("primitive") is not None:
        step = action_text(failure["primitive"], failure["action"])
        where = (
            f"<p>Subtask {failure['subtask'] + 1}, {text(readable(failure['subtask_name']))}, step "
            f"{failure['step'] + 1}: <span class='name'>{text(step)}</span> at {failure['time_s']:.1f} s</p>"
        )
    name, trace = result["name"], "".join(f"{line}\n" for line in result.get("traceback", ()))
    command = shlex.join(["scene2demo", "bench", "replay", str(folder), name, "--out", f"replay-{name}"])
    return fold(
        f"<span class='name'>{text(name)}</span>{badge(str(failure.get('kind', result['ended'])), 'bad')}"
        f"<span>{text(failure.get('message', ''))}</span>",
        soft(text(result.get("query", ""))),
        where,
        measurements(failure.get("measurements", {})),
        f"<pre>{text(trace)}</pre>" if trace else "",
        f"<pre>{text(command)}</pre>",
        kind="step",
    )
