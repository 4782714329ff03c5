"""`scene2demo evolve`: execute a task file, revise the flows that fail, and report every attempt.

`executor/cli/faults.py` reads the faults that are typed.
Exit code 0 when every episode succeeded in the end, 1 when one did not or the plan is not proved, 130 after Ctrl-C.
"""

from __future__ import annotations

import json
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from bddl.terminal import pluralize
from executor.cli.errors import DONE, FAILED, INTERRUPTED, check
from executor.cli.faults import FaultOption
from executor.cli.options import (
    CommonOptions,
    Episodes,
    EpisodesFolder,
    FirstSeed,
    Flag,
    JudgeOptions,
    KeepSizes,
    Limit,
    ReplaceResults,
    SceneName,
    TaskToRun,
)
from executor.cli.output import print_json, say, tell, tell_notes
from executor.system.files import json_text, read_json

if TYPE_CHECKING:
    from executor.cli.evolution_setup import EvolutionSetup
    from executor.reports.run_folder import RunFolder
    from executor.rollouts.evolution_record import Evolution
    from executor.sim.faults import Fault
    from llm.structured.conversation import Spending
    from oag import ObjectActionGraph, Task


@dataclass(frozen=True)
class Options(CommonOptions):
    """Execute a task file, and revise the flows that fail until they succeed or nothing is left to try."""

    task: TaskToRun
    scene: SceneName
    seed: FirstSeed = 0
    episodes: Episodes = 1
    limit: Limit = 5
    keep_sizes: KeepSizes = False
    fault: Annotated[tuple[str, ...], tyro.conf.UseAppendAction, tyro.conf.arg(metavar="KIND:...")] = ()
    """What is wrong on purpose, such as pose:glass_0,size_m=0.02 or grip:force_n=2; may be given several times."""
    judged: JudgeOptions = field(default_factory=JudgeOptions)
    out: EpisodesFolder = None
    resume: Flag = False
    """Keep the finished episodes that the folder has, and run the others."""
    pictures: Flag = False
    """Draw the failed steps of all attempts for the report; needs a renderer."""
    force: ReplaceResults = False


def execute(options: Options) -> int:
    """Run the episodes, print their attempts, and return the exit code."""
    from executor.cli.evolution_setup import EvolutionSetup, stopped_message
    from executor.cli.execution import check_limit, check_object, check_seed, refuse, task_to_run
    from executor.rollouts.evolution_record import EvolutionInterrupted
    from oag import compose
    from oag.sizes import planned_resizings

    check_seed(options.seed, options.episodes)
    check_limit(options.limit)
    without = options.resume and options.out is None
    check(not without, "--resume", "is given without --out", "the folder of the episodes to go on from")
    faults = tuple(FaultOption.parse(words) for words in options.fault)
    task, scene = task_to_run(options.task, options.scene, keep_sizes=options.keep_sizes)
    for words in faults:
        if words.object_id is not None:
            check_object(scene, words.object_id)
    graph = compose(task, scene=scene)
    report = graph.verify()
    if not report:
        return refuse(report, as_json=options.json)
    notes = tuple(map(str, planned_resizings(task.scales, scene)))
    if not options.json:
        tell_notes(notes)
    check(not (options.resume and options.force), "--resume", "", "no --force with it, which starts over")
    results: list[dict[str, Any]] = []
    last: Evolution | None = None
    interrupted, stopped = False, ""
    kept, folders = _kept_and_folders(options, faults, graph.task)
    setup = EvolutionSetup(
        options.judged,
        options.out,
        force=options.force,
        resume=options.resume,
        pictures=options.pictures,
        quiet=options.json,
    )
    try:
        for done, episode in _episodes(options, faults, graph, setup, kept, folders):
            last, stopped = done, episode.get("stopped", "")
            results.append(episode)
            if not options.json and options.episodes > 1:
                say(_headline(episode), style="green" if episode["succeeded"] else "red")
    except EvolutionInterrupted:
        interrupted = True
    usage = None if setup.spending is None else setup.spending.to_json()
    good = not interrupted and all(episode["succeeded"] for episode in results)
    code = INTERRUPTED if interrupted else DONE if good else FAILED
    if options.json:
        head = {"ok": good, "exit_code": code, "interrupted": interrupted, "notes": list(notes)}
        head |= {"usage": usage, "stopped": stopped}
        print_json({**head, **_summary_of(results), "episodes": results})
    else:
        _print(results, last, options)
        if setup.spending is not None:
            say(setup.spending.total())
        if stopped:
            tell(f"scene2demo: {stopped_message(stopped)}", style="red")
        elif interrupted:
            tell("scene2demo: interrupted; finished episodes were kept, --resume goes on", style="yellow")
    return code


def _kept_and_folders(
    options: Options, faults: tuple[FaultOption, ...], task: Task
) -> tuple[dict[int, dict[str, Any]], dict[int, RunFolder]]:
    """Return by seed the finished episodes that are kept, and the prepared folders of the others.

    Raises:
        BadOption: The folder to go on from has episodes of another experiment.
    """
    from executor.reports.run_folder import RunFolder, episode_folder

    kept: dict[int, dict[str, Any]] = {}
    folders: dict[int, RunFolder] = {}
    if options.out is None:
        return kept, folders
    for seed in range(options.seed, options.seed + options.episodes):
        path = episode_folder(options.out, seed)
        drawn = tuple(words.drawn(seed) for words in faults)
        found = _kept(path / "evolution.json", task, drawn, seed) if options.resume else None
        if found is not None:
            kept[seed] = found
        else:
            # An episode that was interrupted has no evolution.json, and is run again.
            folders[seed] = RunFolder.prepare(path, force=options.force or options.resume)
    return kept, folders


