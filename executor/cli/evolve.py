"""`scene2demo evolve`: executes a task file, revising the flows that fail, and tells every attempt.

Returns 0 when every episode succeeded in the end, 1 when one did not or the plan is not proved, 2 after Ctrl-C.
"""

from __future__ import annotations

import json
import shlex
import time
from collections.abc import Iterator, Sequence

from executor.captions import readable
from executor.cli.bad_option import BadOption
from executor.cli.errors import DONE, FAILED
from executor.cli.inputs import check_seed, task_and_scene
from executor.cli.options import Evolve as EvolveOptions
from executor.cli.output import print_json, say, tell
from executor.cli.progress import RolloutProgress
from executor.cli.refused import refuse
from executor.evolution import evolve
from executor.evolution_files import evolution_json
from executor.evolution_record import Evolution
from executor.extras import MissingExtra, require
from executor.files import write_json
from executor.run_folder import RunFolder, episode_folders
from executor.run_record import RunRecord
from oag import Scene, clopper_pearson, compose, flow_to_json


def execute(options: EvolveOptions) -> int:
    """Runs the episodes, prints their attempts, and returns the exit code."""
    check_seed(options.seed, options.episodes)
    if options.limit < 0:
        raise BadOption("--limit", options.limit, "0 or more")
    task, scene = task_and_scene(options.task, options.scene)
    graph = compose(task, scene=scene)
    report = graph.verify()
    if not report:
        return refuse(report, as_json=options.json)
    seeds = range(options.seed, options.seed + options.episodes)
    folders = episode_folders(options.out, seeds, force=options.force)
    done: list[tuple[Evolution, float]] = []
    with RolloutProgress(quiet=options.json or options.episodes > 1) as progress:
        for seed in seeds:
            began = time.perf_counter()
            evolution = evolve(graph, scene, seed, limit=options.limit, listen=progress)
            done.append((evolution, time.perf_counter() - began))
            if seed in folders:
                _write(folders[seed], scene, evolution, _command(options, seed))
            if not options.json and options.episodes > 1:
                say(_headline(*done[-1]), style="green" if evolution.succeeded else "red")
    good = all(evolution.succeeded for evolution, _ in done)
    if options.json:
        episodes = [evolution_json(evolution) | {"wall_s": wall_s} for evolution, wall_s in done]
        counts = summary_of([evolution for evolution, _ in done])
        print_json({"ok": good, "exit_code": DONE if good else FAILED, **counts, "episodes": episodes})
    else:
        _print(done, options)
    return DONE if good else FAILED


def summary_of(evolutions: Sequence[Evolution]) -> dict[str, object]:
    """Returns successes before and after evolution with exact 95 % intervals, and how many revisions they took."""
    trials = len(evolutions)
    before = sum(evolution.succeeded_at_once for evolution in evolutions)
    after = sum(evolution.succeeded for evolution in evolutions)
    evolved = [e.revisions for e in evolutions if e.succeeded and e.revisions]
    return {
        "trials": trials,
        "successes_before": before,
        "successes_after": after,
        "interval_95_before": clopper_pearson(before, trials),
        "interval_95_after": clopper_pearson(after, trials),
        "revisions_where_evolved_mean": sum(evolved) / len(evolved) if evolved else None,
    }


def story_lines(evolution: Evolution) -> Iterator[tuple[str, str | None]]:
    """Yields the table of the attempts at every subtask, with the revisions between them, and its styles."""
    for story in evolution.stories:
        mark, style = ("✓", "green") if story.solved else ("✗", "red")
        name = readable(story.records[-1].name)
        yield f"{mark} {story.history.subtask + 1} {name:44} {_counted(len(story.records), 'attempt')}", style
        if story.revisions == 0 and story.solved:
            continue
        for number, (attempt, revision) in enumerate(story.history.iterations, start=1):
            flow = json.dumps(flow_to_json(attempt.flow))
            yield f"    {number}  {flow}", None
            yield f"       {'succeeded' if attempt.succeeded else f'{attempt.failure}: {attempt.message}'}", None
            if revision is not None:
                yield f"       {revision.change}: {revision.explanation}", "yellow"
        if story.gave_up is not None:
            yield f"    gave up: {story.gave_up.reason}", "red"


def _counted(count: int, what: str) -> str:
    return f"{count} {what}" if count == 1 else f"{count} {what}s"


def _write(folder: RunFolder, scene: Scene, evolution: Evolution, command: str) -> None:
    # What the folder calls the plan, and certifies, is the one that was run in the end.
    graph = compose(evolution.evolved, scene=scene)
    record = RunRecord(graph, graph.verify(), rollout=evolution.rollout, command=command)
    folder.write_plan(record)
    folder.write_rollout(evolution.rollout)
    write_json(folder.path / "evolution.json", evolution_json(evolution))
    folder.write_report(record, None)
    try:
        require("h5py", "data")
    except MissingExtra as missing:
        tell(f"no dataset: {missing}", style="yellow")
    else:
        folder.write_episode(evolution.rollout, None)


def _command(options: EvolveOptions, seed: int) -> str:
    words = ["scene2demo", "evolve", str(options.task), "--scene", options.scene, "--seed", str(seed)]
    return shlex.join([*words, "--limit", str(options.limit)])


def _headline(evolution: Evolution, wall_s: float) -> str:
    rollout = evolution.rollout
    words = "failed" if not evolution.succeeded else "succeeded at once" if not evolution.revisions else "succeeded"
    made = _counted(evolution.revisions, "revision")
    return f"seed {rollout.seed:4}  {wall_s:5.1f} s  {rollout.state_hash[:16]}  {made}  {words}"


def _print(done: list[tuple[Evolution, float]], options: EvolveOptions) -> None:
    if options.episodes == 1:
        for evolution, wall_s in done:
            for text, style in story_lines(evolution):
                say(text, style=style)
            say(_headline(evolution, wall_s), style="green" if evolution.succeeded else "red")
    else:
        counts = summary_of([evolution for evolution, _ in done])
        say(
            f"{counts['successes_before']} of {counts['trials']} succeeded at once, "
            f"{counts['successes_after']} after evolution"
        )
    if options.out is not None:
        say(f"results in {options.out}")
