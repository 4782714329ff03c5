"""`scene2demo bench`: success rates over many episodes, resumable, beside the paper's main table.

Returns 0 when every unit that was asked for is done (whatever came of it), 130 after Ctrl-C. Failures are what a
benchmark measures; they are no failure of the benchmark.
"""

from __future__ import annotations

import shlex
from collections.abc import Sequence

from rich.box import SIMPLE_HEAD
from rich.table import Table

from executor.bench.page import bench_page
from executor.bench.presence import at_work
from executor.bench.run import WORKER, Shard, pending, run_units
from executor.bench.store import BenchFolder
from executor.bench.summary import Cell
from executor.bench.table import FOOTNOTE, detail_rows, main_rows
from executor.bench.units import FAMILIES, LONG_HORIZON, BenchSetting, Series, outcome_version
from executor.cli.options.bad_option import BadOption
from executor.cli.options.inputs import check_seed
from executor.cli.options.running import Bench
from executor.cli.terminal.bench_progress import BenchProgress
from executor.cli.terminal.errors import DONE, INTERRUPTED
from executor.cli.terminal.output import OUT, print_json, say, tell
from executor.machine.files import write_json, write_text

SUMMARY_SCHEMA = "scene2demo-bench-summary/1"
LONGEST_LIMIT_S = 604_800.0
"""A week; clocks of threads do not take any number."""


def execute(options: Bench) -> int:
    """Runs what is not done yet, prints the table, writes summary and report, and returns the exit code."""
    shard = _checked(options)
    folder = BenchFolder(options.out)
    version = outcome_version()
    setting = BenchSetting(options.flows, options.evolve, options.views)
    asked = [Series(family, options.seed, options.episodes, setting, version) for family in _families(options)]
    folder.add_series(asked)
    units = list(pending(folder, asked, shard, again=options.again))
    interrupted = False
    with at_work(folder.path, [unit.id(version) for unit, version in units]):
        try:
            with BenchProgress(folder, asked, len(units), quiet=options.json) as progress:
                run_units(
                    folder,
                    units,
                    options.workers,
                    progress.told,
                    rule=options.rule,
                    limit_s=options.limit_s,
                    worker=WORKER,
                )
        except KeyboardInterrupt:
            interrupted = True
        finally:
            cells = write_results(folder)
    if options.json:
        print_json({"ok": not interrupted, "interrupted": interrupted, **summary_json(cells)})
    else:
        print_cells(cells, {series.family for series in asked}, setting)
        say(f"results in {folder.path}: summary.json, report.html, units/")
        if interrupted:
            tell("scene2demo: interrupted; finished units are kept, the same command goes on", style="yellow")
    return INTERRUPTED if interrupted else DONE


def write_results(folder: BenchFolder) -> list[Cell]:
    """Writes summary and report of everything in a folder, and returns its cells."""
    cells = [Cell(series, folder.results(series)) for series in folder.series()]
    write_json(folder.path / "summary.json", summary_json(cells))
    write_text(folder.path / "report.html", bench_page(cells, folder.path))
    return cells


def summary_json(cells: Sequence[Cell]) -> dict[str, object]:
    """Returns the summary as plain data: the table, every cell, and one line a unit."""
    return {
        "schema": SUMMARY_SCHEMA,
        "table": [dict(zip(("method", *FAMILIES), row, strict=True)) for row in main_rows(cells)],
        "cells": [cell.to_json() for cell in cells],
        "failed": [
            {"unit": result["name"], "ended": result["ended"], "failure": result.get("failure")}
            for cell in cells
            for result in cell.failed
        ],
    }


def print_cells(cells: Sequence[Cell], families: set[str], setting: BenchSetting) -> None:
    """Prints the main table, and the details of the cells that were asked for."""
    table = Table(box=SIMPLE_HEAD, padding=(0, 1, 0, 0), pad_edge=False)
    table.add_column("SR / score [%]")
    for family in FAMILIES:
        table.add_column(family, justify="right", no_wrap=True)
    for method, *numbers in main_rows(cells):
        tight = (text.replace(" / ", "/") for text in numbers)
        table.add_row(method, *tight, style="bold" if method.startswith("here") else None)
    OUT.print(table)
    say(FOOTNOTE)
    say("")
    for cell in cells:
        if cell.series.family not in families or cell.series.setting != setting:
            continue
        say(f"{cell.series.family}, {setting.label.removeprefix('here: ')}", style="bold")
        for name, value in detail_rows(cell):
            say(f"  {name:31} {value}")
        for result in cell.failed[:5]:
            message = (result.get("failure") or {}).get("message", "")
            say(f"  failed: {result['name']}  {message}", style="red")
        if len(cell.failed) > 5:
            say(f"  and {len(cell.failed) - 5} more, in report.html")
        if cell.failed:
            words = ["scene2demo", "bench", "replay", "DIR", cell.failed[0]["name"], "--out", "FOLDER"]
            say(f"  to see one: {shlex.join(words)}")


def _checked(options: Bench) -> Shard:
    """Returns the shard, after refusing options that make no sense.

    Raises:
        BadOption: One does not.
    """
    if not options.families:
        raise BadOption("T1..T6", "is missing", f"at least one of {', '.join(FAMILIES)}")
    check_seed(options.seed, options.episodes)
    if options.workers < 1:
        raise BadOption("--workers", options.workers, "at least 1")
    if not 0.0 < options.limit_s <= LONGEST_LIMIT_S:
        raise BadOption("--limit-s", options.limit_s, f"a number of seconds above 0, at most {LONGEST_LIMIT_S:.0f}")
    number, slash, of = options.shard.partition("/")
    if not (slash and number.isdecimal() and of.isdecimal() and 1 <= int(number) <= int(of)):
        raise BadOption("--shard", options.shard, "a part of a whole, such as 1/4 to 4/4")
    if options.flows == "paper" and (without := [f for f in options.families if f not in LONG_HORIZON]):
        raise BadOption("--flows", "paper", f"planned for {', '.join(without)}: the paper prints no flows for them")
    return Shard(int(number), int(of))


def _families(options: Bench) -> tuple[str, ...]:
    return tuple(family for family in FAMILIES if family in options.families)
