"""The benchmark of self-evolution: which episodes are left to run, and what its tables say."""

from __future__ import annotations

import json
from argparse import Namespace
from pathlib import Path
from typing import Any

from benchmarks.evolution import read, requests
from benchmarks.evolution_episode import faults_of, has_episodes, task_of
from benchmarks.evolution_table import tables
from executor.sim.faults import BlockedDoor, PoseError, WeakGrip


def asked(tmp_path: Path, **changes: Any) -> Namespace:
    """Return a command line's choices."""
    given = {
        "out": tmp_path,
        "tasks": ["T1", "T3"],
        "faults": ["pose", "door"],
        "seeds": range(10, 12),
        "limit": 5,
    }
    return Namespace(**(given | changes))


def done(task: str = "T1", fault: str = "pose", seed: int = 10, **changes: Any) -> dict[str, Any]:
    """Return a result."""
    fields = {
        "task": task,
        "fault": fault,
        "seed": seed,
        "before": False,
        "after": True,
        "revisions": 2,
        "gave_up": None,
    }
    return fields | changes


def cells(found: list[dict[str, Any]]) -> list[tuple[str, str, int]]:
    return [(r["task"], r["fault"], r["seed"]) for r in found]


def test_cells_without_a_door_have_no_fault_of_a_door(tmp_path: Path) -> None:
    together = cells(requests(asked(tmp_path), []))
    of_a_seed = [("T1", "pose"), ("T1", "door"), ("T3", "pose")]
    assert together == [(task, fault, seed) for seed in (10, 11) for task, fault in of_a_seed]


def test_what_is_done_is_not_run_again(tmp_path: Path) -> None:
    left = requests(asked(tmp_path, tasks=["T1"], faults=["pose"]), [done(seed=10)])
    assert cells(left) == [("T1", "pose", 11)]


def test_a_line_that_was_cut_off_is_an_episode_to_run_again(tmp_path: Path) -> None:
    path = tmp_path / "results.jsonl"
    assert read(path) == []
    path.write_text(json.dumps(done()) + "\n" + json.dumps(done(seed=11))[:30], encoding="utf-8")
    assert read(path) == [done()]


def test_every_fault_is_about_the_item_or_the_door_of_its_task() -> None:
    task, _ = task_of("T1")
    assert faults_of("none", task, 1) == ()
    assert faults_of("door", task, 1) == (BlockedDoor("refrigerator_0", 0.6),)
    pose, grip = faults_of("grip", task, 1) or ()
    assert isinstance(pose, PoseError) and pose.object_id == "glass_0" and grip == WeakGrip(15.0)
    _, without_a_door = faults_of("grip", task_of("T4")[0], 1) or ()
    assert without_a_door == WeakGrip(5.0)
    assert has_episodes("T2", "door") and not has_episodes("T3", "door")


def test_the_tables_have_the_papers_rows_exact_intervals() -> None:
    results = [
        done(seed=1),
        done(seed=2, revisions=1),
        done(seed=3, before=True, revisions=0),
        done(seed=4, after=False, revisions=5, gave_up={"cause": "the grip was lost", "needed": "stronger fingers"}),
        done("T3", "none", after=False, gave_up={"cause": "", "needed": ""}),
    ]
    told = list(tables(results))
    assert told[0] == "| task | paper | n | primitive-only | with evolution | revisions |"
    assert told[2] == (
        "| T1 | 0 % to 40 % | 4 | 25 %, 1 of 4 [1, 81] | 75 %, 3 of 4 [19, 99] | 1.00; 1.50 where any (2) |"
    )
    assert told[3] == "| T3 | 40 % to 70 % | 1 | 0 %, 0 of 1 [0, 98] | 0 %, 0 of 1 [0, 98] | - |"
    assert told[5].startswith("| fault | n | primitive-only |")
    assert [line.split(" | ")[0] for line in told[7:9]] == ["| none", "| pose"]
    assert told[-2:] == [
        "not solved: T1 pose: 1 x the grip was lost; no flow corrects it, it would take stronger fingers",
        "not solved: T3 none: 1 x no cause found",
    ]


def test_no_episodes_are_no_error() -> None:
    assert list(tables([])) == ["no episodes yet"]
    told = list(tables([done()]))
    assert sum(line.startswith("| T1") for line in told) == 2
