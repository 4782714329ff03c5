"""`scene2demo rollout`: execute a task file over seeds, in this process or in several, and count successes.

Exit code 0 when every episode succeeded, 1 when one did not or the plan is not proved, 130 after Ctrl-C.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bddl.terminal import pluralize
from executor.cli.errors import DONE, FAILED, INTERRUPTED
from executor.cli.options import (
    CommonOptions,
    Episodes,
    EpisodesFolder,
    FirstSeed,
    Flag,
    KeepSizes,
    ReplaceResults,
    SceneName,
    TaskToRun,
)
from executor.cli.output import print_json, say, tell, tell_notes
from executor.system.files import plain, write_json

if TYPE_CHECKING:
    from executor.cli.execution import RolloutProgress
    from executor.records import Rollout
    from oag import ObjectActionGraph, Report


@dataclass(frozen=True)
class Options(CommonOptions):
    """Execute a task file in the physics, over one or more seeds, and count successes."""

    task: TaskToRun
    scene: SceneName
    seed: FirstSeed = 0
    episodes: Episodes = 1
    open_numbers: Flag = False
    """Leave all numbers of the flows to the planner, so that every episode has its own."""
    keep_sizes: KeepSizes = False
    workers: int = 1
    """How many processes to run them in; one that crashes costs its episode only."""
    out: EpisodesFolder = None
    force: ReplaceResults = False


WORKER = "executor.cli.commands.rollout"
"""What a worker process runs: this file, from its end."""


@dataclass(frozen=True, slots=True)
class EpisodeResult:
    """How one episode ended.

    Attributes:
        seed: Its seed.
        succeeded: Whether all subtasks and the task goal were reached.
        reason: Kind of failure; "crashed" when its process died, "interrupted" after Ctrl-C, empty on success.
        message: The failure in a sentence.
        state_hash: Hash of its states; empty when there are none.
        simulated_s, wall_s: How long it was, and took.
    """

    seed: int
    succeeded: bool
    reason: str
    message: str
    state_hash: str
    simulated_s: float
    wall_s: float


def execute(options: Options) -> int:
    """Run the episodes, print their counts, and return the exit code."""
    from executor.cli.execution import RolloutProgress, check_seed, check_workers, refuse

    check_seed(options.seed, options.episodes)
    check_workers(options.workers)
    graph = _graph_of(options)
    report = graph.verify()
    if not report:
        return refuse(report, as_json=options.json)
    notes = list(_notes(graph))
    if not options.json:
        tell_notes(notes)
    head = {"task": graph.task.name, "scene": graph.scene.name, "verdict": report.verdict.value, "notes": notes}
    keeper = _Keeper(graph, report, options, force=options.force)
    results: list[EpisodeResult] = []
    interrupted = False

    def save() -> None:
        if options.out is not None:
            write_json(options.out / "summary.json", {"interrupted": interrupted, **head, **summary_of(results)})

    save()
    try:
        with RolloutProgress(quiet=options.json or options.episodes > 1) as progress:
            apart = options.workers > 1 and options.episodes > 1
            for result in _run_apart(options) if apart else _run_here(graph, options, keeper, progress):
                results.append(result)
                save()
                if options.episodes > 1 and not options.json:
                    tell(f"  {_line(result)}")
    except KeyboardInterrupt:
        interrupted = True
    finally:
        save()
    summary = summary_of(results)
    good = not interrupted and summary["successes"] == options.episodes
    code = INTERRUPTED if interrupted else DONE if good else FAILED
    if options.json:
        print_json({"ok": good, "exit_code": code, "interrupted": interrupted, **head, **summary})
        return code
    for result in results if options.episodes == 1 else ():
        say(_line(result), style="green" if result.succeeded else "red")
    if summary["trials"]:
        low, high = summary["interval_95"]
        share = f"{summary['success_rate']:.0%}; 95 % interval {low:.1%} to {high:.1%}"
        say(f"{summary['successes']} of {summary['trials']} succeeded ({share})")
    if summary["failures"]:
        say("failures: " + ", ".join(f"{count} {reason}" for reason, count in summary["failures"].items()))
    if summary["trials"]:
        say(f"{summary['wall_s_mean']:.1f} s wall an episode")
    if options.out is not None:
        say(f"results in {options.out}")
    if interrupted:
        tell("scene2demo: interrupted; finished episodes were kept", style="yellow")
    return code


def _graph_of(options: Options) -> ObjectActionGraph:
    """Return the composed task to execute, its numbers left open where requested."""
    from executor.cli.execution import task_to_run
    from executor.rollouts.run_record import with_open_numbers
    from oag import compose

    task, scene = task_to_run(options.task, options.scene, keep_sizes=options.keep_sizes)
    return compose(with_open_numbers(task) if options.open_numbers else task, scene=scene)


def _notes(graph: ObjectActionGraph) -> Iterator[str]:
    """Yield notes for a reader of the counts: changed sizes, and numbers that no seed changes."""
    from executor.rollouts.run_record import numbered_steps
    from oag.sizes import planned_resizings

    yield from map(str, planned_resizings(graph.task.scales, graph.scene))
    steps = numbered_steps(graph.task)
    if steps:
        yield (
            f"numbers are written into {pluralize(len(steps), 'step')} ({', '.join(steps)}), and every seed runs these"
            ", such as those that `run` wrote for its own; --open-numbers leaves them to the planner"
        )


def _run_here(
    graph: ObjectActionGraph, options: Options, keeper: _Keeper, progress: RolloutProgress
) -> Iterator[EpisodeResult]:
    """Yield the episodes' results in order, run one after the other in this process.

    Raises:
        KeyboardInterrupt: After the interrupted episode's result was yielded and its files were kept.
    """
    from executor.records import RolloutInterrupted
    from executor.rollouts.rollout import rollout

    for seed in range(options.seed, options.seed + options.episodes):
        began = time.perf_counter()
        try:
            done = rollout(graph, graph.scene, seed, listen=progress)
        except RolloutInterrupted as stop:
            yield _result(stop.partial, time.perf_counter() - began, interrupted=True)
            keeper.keep(stop.partial, True)
            raise
        wall_s = time.perf_counter() - began
        # The result comes first: it counts even when keeping the files fails.
        yield _result(done, wall_s)
        keeper.keep(done, False)


def _run_apart(options: Options) -> Iterator[EpisodeResult]:
    """Yield the episodes' results as they come, from worker processes: a crash in native code costs one episode."""
    from executor.system.workers import WorkerPool

    given: dict[str, object] = {"task": str(options.task), "scene": options.scene}
    given |= {"open_numbers": options.open_numbers, "keep_sizes": options.keep_sizes}
    given["out"] = None if options.out is None else str(options.out)
    requests = [{**given, "seed": options.seed + number} for number in range(options.episodes)]
    for outcome in WorkerPool(WORKER, options.workers).run(requests):
        if outcome.ending == "finished":
            yield EpisodeResult(**outcome.answer)
        else:
            reason = outcome.answer.get("kind", outcome.ending)
            message = outcome.answer.get("error", outcome.message)
            yield EpisodeResult(outcome.request["seed"], False, reason, message, "", 0.0, outcome.wall_s)


