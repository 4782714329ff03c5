"""The paper's initial flows with faults, before and after self-evolution: a resumable run over tasks, faults and seeds.

    python -m benchmarks.evolution --out build/evolution --seeds 16000-16004 [--tasks T1 T3] [--faults none pose]
    python -m benchmarks.evolution --out build/evolution --table

One line of `results.jsonl` is one episode. An episode up to its first revision is what would have happened without
evolution, so that one run gives both columns. Numbers are the paper's as printed; the scene is varied by the seed.
With --memory corrections that helped are remembered over the seeds of a cell, which then depend on each other.
"""

from __future__ import annotations

import argparse
import json
import time
from collections import Counter
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from executor.evolution import evolve
from executor.faults import BlockedDoor, Fault, NavigationOffset, PoseError, WeakGrip, WrongScale
from executor.scenes import library
from llm.evolution import SearchSupervisor, Supervisor
from llm.memory.folder import SkillMemory
from llm.memory.supervisor import RememberingSupervisor
from oag import Scene, Task, clopper_pearson, compose

DATA = Path(__file__).resolve().parent.parent / "tests" / "data"
SCENES = {"T1": "kitchen_t1", "T2": "kitchen_t2", "T3": "kitchen_t3", "T4": "kitchen_t4"}
FAULTS = ("none", "pose", "scale", "navigation", "door", "grip")
POSE_M, NAVIGATION_M, SCALE, DOOR_FRACTION, GRIP_N = 0.02, 0.12, 0.8, 0.6, 5.0
# Source: the paper's main table, in percent: primitive-only, and with self-evolution.
PAPER = {"T1": (0, 40), "T2": (0, 30), "T3": (40, 70), "T4": (0, 70)}


def task_of(name: str) -> tuple[Task, Scene]:
    """Returns one of the paper's tasks with its initial flows as printed, and its scene."""
    scene = library.load(SCENES[name])
    text = (DATA / f"{name}.json").read_text(encoding="utf-8")
    return Task.from_json(json.loads(text), scene=scene), scene


def faults_of(kind: str, task: Task, seed: int) -> tuple[Fault, ...] | None:
    """Returns what is wrong in an episode, None where a task has nothing that the fault could be about."""
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
        "grip": (PoseError.drawn(item, POSE_M, seed), WeakGrip(GRIP_N)),
    }
    return made[kind]


def episode(name: str, kind: str, seed: int, limit: int, memory: SkillMemory | None) -> dict[str, Any] | None:
    """Returns what came of one episode, None for a cell that does not exist."""
    task, scene = task_of(name)
    faults = faults_of(kind, task, seed)
    if faults is None:
        return None
    supervisor: Supervisor = SearchSupervisor()
    if memory is not None:
        supervisor = RememberingSupervisor(memory, supervisor)
    began = time.perf_counter()
    told = evolve(compose(task, scene=scene), scene, seed, supervisor=supervisor, limit=limit, faults=faults)
    if memory is not None:
        memory.learn(told.original, told.rollout.scene, [story.history for story in told.stories])
    last = told.stories[-1]
    return {
        "task": name,
        "fault": kind,
        "seed": seed,
        "memory": memory is not None,
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


def cells(tasks: Iterable[str], faults: Iterable[str]) -> Iterator[tuple[str, str]]:
    """Yields the tasks with the faults, tasks that have no scene left out."""
    known = library.names()
    for name in tasks:
        if SCENES[name] in known:
            yield from ((name, kind) for kind in faults)
        else:
            print(f"{name}: there is no scene {SCENES[name]}", flush=True)


def read(path: Path) -> list[dict[str, Any]]:
    """Returns the episodes that a results file has; a last line that was cut off is left out."""
    if not path.exists():
        return []
    found = []
    for line in path.read_text(encoding="utf-8").splitlines():
        try:
            found.append(json.loads(line))
        except ValueError:
            continue
    return found


def table(results: list[dict[str, Any]]) -> Iterator[str]:
    """Yields the table of all cells, and of each task over its faults beside the paper's row."""
    yield f"{'task':4} {'fault':10} {'memory':6} {'n':>4}  {'before':24} {'after':24} mean revisions where evolved"
    keys = sorted(
        {(r["task"], r["memory"], r["fault"]) for r in results}, key=lambda k: (k[0], k[1], FAULTS.index(k[2]))
    )
    for task, memory, fault in keys:
        yield _row(
            task, fault, memory, [r for r in results if (r["task"], r["memory"], r["fault"]) == (task, memory, fault)]
        )
    for task, memory in sorted({(r["task"], r["memory"]) for r in results}):
        chosen = [r for r in results if (r["task"], r["memory"]) == (task, memory)]
        before, after = PAPER[task]
        yield _row(task, "all", memory, chosen) + f"   paper: {before} % -> {after} %"
    reasons = Counter((r["task"], r["fault"], (r["gave_up"] or {}).get("cause", "")) for r in results if not r["after"])
    for (task, fault, cause), count in sorted(reasons.items()):
        yield f"not solved: {task} {fault}: {count} x {cause or 'no cause found'}"


def _row(task: str, fault: str, memory: bool, chosen: list[dict[str, Any]]) -> str:
    evolved = [r["revisions"] for r in chosen if r["after"] and r["revisions"]]
    mean = f"{sum(evolved) / len(evolved):.2f}" if evolved else "-"
    shares = " ".join(f"{_share([r[key] for r in chosen]):24}" for key in ("before", "after"))
    return f"{task:4} {fault:10} {'yes' if memory else 'no':6} {len(chosen):4}  {shares} {mean}"


def _share(outcomes: list[bool]) -> str:
    low, high = clopper_pearson(sum(outcomes), len(outcomes))
    return f"{sum(outcomes)}/{len(outcomes)} [{100 * low:.0f}, {100 * high:.0f}] %"


def _seeds(text: str) -> range:
    first, _, last = text.partition("-")
    return range(int(first), int(last or first) + 1)


def main() -> None:
    """Runs what the results lack, and prints the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--seeds", type=_seeds, default=range(0), help="such as 16000-16004")
    parser.add_argument("--tasks", nargs="+", choices=sorted(SCENES), default=sorted(SCENES))
    parser.add_argument("--faults", nargs="+", choices=FAULTS, default=list(FAULTS))
    parser.add_argument("--limit", type=int, default=5)
    parser.add_argument("--memory", action="store_true")
    parser.add_argument("--table", action="store_true", help="run nothing")
    chosen = parser.parse_args()
    chosen.out.mkdir(parents=True, exist_ok=True)
    path = chosen.out / "results.jsonl"
    done = {(r["task"], r["fault"], r["seed"], r["memory"]) for r in read(path)}
    for name, kind in () if chosen.table else cells(chosen.tasks, chosen.faults):
        memory = SkillMemory(chosen.out / "memory" / name / kind) if chosen.memory else None
        for seed in chosen.seeds:
            if (name, kind, seed, chosen.memory) in done:
                continue
            found = episode(name, kind, seed, chosen.limit, memory)
            if found is None:
                break
            with path.open("a", encoding="utf-8") as file:
                file.write(json.dumps(found, sort_keys=True) + "\n")
            word = "at once" if found["before"] else "evolved" if found["after"] else "failed"
            print(f"{name} {kind} {seed}: {word}, {found['revisions']} revisions, {found['wall_s']} s", flush=True)
    print("\n".join(table(read(path))))


if __name__ == "__main__":
    main()
