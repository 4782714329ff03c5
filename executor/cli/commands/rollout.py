"""`scene2demo rollout`: executes a task file over seeds, and counts.

Returns 0 when every episode succeeded, 1 when one did not or the plan is not proved, 130 after Ctrl-C.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator

from bddl.visible import counted
from executor.cli.options.bad_option import BadOption
from executor.cli.options.inputs import check_seed
from executor.cli.options.running import Rollout as RolloutOptions
from executor.cli.terminal.errors import DONE, FAILED, INTERRUPTED
from executor.cli.terminal.output import print_json, say, tell, tell_notes
from executor.cli.terminal.progress import RolloutProgress
from executor.cli.terminal.refused import refuse
from executor.cli.work.episode_files import EpisodeKeeper
from executor.cli.work.episodes import EpisodeResult, graph_of, run_apart, run_here
from executor.machine.files import write_json
from executor.results.run_record import numbered
from oag import ObjectActionGraph, Report, clopper_pearson
from oag.task.sizes import resizings

Save = Callable[[list[EpisodeResult], bool], None]


def execute(options: RolloutOptions) -> int:
    """Runs the episodes, prints what came of them, and returns the exit code."""
    check_seed(options.seed, options.episodes)
    if options.workers < 1:
        raise BadOption("--workers", options.workers, "at least 1")
    graph = graph_of(options)
    report = graph.verify()
    if not report:
        return refuse(report, as_json=options.json)
    notes = tuple(_notes(graph))
    if not options.json:
        tell_notes(notes)
    head = {
        "task": graph.task.name,
        "scene": graph.scene.name,
        "verdict": report.verdict.value,
        "notes": list(notes),
    }

    def save(results: list[EpisodeResult], interrupted: bool) -> None:
        if options.out is not None:
            whole = {"interrupted": interrupted, **head, **summary_of(results)}
            write_json(options.out / "summary.json", whole)

    results, interrupted = _collect(graph, report, options, save)
    results.sort(key=lambda result: result.seed)
    summary = summary_of(results)
    good = not interrupted and summary["successes"] == options.episodes
    code = INTERRUPTED if interrupted else DONE if good else FAILED
    if options.json:
        print_json({"ok": good, "exit_code": code, "interrupted": interrupted, **head, **summary})
    else:
        _print(results, summary, options)
        if interrupted:
            tell("scene2demo: interrupted; finished episodes were kept", style="yellow")
    return code


def _notes(graph: ObjectActionGraph) -> Iterator[str]:
    """Yields what a reader of the counts has to know: sizes that were changed, and numbers that no seed changes."""
    yield from map(str, resizings(graph.task.scales, graph.scene))
    steps = numbered(graph.task)
    if steps:
        yield (
            f"numbers are written into {counted(len(steps), 'step')} ({', '.join(steps)}), and every seed runs these, "
            "such as those that `run` wrote for its own; --open-numbers leaves them to the planner"
        )


def summary_of(results: list[EpisodeResult]) -> dict[str, object]:
    """Returns counts, the exact 95 % interval, the reasons of failures and times; interrupted episodes do not count."""
    counted = [result for result in results if result.reason != "interrupted"]
    successes = sum(result.succeeded for result in counted)
    interval = clopper_pearson(successes, len(counted)) if counted else None
    reasons = Counter(result.reason for result in counted if not result.succeeded)
    return {
        "episodes": [result.to_json() for result in sorted(results, key=lambda result: result.seed)],
        "trials": len(counted),
        "successes": successes,
        "success_rate": successes / len(counted) if counted else None,
        "interval_95": interval,
        "failures": dict(sorted(reasons.items())),
        "wall_s_mean": sum(r.wall_s for r in counted) / len(counted) if counted else None,
    }


def _collect(
    graph: ObjectActionGraph, report: Report, options: RolloutOptions, save: Save
) -> tuple[list[EpisodeResult], bool]:
    """Returns the results so far and whether Ctrl-C ended them; they are saved after every episode."""
    keeper = EpisodeKeeper(graph, report, options, force=options.force)
    results: list[EpisodeResult] = []
    interrupted = False
    quiet = options.json or options.episodes > 1

    save(results, interrupted)
    try:
        with RolloutProgress(quiet=quiet) as progress:
            apart = options.workers > 1 and options.episodes > 1
            for result in run_apart(options) if apart else run_here(graph, options, keeper.keep, progress):
                results.append(result)
                save(results, interrupted)
                if options.episodes > 1 and not options.json:
                    tell(f"  {_line(result)}")
    except KeyboardInterrupt:
        interrupted = True
    finally:
        save(results, interrupted)
    return results, interrupted


def _line(result: EpisodeResult) -> str:
    words = "succeeded" if result.succeeded else f"{result.reason}: {result.message}"
    return f"seed {result.seed:4}  {result.wall_s:5.1f} s  {result.state_hash[:16]:16}  {words}"


def _print(results: Iterable[EpisodeResult], summary: dict[str, object], options: RolloutOptions) -> None:
    results = list(results)
    if options.episodes == 1:
        for result in results:
            say(_line(result), style="green" if result.succeeded else "red")
    interval, rate = summary["interval_95"], summary["success_rate"]
    if isinstance(interval, tuple) and isinstance(rate, float):
        say(
            f"{summary['successes']} of {summary['trials']} succeeded ({rate:.0%}; "
            f"95 % interval {interval[0]:.1%} to {interval[1]:.1%})"
        )
    failures = summary["failures"]
    if isinstance(failures, dict) and failures:
        say("failures: " + ", ".join(f"{count} {reason}" for reason, count in failures.items()))
    if isinstance(summary["wall_s_mean"], float):
        say(f"{summary['wall_s_mean']:.1f} s wall an episode")
    if options.out is not None:
        say(f"results in {options.out}")