def _result(done: Rollout, wall_s: float, *, interrupted: bool = False) -> EpisodeResult:
    from executor.rollouts.rollout import failure_of

    failure = None if interrupted or done.succeeded else failure_of(done)
    reason = "interrupted" if interrupted else failure.kind.value if failure else ""
    message = failure.message if failure else ""
    return EpisodeResult(
        done.seed, done.succeeded and not interrupted, reason, message, done.state_hash, done.simulated_s, wall_s
    )


class _Keeper:
    """Writes the files of episodes, each into its folder; nothing without an output folder.

    Raises:
        ResultsExist, FolderUnusable: A folder cannot take the results; found before the first episode runs.
    """

    def __init__(self, graph: ObjectActionGraph, report: Report, options: Options, *, force: bool) -> None:
        from executor.reports.run_folder import RunFolder, episode_folder
        from executor.system.extras import MissingExtra, require

        self._graph, self._report, self._options = graph, report, options
        seeds = range(options.seed, options.seed + options.episodes)
        paths = {} if options.out is None else {seed: episode_folder(options.out, seed) for seed in seeds}
        self._folders = {seed: RunFolder.prepare(path, force=force) for seed, path in paths.items()}
        self._dataset = bool(paths)
        try:
            if paths:
                require("h5py", "data")
        except MissingExtra as missing:
            # Reported once; everything else is written.
            tell(f"no dataset: {missing}", style="yellow")
            self._dataset = False

    def keep(self, done: Rollout, interrupted: bool) -> None:
        """Write one episode's files."""
        from executor.cli.execution import typed_command
        from executor.rollouts.run_record import RunRecord

        folder, options = self._folders.get(done.seed), self._options
        if folder is None:
            return
        command = typed_command("rollout", replace(options, seed=done.seed), "task", ("episodes", "workers"))
        record = RunRecord(self._graph, self._report, rollout=done, interrupted=interrupted, command=command)
        with folder.filling():
            ran = folder.write_rollout(record)
            if self._dataset:
                folder.write_episode(done, None)
            folder.write_report(ran, None)


def summary_of(results: list[EpisodeResult]) -> dict[str, Any]:
    """Return counts, the exact 95 % interval, the reasons of failures and times; interrupted episodes do not count."""
    from oag.measurements import clopper_pearson

    finished = [result for result in results if result.reason != "interrupted"]
    successes = sum(result.succeeded for result in finished)
    reasons = Counter(result.reason for result in finished if not result.succeeded)
    return {
        "episodes": [asdict(result) for result in sorted(results, key=lambda result: result.seed)],
        "trials": len(finished),
        "successes": successes,
        "success_rate": successes / len(finished) if finished else None,
        "interval_95": clopper_pearson(successes, len(finished)) if finished else None,
        "failures": dict(sorted(reasons.items())),
        "wall_s_mean": sum(r.wall_s for r in finished) / len(finished) if finished else None,
    }


def _line(result: EpisodeResult) -> str:
    words = "succeeded" if result.succeeded else f"{result.reason}: {result.message}"
    return f"seed {result.seed:4}  {result.wall_s:5.1f} s  {result.state_hash[:16]:16}  {words}"


def _run_one(request: dict[str, Any]) -> dict[str, Any]:
    """Run an episode in a worker process of `--workers`."""
    from executor.cli.execution import RolloutProgress

    out = None if request["out"] is None else Path(request["out"])
    same = {name: request[name] for name in ("seed", "open_numbers", "keep_sizes")}
    options = Options(Path(request["task"]), request["scene"], out=out, **same)
    graph = _graph_of(options)
    # The parent has made the folder already, and knows that its results may be replaced.
    keeper = _Keeper(graph, graph.verify(), options, force=True)
    (result,) = _run_here(graph, options, keeper, RolloutProgress(quiet=True))
    return dict(plain(asdict(result)))


if __name__ == "__main__":
    from executor.system.workers import serve

    serve(_run_one)
