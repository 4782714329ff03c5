"""`scene2demo evolve`: executes a task file, revising the flows that fail, and tells every attempt.

Returns 0 when every episode succeeded in the end, 1 when one did not or the plan is not proved, 130 after Ctrl-C.
"""

from __future__ import annotations

import json
import time
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from bddl.visible import counted
from executor.cli.errors import DONE, FAILED, INTERRUPTED, check
from executor.cli.executing import check_limit, check_seed, command_line, refuse, task_to_run
from executor.cli.fault_words import FaultWords
from executor.cli.judging import Judging, judge_arguments, stopped_words
from executor.cli.output import print_json, say, tell, tell_notes
from executor.cli.progress import RolloutProgress
from executor.cli.words.running import EvolveOptions
from executor.evolution.record import Evolution, EvolutionInterrupted
from executor.machine.extras import MissingExtra
from executor.machine.files import json_text, read_json
from executor.records.captions import readable
from executor.results.evolution_files import evolution_json
from executor.results.run_folder import RunFolder, episode_folder
from executor.results.run_record import RunRecord
from executor.world.faults import Fault, fault_json
from llm.answers.spending import Spending
from oag import ObjectActionGraph, Task, clopper_pearson, compose, flow_to_json
from oag.task.sizes import resizings


def execute(options: EvolveOptions) -> int:
    """Runs the episodes, prints their attempts, and returns the exit code."""
    check_seed(options.seed, options.episodes)
    check_limit(options.limit)
    without = options.resume and options.out is None
    check(not without, "--resume", "is given without --out", "the folder of the episodes to go on from")
    faults = tuple(FaultWords.parse(words) for words in options.fault)
    task, scene = task_to_run(options.task, options.scene, keep_sizes=options.keep_sizes)
    for words in faults:
        if words.object_id is not None:
            scene[words.object_id]  # Says which objects there are when it is none.
    graph = compose(task, scene=scene)
    report = graph.verify()
    if not report:
        return refuse(report, as_json=options.json)
    notes = tuple(map(str, resizings(task.scales, scene)))
    if not options.json:
        tell_notes(notes)
    check(not (options.resume and options.force), "--resume", "", "no --force with it, which starts over")
    told: list[dict[str, Any]] = []
    last: Evolution | None = None
    interrupted, stopped = False, ""
    spent: list[Spending] = []
    try:
        for done, episode in _episodes(options, faults, graph, spent):
            last, stopped = done, episode.get("stopped", "")
            told.append(episode)
            if not options.json and options.episodes > 1:
                say(_headline(episode), style="green" if episode["succeeded"] else "red")
    except EvolutionInterrupted:
        interrupted = True
    usage = spent[0].to_json() if spent else None
    good = not interrupted and all(episode["succeeded"] for episode in told)
    code = INTERRUPTED if interrupted else DONE if good else FAILED
    if options.json:
        head = {"ok": good, "exit_code": code, "interrupted": interrupted, "notes": list(notes)}
        head |= {"usage": usage, "stopped": stopped}
        print_json({**head, **_summary_of(told), "episodes": told})
    else:
        _print(told, last, options)
        for spending in spent:
            say(spending.total())
        if stopped:
            tell(f"scene2demo: {stopped_words(stopped)}", style="red")
        elif interrupted:
            tell("scene2demo: interrupted; finished episodes were kept, --resume goes on", style="yellow")
    return code


def _episodes(
    options: EvolveOptions, faults: tuple[FaultWords, ...], graph: ObjectActionGraph, spent: list[Spending]
) -> Iterator[tuple[Evolution | None, dict[str, Any]]]:
    """Yields the episodes in JSON form, in the order of seeds, each with what was run here; None where it was kept.

    The one in which the model stops answering is the last, and says so; it is none that is kept.

    Args:
        options: What was typed.
        faults: What is wrong on purpose.
        graph: The proved plan.
        spent: Where what the model takes is put, if there is one.

    Raises:
        BadOption: The folder to go on from has episodes of another experiment.
        EvolutionInterrupted: Ctrl-C.
    """
    seeds = range(options.seed, options.seed + options.episodes)
    kept: dict[int, dict[str, Any]] = {}
    folders: dict[int, RunFolder] = {}
    paths = {} if options.out is None else {seed: episode_folder(options.out, seed) for seed in seeds}
    for seed, path in paths.items():
        drawn = tuple(words.drawn(seed) for words in faults)
        found = _kept(path / "evolution.json", graph.task, drawn, seed) if options.resume else None
        if found is not None:
            kept[seed] = found
        else:
            # An episode that was interrupted has no evolution.json, and is run again.
            folders[seed] = RunFolder.prepare(path, force=options.force or options.resume)
    judged_by = Judging(
        options.judged,
        options.out,
        force=options.force,
        resume=options.resume,
        pictures=options.pictures,
        quiet=options.json,
    )
    spent += [] if judged_by.spending is None else [judged_by.spending]
    with judged_by as judging, RolloutProgress(quiet=options.json or options.episodes > 1) as progress:
        for seed in seeds:
            if seed in kept:
                yield None, kept[seed]
                continue
            began = time.perf_counter()
            drawn = tuple(words.drawn(seed) for words in faults)
            done = judging.evolve(graph, seed=seed, limit=options.limit, listen=progress, faults=drawn)
            stopped = "" if done.succeeded else judging.stopped
            told = evolution_json(done) | {"wall_s": time.perf_counter() - began, "stopped": stopped}
            if seed in folders:
                _write(folders[seed], graph, done, options, judging.spending, stopped)
            yield done, told
            if stopped:
                return


