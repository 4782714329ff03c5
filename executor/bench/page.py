"""The report of a benchmark: one HTML file that needs no network, in the same style as the report of a run."""

from __future__ import annotations

import shlex
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from executor.bench.summary import Cell
from executor.bench.table import DASH, FOOTNOTE, detail_rows, main_rows, number
from executor.bench.units import FAMILIES
from executor.records.captions import action_text, readable
from executor.results.report.html import STYLE, badge, facts, measurements, text
from executor.results.report.page import versions

_BENCH_STYLE = """
tr.ours td{font-weight:600}
td.n,th.n{text-align:right;font-variant-numeric:tabular-nums}
.bar{position:relative;height:22px;border-radius:6px;background:var(--quiet-bg);overflow:hidden;margin:4px 0}
.bar i{position:absolute;inset:0 auto 0 0;background:var(--good);opacity:.75}
.bar u{position:absolute;top:9px;height:4px;background:var(--ink);opacity:.55}
.bars{display:grid;grid-template-columns:minmax(150px,max-content) 1fr minmax(90px,max-content);gap:2px 14px;
align-items:center}
"""


def bench_page(cells: Sequence[Cell], folder: Path) -> str:
    """Returns the whole page as text.

    Args:
        cells: What was measured.
        folder: Where it lies, for the commands that replay units.
    """
    listed = ", ".join(f"{name} {version}" for name, version in versions().items())
    body = [
        "<header><h1>Benchmark</h1><p class='lead'>Success rates, with everything that failed.</p></header>",
        f"<h2>Main table</h2><div class='card scroll'>{_table(cells)}<p class='soft'>{text(FOOTNOTE)}</p></div>",
        f"<h2>Success by family</h2><div class='card'>{_bars(cells)}</div>",
        "<h2>What stands behind each number</h2>",
        *(_details(cell) for cell in cells),
        "<h2>What failed</h2>",
        _failures(cells, folder),
        f"<p class='soft'>{text(listed)}</p>",
    ]
    return (
        "<!doctype html>\n<html lang='en'><head><meta charset='utf-8'>"
        "<meta name='viewport' content='width=device-width, initial-scale=1'>"
        f"<title>Benchmark</title><style>{STYLE}{_BENCH_STYLE}</style></head>"
        f"<body><main>{''.join(body)}<footer>Written by scene2demo.</footer></main></body></html>\n"
    )


def replay_command(folder: Path, result: Mapping[str, Any]) -> str:
    """Returns the command line that shows a unit as a video."""
    name = result["name"]
    return shlex.join(["scene2demo", "bench", "replay", str(folder), name, "--out", f"replay-{name}"])


def _table(cells: Sequence[Cell]) -> str:
    head = "".join(f"<th class='n'>{family}</th>" for family in FAMILIES)
    rows = "".join(
        f"<tr{' class=ours' if row[0].startswith('here') else ''}><td>{text(row[0])}</td>"
        + "".join(f"<td class='n'>{text(cell)}</td>" for cell in row[1:])
        + "</tr>"
        for row in main_rows(cells)
    )
    return f"<table><thead><tr><th>Method</th>{head}</tr></thead><tbody>{rows}</tbody></table>"


def _bars(cells: Sequence[Cell]) -> str:
    """One bar a cell: its length is the success rate, the thin line in it the 95 % interval."""
    rows = []
    for cell in cells:
        rate, interval = cell.all.percent, cell.all.interval_percent
        name = f"{cell.series.family}, {cell.series.setting.label.removeprefix('here: ')}"
        if rate is None or interval is None:
            rows.append(f"<span>{text(name)}</span><span class='soft'>nothing run yet</span><span>{DASH}</span>")
            continue
        low, high = interval
        rows.append(
            f"<span>{text(name)}</span><div class='bar' title='95 % interval {low:.1f} to {high:.1f} %'>"
            f"<i style='width:{rate:.2f}%'></i><u style='left:{low:.2f}%;width:{high - low:.2f}%'></u></div>"
            f"<span>{number(rate)} % of {cell.all.trials}</span>"
        )
    return f"<div class='bars'>{''.join(rows)}</div>" if rows else "<p>Nothing was asked for.</p>"


def _details(cell: Cell) -> str:
    rows = ((name, text(value)) for name, value in detail_rows(cell))
    return (
        f"<div class='card'><h3>{cell.series.family}, {text(cell.series.setting.label.removeprefix('here: '))}</h3>"
        f"{facts(rows)}</div>"
    )


def _failures(cells: Sequence[Cell], folder: Path) -> str:
    failed = [_failure(result, folder) for cell in cells for result in cell.failed]
    return f"<div class='card'>{''.join(failed)}</div>" if failed else "<div class='card'><p>Nothing failed.</p></div>"


def _failure(result: Mapping[str, Any], folder: Path) -> str:
    failure = result.get("failure") or {}
    where = ""
    if failure.get("primitive") is not None:
        step = action_text(failure["primitive"], failure["action"])
        where = (
            f"<p>Subtask {failure['subtask'] + 1}, {text(readable(failure['subtask_name']))}, step "
            f"{failure['step'] + 1}: <span class='name'>{text(step)}</span> at {failure['time_s']:.1f} s</p>"
        )
    trace = "".join(f"{line}\n" for line in result.get("traceback", ()))
    command = replay_command(folder, result)
    return (
        f"<details class='step'><summary><span class='name'>{text(result['name'])}</span>"
        f"{badge(str(failure.get('kind', result['ended'])), 'bad')}"
        f"<span>{text(failure.get('message', ''))}</span></summary>"
        f"<p class='soft'>{text(result.get('query', ''))}</p>{where}"
        f"{measurements(failure.get('measurements', {}))}"
        f"{f'<pre>{text(trace)}</pre>' if trace else ''}<pre>{text(command)}</pre></details>"
    )
