"""Decompositions with one mistake: every kind is made, nothing else changes, and checking refuses or repairs them."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

from benchmarks.baselines.methods import (
    MISTAKES,
    prepare_mistaken,
    run_baseline,
    run_checked,
    run_repaired,
    with_mistake,
)
from executor.bench.units import BenchSetting, Unit
from executor.records import PlanRefused
from executor.scenes.pair import ScenePair
from oag import Scene, Task, compose

DATA = Path(__file__).resolve().parents[2] / "data"
SCENE = Scene.from_json(json.loads((DATA / "T1_scene.json").read_text()))
TASK = Task.from_json(json.loads((DATA / "T1.json").read_text()), scene=SCENE)
PICK = Unit("T6", 62000, 2, BenchSetting(baseline="unchecked"))
"""Its plan lacks CONVERGE: nothing else could bring the hand to the apple."""


def test_every_kind_of_mistake_is_made_and_leaves_the_rest_alone() -> None:
    made = {kind: task for kind, task in (with_mistake(TASK, SCENE, f"seed {n}") for n in range(60))}
    assert set(made) == set(MISTAKES)
    for task in made.values():
        assert task.goal == TASK.goal and task.subtasks != TASK.subtasks
        same = sum(subtask in TASK.subtasks for subtask in task.subtasks)
        assert same >= len(TASK.subtasks) - 1
    assert len(made["dropped subtask"].subtasks) == len(TASK.subtasks) - 1
    assert sorted(s.name for s in made["wrong order"].subtasks) == sorted(s.name for s in TASK.subtasks)


def test_a_mistake_follows_from_its_seed() -> None:
    assert with_mistake(TASK, SCENE, "a seed") == with_mistake(TASK, SCENE, "a seed")
    assert len({with_mistake(TASK, SCENE, f"seed {n}")[0] for n in range(20)}) > 2


def test_a_task_of_one_subtask_gets_no_mistake_that_needs_two() -> None:
    short = replace(TASK, subtasks=TASK.subtasks[:1])
    kinds = {with_mistake(short, SCENE, f"seed {n}")[0] for n in range(40)}
    assert not kinds & {"dropped subtask", "wrong order"} and "dropped step" in kinds


def test_what_is_refuted_is_not_executed_without_its_fix(monkeypatch: pytest.MonkeyPatch) -> None:
    broken = replace(TASK, subtasks=TASK.subtasks[:-1])  # The refrigerator stays open.
    pair = ScenePair("T1-1", "T1", "put the glass into the refrigerator", SCENE, TASK)
    unit = Unit("T1", 1, None, BenchSetting(baseline="repaired"))
    graph = compose(broken, scene=SCENE)
    with pytest.raises(PlanRefused):
        run_checked(unit, pair, graph)
    run: list[Task] = []
    monkeypatch.setattr("benchmarks.baselines.methods.rollout", lambda graph, *rest, **options: run.append(graph.task))
    run_repaired(unit, pair, graph)
    (task,) = run
    assert compose(task, scene=SCENE).verify() and len(task.subtasks) == len(TASK.subtasks)


@pytest.mark.slow
def test_unchecked_it_moves_and_fails_checked_it_stays_still_and_repaired_it_succeeds() -> None:
    assert prepare_mistaken(PICK)[0] == "dropped step"
    results = {
        name: run_baseline(replace(PICK, setting=BenchSetting(baseline=name)))
        for name in ("unchecked", "checked", "repaired")
    }
    assert {name: result["ended"] for name, result in results.items()} == {
        "unchecked": "failed",
        "checked": "failed",
        "repaired": "succeeded",
    }
    assert results["unchecked"]["simulated_s"] > 1.0
    assert results["checked"]["failure"]["kind"] == "plan-refused" and "simulated_s" not in results["checked"]
    assert {result["mistake"] for result in results.values()} == {"dropped step"}
