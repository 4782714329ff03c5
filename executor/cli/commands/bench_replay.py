"""`scene2demo bench replay`: one unit of a benchmark again, as a video and a report."""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from executor.cli.errors import DONE, FAILED, BadOption
from executor.cli.options import CommonOptions, Maybe, Read, ReplaceResults, Size, Video
from executor.cli.output import print_json, say, tell
from executor.system.files import write_json


@dataclass(frozen=True)
class Options(CommonOptions):
    """Run one unit of a benchmark again, and make a report with a video of it."""

    folder: tyro.conf.Positional[Annotated[Path, Read()]]
    """The benchmark's folder."""
    unit: tyro.conf.Positional[str]
    """The unit's name, as the report lists it, or the beginning of it."""
    out: Maybe[Path] = None
    """Folder for the results; by default `replays/UNIT` in the benchmark's, whose report then shows them."""
    force: ReplaceResults = False
    video: Video = True
    size: Size = (224, 224)


def execute(options: Options) -> int:
    """Run the unit again, write what `run` writes, and print whether the states were the same.

    Return 0 when they were, whether the unit succeeded or not, else 1.
    """
    from executor.bench.folder import BenchFolder
    from executor.bench.tables import write_results
    from executor.bench.work import replay
    from executor.cli.execution import command_line, print_summary, results_writer, summary_json
    from executor.reports.run_folder import RunFolder
    from executor.rollouts.run_record import RunRecord, evolution_json
    from executor.sim.render.frames import check_size

    check_size(options.size)
    bench = BenchFolder(options.folder)
    recorded = bench.find(options.unit)
    if recorded["setting"].get("baseline") is not None:
        raise BadOption("UNIT", recorded["name"], "a unit of the executor itself: baselines are not shown again")
    if recorded["family"] == "T7":
        shown = next((f"is shown by: {command}" for _, command in bench.commands(recorded)), "")
        shown = shown or "is planned again by its model's answers, which no command can name here"
        raise BadOption("UNIT", recorded["name"], f"a unit of T1 to T6; a wish of T7 {shown}")
    folder = RunFolder.prepare(options.out or bench.replay(recorded["name"]), force=options.force)
    if not options.json:
        tell(f"  {recorded['name']}: {recorded.get('query', '')}")
    with folder.filling(), results_writer(options.size, video=options.video, quiet=options.json) as studio:
        began = time.perf_counter()
        again = replay(recorded, bench.answers(recorded))
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
                size=None if options.size == Options.size else options.size,
            ),
        )
        record = folder.write_rollout(record)
        if again.story is not None:
            write_json(folder.path / "evolution.json", evolution_json(again.story))
        record = studio.finish(record, folder)
    if options.out is None:
        write_results(bench)
    code = FAILED if again.same is False else DONE
    if options.json:
        found = {"unit": recorded["name"], "same_states": again.same, "comparison": again.verdict}
        print_json({**summary_json(record, folder), **found, "ok": code == DONE, "exit_code": code})
    else:
        print_summary(record, folder)
        say(f"{'compared':11} {again.verdict}", style="red" if again.same is False else "green")
    return code
