"""Episodes of one task over consecutive seeds: in this process, or in several that may crash one by one."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor, as_completed
from dataclasses import asdict, dataclass

from executor.cli.options import Rollout as RolloutOptions
from executor.cli.progress import RolloutProgress
from executor.execution import RolloutInterrupted, failure_of, rollout
from executor.records import Rollout
from oag import ObjectActionGraph

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
    """Yields the episodes' results as they come, each episode in a process of its own.

    Each is the command line with one seed, so that a crash in native code costs that episode only.
    """
    children: set[subprocess.Popen[str]] = set()
    threads = ThreadPoolExecutor(options.workers)
    try:
        futures: list[Future[EpisodeResult]] = [
            threads.submit(_child, options, seed, children)
            for seed in range(options.seed, options.seed + options.episodes)
        ]
        for future in as_completed(futures):
            yield future.result()
    finally:
        threads.shutdown(wait=False, cancel_futures=True)
        for child in list(children):
            child.kill()
            child.wait()


def _child(options: RolloutOptions, seed: int, children: set[subprocess.Popen[str]]) -> EpisodeResult:
    command = [sys.executable, "-m", "executor.cli.main", "rollout", str(options.task), "--scene", options.scene]
    command += ["--seed", str(seed), "--json"]
    if options.out is not None:
        command += ["--out", str(options.out), "--force"]
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "PYTHONPATH": os.pathsep.join(p for p in sys.path if p)}
    began = time.perf_counter()
    child = subprocess.Popen(
        command,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
        env=environment,
        start_new_session=True,
    )
    children.add(child)
    output, _ = child.communicate()
    children.discard(child)
    wall_s = time.perf_counter() - began
    try:
        answer = json.loads(output)
        if "error" in answer:
            return EpisodeResult(seed, False, answer["error"]["kind"], answer["error"]["message"], "", 0.0, wall_s)
        return EpisodeResult(**answer["episodes"][0])
    except (ValueError, KeyError, IndexError, TypeError):
        words = f"its process ended with status {child.returncode}"
        return EpisodeResult(seed, False, "crashed", words, "", 0.0, wall_s)


def _result(done: Rollout, wall_s: float, *, interrupted: bool = False) -> EpisodeResult:
    failure = None if interrupted or done.succeeded else failure_of(done)
    reason = "interrupted" if interrupted else failure.kind.value if failure else ""
    message = failure.message if failure else ""
    return EpisodeResult(
        done.seed, done.succeeded and not interrupted, reason, message, done.state_hash, done.simulated_s, wall_s
    )