def _episodes(
    options: Options,
    faults: tuple[FaultOption, ...],
    graph: ObjectActionGraph,
    setup: EvolutionSetup,
    kept: Mapping[int, dict[str, Any]],
    folders: Mapping[int, RunFolder],
) -> Iterator[tuple[Evolution | None, dict[str, Any]]]:
    """Yield the episodes in JSON form, in the order of seeds, each with its evolution; None where the result was kept.

    The one in which the model stops answering is the last, and has the reason; it does not count as kept.

    Args:
        options: The typed options.
        faults: Deliberate faults.
        graph: The proved plan.
        setup: Their judges.
        kept: Finished episodes, by seed.
        folders: Folders of the others, by seed.

    Raises:
        EvolutionInterrupted: Ctrl-C.
    """
    from executor.cli.execution import RolloutProgress
    from executor.rollouts.rollout import RunConditions
    from executor.rollouts.run_record import evolution_json

    with setup as judging, RolloutProgress(quiet=options.json or options.episodes > 1) as progress:
        for seed in range(options.seed, options.seed + options.episodes):
            if seed in kept:
                yield None, kept[seed]
                continue
            began = time.perf_counter()
            drawn = tuple(words.drawn(seed) for words in faults)
            done = judging.evolve(
                graph, seed=seed, limit=options.limit, listen=progress, conditions=RunConditions(faults=drawn)
            )
            stopped = "" if done.succeeded else judging.stopped
            episode_result = evolution_json(done) | {"wall_s": time.perf_counter() - began, "stopped": stopped}
            if seed in folders:
                _write(folders[seed], graph, done, options, judging.spending, stopped)
            yield done, episode_result
            if stopped:
                return


def _write(
    folder: RunFolder,
    graph: ObjectActionGraph,
    evolution: Evolution,
    options: Options,
    spending: Spending | None,
    stopped: str,
) -> None:
    from executor.cli.execution import typed_command
    from executor.rollouts.run_record import RunRecord
    from executor.system.extras import MissingExtra

    of_it = replace(options, seed=evolution.rollout.seed)
    command = typed_command("evolve", of_it, "task", ("episodes", "out", "pictures"))
    with folder.filling():
        record = RunRecord(graph, graph.verify(), command=command, spending=spending, stopped=stopped)
        record = folder.write_evolution(record, evolution)
        try:
            folder.write_episode(evolution.rollout, None)
        except MissingExtra as missing:
            tell(f"no dataset: {missing}", style="yellow")
        folder.write_report(record, None)


def _kept(path: Path, task: Task, faults: tuple[Fault, ...], seed: int) -> dict[str, Any] | None:
    """Return the recorded episode if it is finished; refuse another experiment's."""
    from executor.sim.faults import fault_json

    try:
        recorded = read_json(path)
    except (OSError, ValueError):
        return None
    if isinstance(recorded, dict) and recorded.get("stopped"):
        return None
    asked = {"original": task.to_json(), "faults": [fault_json(fault) for fault in faults], "seed": seed}
    same = isinstance(recorded, dict) and all(recorded.get(key) == json.loads(json_text(asked[key])) for key in asked)
    check(same, "--resume", path, "episodes of the same task with the same faults")
    return dict(recorded)


def _print(results: Sequence[Mapping[str, Any]], last: Evolution | None, options: Options) -> None:
    if options.episodes == 1 and results:
        for text, style in () if last is None else _story_lines(last):
            say(text, style=style)
        say(_headline(results[0]), style="green" if results[0]["succeeded"] else "red")
    elif results:
        counts = _summary_of(results)
        say(
            f"{counts['successes_before']} of {counts['trials']} succeeded at once, "
            f"{counts['successes_after']} after evolution"
        )
    if options.out is not None:
        say(f"results in {options.out}")


def _summary_of(episodes: Sequence[Mapping[str, Any]]) -> dict[str, object]:
    """Return successes before and after evolution with exact 95 % intervals, and how many revisions they took.

    Args:
        episodes: Evolutions in their JSON form.
    """
    from oag.measurements import clopper_pearson

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
    """Yield the table of the attempts at every subtask, with the revisions between them, and its styles."""
    from executor.records import readable
    from oag.model.actions import flow_to_json

    for story in evolution.stories:
        mark, style = ("✓", "green") if story.solved else ("✗", "red")
        name = readable(story.records[-1].name)
        yield f"{mark} {story.history.subtask + 1} {name:44} {pluralize(len(story.records), 'attempt')}", style
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
    """Return an episode in a line.

    Args:
        episode: An evolution in its JSON form, with the wall time that it took where that is known.
    """
    revisions = int(episode["revisions"])
    words = "failed" if not episode["succeeded"] else "succeeded" if revisions else "succeeded at once"
    wall_s = episode.get("wall_s")
    took = "before" if wall_s is None else f"{wall_s:5.1f} s"
    made = pluralize(revisions, "revision")
    return f"seed {episode['seed']:4}  {took:>7}  {episode['state_hash'][:16]}  {made}  {words}"
