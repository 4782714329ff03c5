"""`scene2demo bench`: success rates over many episodes, resumable, with the paper's main table.

Exit code 0 when every requested unit is done and at least one succeeded, 1 when none did, 130 after Ctrl-C.
Failures are what a benchmark measures. A part (`--shard`) ends with 1 only when none of its units came to an end.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import islice
from typing import TYPE_CHECKING, Annotated, Any, Literal

import tyro

from bddl.terminal import pluralize
from executor.cli.engines import EngineOptions
from executor.cli.errors import DONE, FAILED, INTERRUPTED, BadOption, check
from executor.cli.options import (
    BenchFamily,
    CampaignModelOptions,
    Flag,
    FullSize,
    KeepSizes,
    Maybe,
    ResultsFolder,
    RobotName,
)
from executor.cli.output import ERR, OUT, Pace, bar, first_line, print_json, say, tell

if TYPE_CHECKING:
    from executor.bench.folder import BenchFolder
    from executor.bench.tables import Cell
    from executor.bench.units import BenchSetting, Series, Unit
    from executor.campaign.engine import Shard


@dataclass(frozen=True)
class Options(EngineOptions):
    """Measure success rates over many episodes, and print them with the paper's main table.

    Goes on where an earlier run with the same folder ended. `scene2demo bench replay FOLDER UNIT` shows one
    unit as a video.
    """

    families: tyro.conf.Positional[
        Annotated[tuple[BenchFamily, ...], tyro.conf.arg(metavar="T1..T7", help_behavior_hint="(required)")]
    ]
    """What to measure: T1 to T4 are the long-horizon tasks, T5 opening and closing, T6 picking up, T7
    any wishes in any homes, impossible ones among them, by a robot of full size."""
    out: ResultsFolder
    episodes: int = 20
    """How many units of each family, with --until the most; those of T5 and T6 go through one set of pairs after the
    other."""
    until: Maybe[float] = None
    """Width in percentage points of the 95 % interval of a family's success rate at which no further unit of it is
    begun, such as 14; from the tenth unit on."""
    seed: int = 0
    """Seed of the first episode, or of the first set of pairs; the following ones count up."""
    workers: int = 2
    """How many processes, on each machine; one that crashes costs its unit only."""
    flows: Literal["planned", "paper"] = "planned"
    """The offline planner's flows, whose numbers geometry fills in, or the paper's initial flows, numbers verbatim."""
    evolve: Flag = False
    """Revise the flows that fail."""
    keep_sizes: KeepSizes = False
    full_size: FullSize = False
    robot: RobotName = None
    shard: str = "1/1"
    """Which part of the units to run, such as 3/8; all parts may share a folder."""
    again: Flag = False
    """Run units once more whose process crashed, hung, or met a mistake of the program."""
    limit_s: float = 900.0
    """Wall time that a unit may take before its process is ended."""
    asked: CampaignModelOptions = field(default_factory=CampaignModelOptions)


WORKER = "executor.bench.worker"


def execute(options: Options) -> int:
    """Run what is not done yet, print the table, and write summary and report."""
    from executor.bench.folder import BenchFolder
    from executor.bench.tables import bench_json, write_results
    from executor.bench.units import BenchSetting, Series
    from executor.campaign.engine import Campaign, claimed, is_done, pending
    from executor.campaign.planning_model import ModelWatch, used_in, was_made, why_stopped
    from executor.campaign.versions import outcome_version
    from executor.cli.engines import claim_wait_s, engine_of, typed_words, write_array
    from executor.cli.planning import budget_of, planned_by_model
    from executor.scenes.generators.families import FAMILIES

    shard = _checked(options)
    folder = BenchFolder(options.out)
    version = outcome_version()
    setting = BenchSetting(
        options.flows,
        options.evolve,
        options.keep_sizes,
        options.full_size,
        robot=options.robot or "",
        model=planned_by_model(options.asked, options.workers, options.out),
    )
    asked = [
        Series(family, options.seed, options.episodes, setting, version)
        for family in (*FAMILIES, "T7")
        if family in options.families
    ]
    folder.add_series(asked)
    units = [(unit, version) for one in asked for unit in one.units()]
    if options.slurm is not None:
        count = sum(1 for _ in pending(folder, units, again=options.again))
        return write_array(options, typed_words("bench", options, "families"), count, folder.path, options.workers)
    engine, interrupted = engine_of(options, outcome_version, renders=False), False
    with claimed(folder, units, shard, claim_wait_s(), again=options.again) as jobs:
        watch = ModelWatch()
        left, narrow = {unit.id(version) for unit, _ in jobs}, _Narrow(folder, asked, options.until)
        try:
            with _progress(folder, asked, left, quiet=options.json) as on_progress:

                def note(unit: Unit, result: Mapping[str, Any]) -> None:
                    if not watch.note((result.get("failure") or {}).get("kind")):
                        return
                    if was_made(result):
                        narrow.note(unit, result)
                    on_progress(unit, result)

                campaign = Campaign(
                    folder,
                    WORKER,
                    options.workers,
                    options.limit_s,
                    more=partial(budget_of, options.asked),
                    engine=engine,
                )
                campaign.run(jobs, note, wanted=lambda unit: not watch.why and narrow.wants(unit))
        except KeyboardInterrupt:
            interrupted = True
        finally:
            cells = write_results(folder)
    endings = Counter(result["ended"] for one in asked for result in folder.results(one))
    from executor.cli.execution import command_line

    hopeless = (endings.total() > 0 or watch.failed > 0 or bool(watch.why)) and not endings["succeeded"]
    if shard.of > 1:
        hopeless = not is_done(folder, units, shard)
    code = INTERRUPTED if interrupted else FAILED if hopeless else DONE
    more: dict[str, object] = {}
    if setting.model is not None:
        more = {"usage": used_in(folder.path, setting.model).record(), "stopped_by": watch.why}
    if options.json:
        print_json({"ok": code == DONE, "interrupted": interrupted, **more, **bench_json(cells)})
    else:
        print_cells(cells, {series.family for series in asked}, setting, folder)
        say(f"results in {folder.path}: report.html, summary.json, units/")
        if setting.model is not None:
            say(f"models of the folder, all runs together: {used_in(folder.path, setting.model).summary()}")
        if watch.why:
            tell(f"scene2demo: {why_stopped(watch.why, 'units')}", style="yellow")
        if interrupted:
            tell("scene2demo: interrupted; finished units are kept, the same command goes on", style="yellow")
        else:
            say(f"next: {command_line('view', folder.path)}")
    return code


LEAST_UNITS = 10  # Before that an interval may be narrow by luck.


class _Narrow:
    """Families whose success rate is known well enough.

    Args:
        folder: Where results are kept; what is done already counts.
        asked: The series.
        until: Width of the interval [percentage points]; None where all units are wanted.
    """

    def __init__(self, folder: BenchFolder, asked: Sequence[Series], until: float | None) -> None:
        from executor.bench.tables import Cell

        self._until = until
        counted = asked if until is not None else ()
        self._cells = {series.family: Cell(series, folder.results(series)) for series in counted}

    def note(self, unit: Unit, result: Mapping[str, Any]) -> None:
        """Count a unit."""
        if self._until is not None:
            cell = self._cells[unit.family]
            others = (other for other in cell.results if other["id"] != result["id"])  # `--again` repeats units.
            self._cells[unit.family] = replace(cell, results=(*others, result))

    def wants(self, unit: Unit) -> bool:
        """Decide whether a unit is still to be run."""
        if self._until is None:
            return True
        cell = self._cells[unit.family]
        interval = cell.all.interval_percent
        return interval is None or len(cell.results) < LEAST_UNITS or interval[1] - interval[0] > self._until


def print_cells(cells: Sequence[Cell], families: set[str], setting: BenchSetting, folder: BenchFolder) -> None:
    """Print the main table, and the details of the requested cells of a folder."""
    from executor.bench.tables import detail_rows
    from executor.scenes.generators.families import FAMILIES

    if families & set(FAMILIES):
        _print_main_table(cells)
    for cell in cells:
        if cell.series.family not in families or cell.series.setting != setting:
            continue
        say(f"{cell.series.family}, {setting.label.removeprefix('here: ')}", style="bold")
        for name, value in detail_rows(cell):
            say(f"  {name:35} {value}" if cell.series.family == "T7" else f"  {name:31} {value}")
        for result in cell.failed[:5]:
            message = first_line((result.get("failure") or {}).get("message", ""))
            say(f"  failed: {result['name']}  {message}", style="red")
        if len(cell.failed) > 5:
            say(f"  and {len(cell.failed) - 5} more, in report.html")
        for _, command in islice(folder.commands(cell.failed[0]) if cell.failed else (), 1):
            say(f"  to see one: {command}")


def _print_main_table(cells: Sequence[Cell]) -> None:
    from rich.box import SIMPLE_HEAD
    from rich.table import Table

    from executor.bench.tables import FOOTNOTE, main_rows
    from executor.scenes.generators.families import FAMILIES

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


def _checked(options: Options) -> Shard:
    """Return the shard, after refusing options that make no sense."""
    from executor.cli.engines import check_engine
    from executor.cli.execution import check_seed, check_unit_limit, check_workers, read_shard
    from executor.cli.inputs import robot_asked_for
    from executor.scenes.generators.families import FAMILIES, LONG_HORIZON

    if not options.families:
        raise BadOption("T1..T7", "is missing", f"at least one of {', '.join((*FAMILIES, 'T7'))}")
    robot_asked_for(options.robot, full_size=options.full_size)
    check_seed(options.seed, options.episodes)
    check_workers(options.workers)
    check_unit_limit(options.limit_s)
    shard = read_shard(options.shard)
    check_engine(options, options.shard, options.out)
    check(
        options.until is None or 0.0 < options.until < 100.0, "--until", options.until, "a width from 0 to 100 points"
    )
    alone = options.until is None or (shard.of == 1 and options.slurm is None)
    check(alone, "--until", options.until, "no --shard and no --slurm: parts do not know of each other's units")
    both = options.asked.model is not None and options.flows == "paper"
    check(
        not both, "--model", options.asked.model, "no --flows paper, which are written for the offline planner's plans"
    )
    if options.flows == "paper" and (without := [f for f in options.families if f not in LONG_HORIZON]):
        raise BadOption("--flows", "paper", f"planned for {', '.join(without)}: the paper prints no flows for them")
    given = {
        "--evolve": options.evolve,
        "--keep-sizes": options.keep_sizes,
        "--full-size": options.full_size,
        "--robot": options.robot,
    }
    if "T7" in options.families and (named := [name for name, value in given.items() if value]):
        raise BadOption("T7", f"with {', '.join(named)}", "T7 without them: it has a robot and sizes of its own")
    return shard


@contextmanager
def _progress(
    folder: BenchFolder, asked: Sequence[Series], left: Collection[str], *, quiet: bool
) -> Iterator[Callable[[Unit, Mapping[str, Any]], None]]:
    """Provide a callback for every unit's ending that shows it: on a terminal a bar with the success count, else lines.

    Args:
        folder: Where results are kept; what is done already counts.
        asked: The series that are run.
        left: Ids of the units that are run here.
        quiet: Shows nothing.
    """
    if quiet:
        yield lambda unit, result: None
        return
    results = (result for series in asked for result in folder.results(series))
    endings = Counter(result["ended"] for result in results if result["id"] not in left)
    total, before, remaining = sum(series.episodes for series in asked), endings.total(), len(left)
    if before:
        tell(f"  {before} of {pluralize(total, 'unit')} done already, {remaining} to run now")
    shows_bar = ERR.is_terminal and remaining > 0
    pace = Pace(before + remaining, before, quiet=shows_bar)
    with bar(f"{endings['succeeded']} of {before} succeeded", total, done=before, quiet=not shows_bar) as show:

        def show_unit(unit: Unit, result: Mapping[str, Any]) -> None:
            endings[result["ended"]] += 1
            good, failure = result["ended"] == "succeeded", result.get("failure") or {}
            words = "succeeded" if good else f"{failure.get('kind')}: {first_line(failure.get('message'))}"
            done = endings.total()
            if not (shows_bar and good):
                count = f"{done:{len(str(total))}} of {total}"
                tell(
                    f"  {count}  {unit.name:28} {result['elapsed_s']:6.1f} s  {words}",
                    style="red" if shows_bar else None,
                )
            show(done, f"{endings['succeeded']} of {done} succeeded, {pace.text(done)}")
            pace.note(done)

        yield show_unit
