"""Episodes of one task over consecutive seeds: in this process, or in several that may crash one by one."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass

from executor.cli.options.inputs import task_to_run
from executor.cli.options.running import Rollout as RolloutOptions
from executor.cli.terminal.progress import RolloutProgress
from executor.machine.workers.pool import WorkerPool
from executor.records.rollout import Rollout, RolloutInterrupted
from executor.results.run_record import opened
from executor.rollouts.running import failure_of, rollout
from oag import ObjectActionGraph, compose

WORKER = "executor.cli.work.rollout_worker"

# Takes what was done, and whether Ctrl-C ended it.
Keep = Callable[[Rollout, bool], None]


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

    def to_json(self) -> dict[str, object]:
        """Returns the result as plain data."""
        return asdict(self)


def graph_of(options: RolloutOptions) -> ObjectActionGraph:
    """Returns what the episodes execute: the composed task, its numbers left open where that was asked for.

    Raises:
        TaskError, SceneError, SceneNotFound, BadOption: As for `task_to_run`.
    """
    task, scene = task_to_run(options.task, options.scene)
    return compose(opened(task) if options.open_numbers else task, scene=scene)


def run_here(
    graph: ObjectActionGraph, options: RolloutOptions, keep: Keep, progress: RolloutProgress
) -> Iterator[EpisodeResult]:
    """Yields the episodes' results in order, run one after the other in this process.

    Raises:
        KeyboardInterrupt: After the interrupted episode's result was yielded and its files were kept.
    """
    for seed in range(options.seed, options.seed + options.episodes):
        began = time.perf_counter()
        try:
            done = rollout(graph, graph.scene, seed, listen=progress)
        except RolloutInterrupted as stop:
            yield _result(stop.partial, time.perf_counter() - began, interrupted=True)
            keep(stop.partial, True)
            raise
        wall_s = time.perf_counter() - began
        # The result comes first: it counts even when keeping the files fails.
        yield _result(done, wall_s)
        keep(done, False)


def run_apart(options: RolloutOptions) -> Iterator[EpisodeResult]:
    """Yields the episodes' results as they come, from worker processes: a crash in native code costs one episode.

    Raises:
        WorkersUnusable: No worker process can be started.
    """
    pool = WorkerPool(WORKER, options.workers)
    words = {
        "task": str(options.task),
        "scene": options.scene,
        "open_numbers": options.open_numbers,
        "out": None if options.out is None else str(options.out),
    }
    seeds = range(options.seed, options.seed + options.episodes)
    for outcome in pool.run([{**words, "seed": seed} for seed in seeds]):
        if outcome.ending == "finished":
            yield EpisodeResult(**outcome.answer)
        else:
            reason = outcome.answer.get("kind", outcome.ending)
            message = outcome.answer.get("error", outcome.message)
            yield EpisodeResult(outcome.request["seed"], False, reason, message, "", 0.0, outcome.wall_s)


def _result(done: Rollout, wall_s: float, *, interrupted: bool = False) -> EpisodeResult:
    failure = None if interrupted or done.succeeded else failure_of(done)
    reason = "interrupted" if interrupted else failure.kind.value if failure else ""
    message = failure.message if failure else ""
    return EpisodeResult(
        done.seed, done.succeeded and not interrupted, reason, message, done.state_hash, done.simulated_s, wall_s
    )