def _write(
    folder: RunFolder,
    graph: ObjectActionGraph,
    evolution: Evolution,
    options: EvolveOptions,
    spending: Spending | None,
    stopped: str,
) -> None:
    command = command_line(
        "evolve",
        options.task,
        scene=options.scene,
        seed=evolution.rollout.seed,
        limit=options.limit,
        keep_sizes=options.keep_sizes,
        fault=list(options.fault),
        **judge_arguments(options.judged),
    )
    with folder.filling():
        record = RunRecord(graph, graph.verify(), command=command, spending=spending, stopped=stopped)
        folder.write_report(folder.write_evolution(record, evolution), None)
        try:
            folder.write_episode(evolution.rollout, None)
        except MissingExtra as missing:
            tell(f"no dataset: {missing}", style="yellow")


def _kept(path: Path, task: Task, faults: tuple[Fault, ...], seed: int) -> dict[str, Any] | None:
    """Returns the episode that a file has, None when it has none.

    Raises:
        BadOption: It is one of another experiment.
    """
    try:
        told = read_json(path)
    except (OSError, ValueError):
        return None
    if isinstance(told, dict) and told.get("stopped"):
        return None
    asked = {"original": task.to_json(), "faults": [fault_json(fault) for fault in faults], "seed": seed}
    same = isinstance(told, dict) and all(told.get(key) == json.loads(json_text(asked[key])) for key in asked)
    check(same, "--resume", path, "episodes of the same task with the same faults")
    return dict(told)


def _print(told: Sequence[Mapping[str, Any]], last: Evolution | None, options: EvolveOptions) -> None:
    if options.episodes == 1 and told:
        for text, style in () if last is None else _story_lines(last):
            say(text, style=style)
        say(_headline(told[0]), style="green" if told[0]["succeeded"] else "red")
    elif told:
        counts = _summary_of(told)
        say(
            f"{counts['successes_before']} of {counts['trials']} succeeded at once, "
            f"{counts['successes_after']} after evolution"
        )
    if options.out is not None:
        say(f"results in {options.out}")


def _summary_of(episodes: Sequence[Mapping[str, Any]]) -> dict[str, object]:
    """Returns successes before and after evolution with exact 95 % intervals, and how many revisions they took.

    Args:
        episodes: Evolutions in their JSON form.
    """
    trials = len(episodes)
    before = sum(bool(episode["succeeded_at_once"]) for episode in episodes)
    after = sum(bool(episode["succeeded"]) for episode in episodes)
    evolved = [int(e["revisions"]) for e in episodes if e["succeeded"] and e["revisions"]]
    return {
        "trials": trials,
        "successes_before": before,
        "successes_after": after,
        "interval_95_before": clopper_pearson(before, trials) if trials else None,
        "interval_95_after": clopper_pearson(after, trials) if trials else None,
        "revisions_where_evolved_mean": sum(evolved) / len(evolved) if evolved else None,
    }


def _story_lines(evolution: Evolution) -> Iterator[tuple[str, str | None]]:
    """Yields the table of the attempts at every subtask, with the revisions between them, and its styles."""
    for story in evolution.stories:
        mark, style = ("✓", "green") if story.solved else ("✗", "red")
        name = readable(story.records[-1].name)
        yield f"{mark} {story.history.subtask + 1} {name:44} {counted(len(story.records), 'attempt')}", style
        if len(story.records) == 1 and story.solved:
            continue
        for number, (attempt, revision) in enumerate(story.history.iterations, start=1):
            flow = json.dumps(flow_to_json(attempt.flow))
            yield f"    {number}  {flow}", None
            yield f"       {'succeeded' if attempt.succeeded else f'{attempt.failure}: {attempt.message}'}", None
            if revision is None:
                continue
            back = revision.subtask is not None and revision.subtask < story.history.subtask
            if back and attempt.succeeded:
                yield f"       undone, since T{(revision.subtask or 0) + 1} was revised", "yellow"
            else:
                where = f"back to T{(revision.subtask or 0) + 1}" if back else revision.change
                yield from _refused(revision.refused)
                yield f"       {where}: {revision.explanation}", "yellow"
        if story.gave_up is not None:
            yield from _refused(story.gave_up.refused)
            yield f"    gave up: {story.gave_up.reason}", "red"


def _refused(answers: Sequence[str]) -> Iterator[tuple[str, str | None]]:
    for answer in answers:
        yield f"       refused before it moved: {answer}", "dim"


def _headline(episode: Mapping[str, Any]) -> str:
    """Returns an episode in a line.

    Args:
        episode: An evolution in its JSON form, with the wall time that it took where that is known.
    """
    revisions = int(episode["revisions"])
    words = "failed" if not episode["succeeded"] else "succeeded" if revisions else "succeeded at once"
    wall_s = episode.get("wall_s")
    took = "before" if wall_s is None else f"{wall_s:5.1f} s"
    made = counted(revisions, "revision")
    return f"seed {episode['seed']:4}  {took:>7}  {episode['state_hash'][:16]}  {made}  {words}"
