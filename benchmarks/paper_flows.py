"""Runs every action flow that the paper prints, initial and evolved, exactly as written, and says what came out.

    python -m benchmarks.paper_flows [--tasks T1 T3] [--seeds 16000 16001]

Each flow starts from where the task's subtasks before it end; these run with open numbers, so that a flow is judged by
itself. The reading is the same as in a rollout: the subtask's regressed goal, by the detectors.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from executor.rollouts.checkpoint import Checkpoint
from executor.rollouts.rollout import Run
from executor.scenes import library
from executor.scenes.vary import vary
from llm import propose
from oag import ObjectActionGraph, Scene, Task, compose
from oag.model.actions import flow_from_json

DATA = Path(__file__).resolve().parent.parent / "tests" / "data"
SCENES = {"T1": "kitchen_t1", "T2": "kitchen_t2", "T3": "kitchen_t3", "T4": "kitchen_t4"}


@dataclass(frozen=True, slots=True)
class Printed:
    """One flow of the paper's tables or raw outputs, and what came of it.

    Attributes:
        task: "T1" to "T4".
        subtask: Index, from 0.
        iteration: As the paper counts: 0 is the initial flow.
        flow: As printed.
        verdict: What `verify` says of the task with this flow in it.
        succeeded: Whether the subtask's regressed goal was reached; None when it was not run.
        message: What ended it, or why it was not run.
        failed_step: The step that failed, from 0; None when none did.
    """

    task: str
    subtask: int
    iteration: int
    flow: list[Any]
    verdict: str
    succeeded: bool | None
    message: str = ""
    failed_step: int | None = None


def printed(task: str) -> list[dict[str, Any]]:
    """Return the flows that the paper prints for a task."""
    found: list[dict[str, Any]] = json.loads((DATA / "paper_evolution.json").read_text(encoding="utf-8"))[task]
    return found


def with_flow(task: Task, subtask: int, flow: list[Any] | None) -> Task:
    """Return the task with another flow of one subtask."""
    changed = replace(task.subtasks[subtask], flow=None if flow is None else flow_from_json(flow))
    return replace(task, subtasks=(*task.subtasks[:subtask], changed, *task.subtasks[subtask + 1 :]))


def open_task(task: Task, scene: Scene, query: str) -> Task:
    """Return the paper's task with the offline planner's flows, whose numbers are open."""
    planned = propose(query, scene).task
    flows = {(s.target, str(s.goal)): s.flow for s in planned.subtasks}
    subtasks = tuple(replace(s, flow=flows.get((s.target, str(s.goal)), s.flow)) for s in task.subtasks)
    return replace(task, subtasks=subtasks)


QUERIES = {
    "T1": "put the glass into the refrigerator",
    "T2": "put the apple into the refrigerator",
    "T3": "put the apple into the bowl",
    "T4": "put the glass on the table",
}


def outcomes(name: str, seed: int) -> Iterator[Printed]:
    """Yield what comes of every printed flow of a task in its scene, varied by a seed."""
    scene = library.load(SCENES[name])
    task = Task.from_json(json.loads((DATA / f"{name}.json").read_text(encoding="utf-8")), scene=scene)
    base = open_task(task, scene, QUERIES[name])
    concrete = vary(scene.with_scales(task.scales), seed)
    run = Run(compose(base, scene=scene), concrete, seed)
    starts: list[Checkpoint | None] = [run.begin()]
    try:
        for index in range(len(base.subtasks)):
            start = starts[index]
            if start is None:
                starts.append(None)
                continue
            record, after = run.subtask(index, start)
            starts.append(after if record.succeeded else None)
        for entry in printed(name):
            yield _outcome(run, base, scene, name, entry, starts[entry["subtask"]])
    finally:
        run.close()


def _outcome(run: Run, base: Task, scene: Scene, name: str, entry: dict[str, Any], start: Checkpoint | None) -> Printed:
    graph: ObjectActionGraph = compose(with_flow(base, entry["subtask"], entry["flow"]), scene=scene)
    report = graph.verify()
    head = (name, entry["subtask"], entry["iteration"], entry["flow"], report.verdict.value)
    if not report:
        return Printed(*head, None, str(report.errors[0]) if report.errors else "not proved")
    if start is None:
        return Printed(*head, None, "the subtasks before it failed")
    run.change(graph)
    record, _ = run.subtask(entry["subtask"], start)
    failure = record.failure
    unfinished = failure is not None and failure.kind.value != "goal-not-reached"
    message = f"{failure.kind.value}: {failure.message}" if failure else ""
    return Printed(*head, record.succeeded, message, len(record.steps) - 1 if unfinished else None)


def main() -> None:
    """Print one line a flow and seed, and the counts."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--tasks", nargs="+", choices=sorted(SCENES), default=sorted(SCENES))
    parser.add_argument("--seeds", nargs="+", type=int, default=[16000])
    chosen = parser.parse_args()
    for name in chosen.tasks:
        if SCENES[name] not in library.names():
            print(f"{name}: there is no scene {SCENES[name]}", flush=True)
            continue
        for seed in chosen.seeds:
            for found in outcomes(name, seed):
                word = {True: "succeeded", False: "failed", None: "not run"}[found.succeeded]
                flow = json.dumps(found.flow)
                where = "" if found.failed_step is None else f" (step {found.failed_step + 1})"
                place = f"{name}.{found.subtask + 1} iteration {found.iteration}"
                print(f"{place} seed {seed} {found.verdict} {word}{where} {flow} {found.message}", flush=True)


if __name__ == "__main__":
    main()
