"""Corrections that are put in before anything fails: which ones, of which flows, and how they are judged afterwards."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

import oag
from llm.memory import SkillMemory, foresee
from llm.memory_notes import Note
from oag.model.actions import flow_from_json, flow_to_json
from oag.revision import Attempt, History, Revision
from tests.llm.evolve.attempts import failed, situation
from tests.llm.memory.notes import AJAR, CLOSED, TWICE, note, trial

SITUATION = situation("T1", 3, failed(flow_from_json(AJAR), 4, measurements={}))
SCENE = SITUATION.scene
CATEGORY = SCENE["refrigerator_0"].category


def ajar_task() -> oag.Task:
    """Return T1 with the flow that leaves the refrigerator ajar."""
    task = SITUATION.task
    subtask = replace(task.subtasks[3], flow=flow_from_json(AJAR))
    return replace(task, subtasks=(*task.subtasks[:3], subtask))


def proven(**changes: Any) -> Note:
    return note(**({"target": CATEGORY, "evidence": TWICE} | changes))


def test_a_proven_correction_of_the_same_flow_is_put_in() -> None:
    known = proven()
    found = foresee([known], ajar_task(), SCENE)
    assert found.notes == {3: known.name}
    assert flow_to_json(found.task.subtasks[3].flow or ()) == CLOSED
    assert found.task.subtasks[:3] == ajar_task().subtasks[:3]
    assert oag.compose(found.task, scene=SCENE).verify()


@pytest.mark.parametrize(
    "other",
    [
        proven(evidence=TWICE[:1]),
        proven(evidence=(*TWICE, trial("T1", 17002, "failed", 1))),
        proven(before=[17, 1, 2, 3, {"19": [0.0, 0.4]}, 5]),
        proven(target="microwave"),
        proven(support="breakfast_table"),
        proven(kind="open"),
        proven(after=[17, 1, 2, 5]),
    ],
    ids=["once", "failed", "another flow", "target", "support", "kind", "not proved"],
)
def test_anything_else_is_left_out(other: Note) -> None:
    task = ajar_task()
    found = foresee([other], task, SCENE)
    assert found.notes == {} and found.task == task


def test_of_two_the_one_that_helped_more_often_is_put_in() -> None:
    often = proven(after=[*CLOSED, 6], evidence=(*TWICE, trial("T1", 17002, "succeeded", 1)))
    assert foresee([proven(), often], ajar_task(), SCENE).notes == {3: often.name}


@pytest.mark.parametrize("outcome", ["succeeded", "failed"])
def test_how_it_fared_is_noted(tmp_path: Path, outcome: Any) -> None:
    memory = SkillMemory(tmp_path)
    closing = flow_from_json(CLOSED)
    for seed in (1, 2):
        revision = Revision(closing, "parameters", "closed it further", "limits", 4)
        attempt = failed(flow_from_json(AJAR), 4, measurements={"fraction_reached": 0.35})
        history = History(3).add(replace(attempt, seed=seed), revision)
        memory.learn(ajar_task(), SCENE, [history.add(Attempt(closing, "succeeded", seed=seed))])
    found = memory.foresee(ajar_task(), SCENE)
    (name,) = found.notes.values()
    history = History(3).add(Attempt(closing, outcome, seed=3))
    assert memory.learn(found.task, SCENE, [history], found) == (name,)
    (kept,) = SkillMemory(tmp_path).notes
    assert [(entry.seed, entry.outcome, entry.revisions) for entry in kept.evidence][2:] == [(3, outcome, 0)]
    assert bool(memory.foresee(ajar_task(), SCENE).notes) is (outcome == "succeeded")
