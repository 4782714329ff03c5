"""`scene2demo bench replay`: one unit of a benchmark again, as a video and a report.

Returns 0 when the states were the same as when it was measured, whether it succeeded or not; 1 when they were not.
"""

from __future__ import annotations

import shlex
import time

from executor.bench.replay import replay
from executor.bench.store import BenchFolder
from executor.cli.commands.run import Studio
from executor.cli.options.running import Replay, Run
from executor.cli.terminal.errors import DONE, FAILED
from executor.cli.terminal.output import print_json, say, tell
from executor.cli.terminal.summary import print_summary, summary_json
from executor.machine.files import write_json
from executor.pictures.render import check_size
from executor.results.evolution_files import evolution_json
from executor.results.run_folder import RunFolder
from executor.results.run_record import RunRecord
from oag import compose


def execute(options: Replay) -> int:
    """Runs the unit again, writes what `run` writes, says whether it was the same, and returns the exit code."""
    check_size(options.size)
    recorded = BenchFolder(options.folder).find(options.unit)
    folder = RunFolder.prepare(options.out, force=options.force)
    if not options.json:
        tell(f"  {recorded['name']}: {recorded.get('query', '')}")
    drawing = Run(recorded["name"], "", options.out, video=options.video, size=options.size, json=options.json)
    with folder.filling(), Studio(drawing) as studio:
        began = time.perf_counter()
        again = replay(recorded)
        wall = {"planning and physics": time.perf_counter() - began}
        # What the folder calls the plan, and certifies, is the one that was run in the end.
        graph = again.graph if again.story is None else compose(again.story.evolved, scene=again.pair.scene)
        record = RunRecord(
            graph=graph,
            report=graph.verify(),
            query=again.pair.query,
            notes=(f"unit {recorded['name']}: {again.verdict}",),
            rollout=again.rollout,
            wall_s=wall,
            command=_command(options),
        )
        folder.write_plan(record)
        folder.write_rollout(again.rollout)
        if again.story is not None:
            write_json(folder.path / "evolution.json", evolution_json(again.story))
        record = studio.picture(record, folder)
    code = FAILED if again.same is False else DONE
    if options.json:
        found = {"unit": recorded["name"], "same_states": again.same, "comparison": again.verdict}
        print_json({**summary_json(record, folder), **found, "ok": code == DONE, "exit_code": code})
    else:
        print_summary(record, folder)
        say(f"{'compared':11} {again.verdict}", style="red" if again.same is False else "green")
    return code


def _command(options: Replay) -> str:
    words = ["scene2demo", "bench", "replay", str(options.folder), options.unit, "--out", str(options.out)]
    if not options.video:
        words.append("--no-video")
    if options.size != Replay.size:
        words += ["--size", *map(str, options.size)]
    return shlex.join(words)
