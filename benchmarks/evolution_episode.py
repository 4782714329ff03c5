"""One episode of the benchmark of self-evolution, and a process that runs such episodes one after the other.

A task of the paper with its initial flows as printed, a fault, a seed: `python -m benchmarks.evolution_episode` serves
requests with these as JSON lines.
"""

from __future__ import annotations

import json
import time
from pathlib import Path
from typing import Any

from executor.rollouts.evolve import evolve
from executor.rollouts.rollout import RunConditions
from executor.scenes import library
from executor.sim.faults import BlockedDoor, Fault, NavigationOffset, PoseError, WeakGrip, WrongScale
from executor.system.workers import serve
from oag import Scene, Task, compose

DATA = Path(__file__).resolve().parent.parent / "tests" / "data"
SCENES = {"T1": "kitchen_t1", "T2": "kitchen_t2", "T3": "kitchen_t3", "T4": "kitchen_t4"}
FAULTS = ("none", "pose", "scale", "navigation", "door", "grip")
POSE_M, NAVIGATION_M, SCALE, DOOR_FRACTION = 0.02, 0.12, 0.8, 0.6
GRIP_N, GRIP_AT_DOORS_N = 5.0, 15.0
"""A sixth of a sound grip, and half of it where there is a door: less opens no refrigerator, whatever the flow."""


def task_of(name: str) -> tuple[Task, Scene]:
    """Return one of the paper's tasks with its initial flows as printed, and its scene."""
    scene = library.load(SCENES[name])
    text = (DATA / f"{name}.json").read_text(encoding="utf-8")
    return Task.from_json(json.loads(text), scene=scene), scene


def faults_of(kind: str, task: Task, seed: int) -> tuple[Fault, ...] | None:
    """Return what is wrong in an episode, None where a task has nothing that the fault could be about."""
    item = next(subtask.target for subtask in task.subtasks if subtask.support_init is not None)
    doors = [subtask.target for subtask in task.subtasks if subtask.target != item]
    if kind == "door":
        return (BlockedDoor(doors[0], DOOR_FRACTION),) if doors else None
    made: dict[str, tuple[Fault, ...]] = {
        "none": (),
        "pose": (PoseError.drawn(item, POSE_M, seed),),
        "scale": (WrongScale(item, SCALE),),
        "navigation": (NavigationOffset.drawn(NAVIGATION_M, seed),),
        # A weak grip alone holds what it takes in the middle: it shows with what was taken beside it.
        "grip": (PoseError.drawn(item, POSE_M, seed), WeakGrip(GRIP_AT_DOORS_N if doors else GRIP_N)),
    }
    return made[kind]


def episode(name: str, kind: str, seed: int, limit: int) -> dict[str, Any]:
    """Return what came of one episode.

    Args:
        name: "T1" to "T4".
        kind: One of `FAULTS`.
        seed: Seeds the scene's variation, all planning, and the fault's direction.
        limit: How many revisions a subtask may have.

    Raises:
        ValueError: The task has nothing that the fault could be about.
    """
    task, scene = task_of(name)
    faults = faults_of(kind, task, seed)
    if faults is None:
        raise ValueError(f"{name} has nothing that the fault {kind} could be about")
    began = time.perf_counter()
    told = evolve(
        compose(task, scene=scene),
        scene,
        seed,
        limit=limit,
        conditions=RunConditions(faults=faults),
    )
    last = told.stories[-1]
    return {
        "task": name,
        "fault": kind,
        "seed": seed,
        "before": told.succeeded_at_once,
        "after": told.succeeded,
        "revisions": told.revisions,
        "attempts": [len(story.records) for story in told.stories],
        "causes": [revision.cause for story in told.stories for revision in story.history.revisions],
        "failed_subtask": None if told.succeeded else last.history.subtask,
        "gave_up": None if last.gave_up is None else last.gave_up.to_json(),
        "state_hash": told.rollout.state_hash,
        "wall_s": round(time.perf_counter() - began, 1),
    }


def has_episodes(name: str, kind: str) -> bool:
    """Decide whether a task has anything that a fault could be about."""
    return faults_of(kind, task_of(name)[0], 0) is not None


def main() -> None:
    """Serves requests until standard input ends."""
    # One thread each: two processes on two cores are faster than two that fight over them, and sums stay equal.
    import torch

    torch.set_num_threads(1)

    def handle(request: dict[str, Any]) -> dict[str, Any]:
        return episode(request["task"], request["fault"], request["seed"], request["limit"])

    serve(handle)


if __name__ == "__main__":
    main()
