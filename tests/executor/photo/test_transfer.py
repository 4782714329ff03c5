"""Plans of a reconstruction become plans of the true room, with its names and goal; what ended where is counted."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import pytest

import bddl
import llm
from executor.bench.photo.transfer import renamed, transfer_rows, units_of
from executor.scenes.pair import ScenePair
from executor.scenes.reading import load_scene
from oag import Scene, compose

QUERY = "put the glass into the refrigerator"


def called_otherwise(scene: Scene) -> tuple[Scene, dict[str, str]]:
    """Returns the same room with other ids, and what the true ones are."""
    names = {f"made_{number}": key for number, key in enumerate(scene.objects)}
    made = {key: new for new, key in names.items()}
    facts = tuple(re.sub(r"[a-z_0-9]+", lambda found: made.get(found[0], found[0]), str(fact)) for fact in scene.facts)
    objects = {made[key]: replace(thing, id=made[key]) for key, thing in scene.objects.items()}
    literals = tuple(bddl.parse_formula(fact) for fact in facts)
    return replace(scene, objects=objects, facts=literals), names


def test_a_plan_is_proved_under_the_names_of_the_true_room() -> None:
    true = load_scene("kitchen_t1")
    made, names = called_otherwise(true)
    pair = ScenePair("T1-1", "T1", QUERY, true, llm.propose(QUERY, true).task)
    task = renamed(llm.propose(QUERY, made).task, made, names, pair)
    assert [one.target for one in task.subtasks] == [one.target for one in pair.task.subtasks]
    assert task.goal == pair.task.goal and compose(task, scene=true).verify()


def test_a_plan_about_what_stands_for_nothing_is_none() -> None:
    true = load_scene("kitchen_t1")
    made, names = called_otherwise(true)
    pair = ScenePair("T1-1", "T1", QUERY, true, llm.propose(QUERY, true).task)
    missing = next(new for new, key in names.items() if key == pair.task.subtasks[0].target)
    with pytest.raises(KeyError, match=missing):
        renamed(llm.propose(QUERY, made).task, made, {k: v for k, v in names.items() if k != missing}, pair)


def test_pairs_are_of_households_and_of_long_tasks_by_turns() -> None:
    units = units_of(62000, 9)
    assert [unit.family for unit in units[1::2]] == ["T1", "T2", "T3", "T4"]
    assert {unit.family for unit in units[::2]} == {"household"} and len({unit.name for unit in units}) == 9
    assert units_of(62000, 9) == units


def unit(**changes: Any) -> Mapping[str, Any]:
    """A pair whose plan succeeded at once, with what is changed of it."""
    done = {"not_seen": [], "stage": "", "transferred": True, "evolved": True, "in_true_room": {"succeeded": True}}
    return {**done, **changes}


def test_the_table_tells_where_plans_ended() -> None:
    units = [
        unit(),
        unit(stage="execution", transferred=False),
        unit(stage="query", transferred=False, evolved=False, not_seen=["apple_0"]),
    ]
    rows = dict(transfer_rows(units))
    assert rows["all pairs: planned in the reconstruction"] == "33.3 % (1 of 3)"
    assert rows["all is seen: the same, with self-evolution"] == "100.0 % (2 of 2)"
    assert rows["all is seen, ended at: execution"] == "1" and "all is seen, ended at: query" not in rows
