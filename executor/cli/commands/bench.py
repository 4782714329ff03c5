"""`scene2demo bench`: success rates over many episodes, resumable, beside the paper's main table; `bench replay`: one
unit again, as a video and a report.

`bench` exits with 0 when every requested unit is done and at least one succeeded, 1 when none did, 130 after Ctrl-C.
Failures are what a benchmark measures. `replay` exits with 0 when the states were the same as when it was measured,
whether it succeeded or not; 1 when they were not.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

from rich.box import SIMPLE_HEAD
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

from bddl.terminal import pluralize
from executor.bench.folder import BenchFolder
from executor.bench.tables import FOOTNOTE, Cell, bench_json, detail_rows, main_rows, write_results
from executor.bench.units import BenchSetting, Series, Unit
from executor.bench.work import replay
from executor.campaign.engine import Campaign, Shard, claimed, pending
from executor.campaign.versions import outcome_version
from executor.cli.command_options import BenchOptions, BenchReplayOptions
from executor.cli.errors import DONE, FAILED, INTERRUPTED, BadOption
from executor.cli.execution import check_seed, check_unit_limit, check_workers, command_line, read_shard, results_writer
from executor.cli.output import ERR, OUT, print_json, say, tell
from executor.cli.rollout_display import print_summary, summary_json
from executor.reports.run_folder import RunFolder
from executor.rollouts.run_record import RunRecord, evolution_json
from executor.scenes.generators.families import FAMILIES, LONG_HORIZON
from executor.sim.render.frames import check_size
from executor.system.files import write_json

WORKER = "executor.bench.worker"


def execute(options: BenchOptions | BenchReplayOptions) -> int:
    """Measure, or run one unit again; return the exit code."""
    return _replay(options) if isinstance(options, BenchReplayOptions) else _measure(options)


def _measure(options: BenchOptions) -> int:
    """Run what is not done yet, print the table, and write summary and report."""
    shard = _checked(options)
    folder = BenchFolder(options.out)
    version = outcome_version()
    setting = BenchSetting(options.flows, options.evolve, options.views, options.keep_sizes, options.full_size)
    asked = [
        Series(family, options.seed, options.episodes, setting, version)
        for family in FAMILIES
        if family in options.families
    ]
    folder.add_series(asked)
    jobs = list(pending(folder, [(unit, version) for one in asked for unit in one.units()], shard, again=options.again))
    interrupted = False
    with claimed(folder, jobs):
        try:
            with _progress(folder, asked, len(jobs), quiet=options.json) as on_progress:
                Campaign(folder, WORKER, options.workers, options.limit_s).run(jobs, on_progress)
        except KeyboardInterrupt:
            interrupted = True
        finally:
            cells = write_results(folder)
    endings = Counter(result["ended"] for one in asked for result in folder.results(one))
    hopeless = endings.total() > 0 and not endings["succeeded"]
    code = INTERRUPTED if interrupted else FAILED if hopeless else DONE
    if options.json:
        print_json({"ok": code == DONE, "interrupted": interrupted, **bench_json(cells)})
    else:
        print_cells(cells, {series.family for series in asked}, setting)
        say(f"results in {folder.path}: summary.json, report.html, units/")
        if interrupted:
            tell("scene2demo: interrupted; finished units are kept, the same command goes on", style="yellow")
    return code


def print_cells(cells: Sequence[Cell], families: set[str], setting: BenchSetting) -> None:
    """Print the main table, and the details of the requested cells."""
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
            say(f"  to see one: {command_line('bench replay', 'DIR', cell.failed[0]['name'], out='FOLDER')}")


def _checked(options: BenchOptions) -> Shard:
    """Return the shard, after refusing options that make no sense.

    Raises:
        BadOption: One does not.
    """
    if not options.families:
        raise BadOption("T1..T6", "is missing", f"at least one of {', '.join(FAMILIES)}")
    check_seed(options.seed, options.episodes)
    check_workers(options.workers)
    check_unit_limit(options.limit_s)
    shard = read_shard(options.shard)
    if options.flows == "paper" and (without := [f for f in options.families if f not in LONG_HORIZON]):
        raise BadOption("--flows", "paper", f"planned for {', '.join(without)}: the paper prints no flows for them")
    return shard


@contextmanager
def _progress(
    folder: BenchFolder, asked: Sequence[Series], remaining: int, *, quiet: bool
) -> Iterator[Callable[[Unit, Mapping[str, Any]], None]]:
    """Provide a callback for every unit's ending that shows it: on a terminal a bar with the success count, else lines.

    Args:
        folder: Where results are kept; what is done already counts.
        asked: The series that are run.
        remaining: How many units are still to be run here.
        quiet: Shows nothing.
    """
    if quiet:
        yield lambda unit, result: None
        return
    endings = Counter(result["ended"] for series in asked for result in folder.results(series))
    total, before = sum(series.episodes for series in asked), endings.total()
    if before:
        tell(f"  {before} of {pluralize(total, 'unit')} done already, {remaining} to run now")
    shows_bar = ERR.is_terminal and remaining > 0
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=ERR, disable=not shows_bar) as bar:
        task = bar.add_task(f"{endings['succeeded']} of {before} succeeded", total=total, completed=before)

        def show_unit(unit: Unit, result: Mapping[str, Any]) -> None:
            endings[result["ended"]] += 1
            good, failure = result["ended"] == "succeeded", result.get("failure") or {}
            words = "succeeded" if good else f"{failure.get('kind')}: {failure.get('message')}"
            if not (shows_bar and good):
                tell(f"  {unit.name:28} {result['elapsed_s']:6.1f} s  {words}", style="red" if shows_bar else None)
            bar.update(task, advance=1, description=f"{endings['succeeded']} of {endings.total()} succeeded")

        yield show_unit


def _replay(options: BenchReplayOptions) -> int:
    """Run the unit again, write what `run` writes, and print whether the states were the same."""
    check_size(options.size)
    recorded = BenchFolder(options.folder).find(options.unit)
    if recorded["setting"].get("baseline") is not None:
        raise BadOption("UNIT", recorded["name"], "a unit of the executor itself: baselines are not shown again")
    folder = RunFolder.prepare(options.out, force=options.force)
    if not options.json:
        tell(f"  {recorded['name']}: {recorded.get('query', '')}")
    with folder.filling(), results_writer(options) as studio:
        began = time.perf_counter()
        again = replay(recorded)
        wall = {"planning and physics": time.perf_counter() - began}
        record = RunRecord(
            graph=again.graph,
            report=again.graph.verify(),
            query=again.pair.query,
            notes=(f"unit {recorded['name']}: {again.verdict}",),
            rollout=again.rollout,
            wall_s=wall,
            command=command_line(
                "bench replay",
                options.folder,
                options.unit,
                out=options.out,
                no_video=not options.video,
                size=None if options.size == BenchReplayOptions.size else options.size,
            ),
        )
        record = folder.write_rollout(record)
        if again.story is not None:
            write_json(folder.path / "evolution.json", evolution_json(again.story))
        record = studio.finish(record, folder)
    code = FAILED if again.same is False else DONE
    if options.json:
        found = {"unit": recorded["name"], "same_states": again.same, "comparison": again.verdict}
        print_json({**summary_json(record, folder), **found, "ok": code == DONE, "exit_code": code})
    else:
        print_summary(record, folder)
        say(f"{'compared':11} {again.verdict}", style="red" if again.same is False else "green")
    return code
