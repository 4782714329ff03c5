"""Plans of a reconstruction become plans of the true room, with its names and goal; what ended where is counted."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

import bddl
import llm
from executor.bench.photo import measure
from executor.bench.photo.measure import to_true_room, transfer_rows
from executor.bench.photo.rooms import DrawnRoom, drawn, each_once
from executor.scenes.file import load_scene
from executor.scenes.pair import ScenePair
from oag import ObjectActionGraph, Scene, compose

QUERY = "put the glass into the refrigerator"


class Rolled:
    """A rollout as far as it is asked about here."""

    def __init__(self, succeeded: bool) -> None:
        self.succeeded = succeeded


def executed(monkeypatch: pytest.MonkeyPatch, at_once: bool, evolved: bool, rehearsed: bool = True) -> dict[str, Any]:
    """Return what is told of a plan that succeeds at once or not, and after self-evolution or not."""
    true = load_scene("kitchen_t1")
    task = llm.propose(QUERY, true).task
    pair = ScenePair("T1-1", "T1", QUERY, true, task)
    story = SimpleNamespace(succeeded=evolved, revisions=2, rollout=Rolled(evolved))
    monkeypatch.setattr(measure, "rollout", lambda *given, **more: Rolled(at_once))
    monkeypatch.setattr(measure, "evolve", lambda *given, **more: story)
    monkeypatch.setattr(measure, "_outcome", lambda done: {"succeeded": done.succeeded, "failure": "slip: it fell"})
    return measure._executed(compose(task, scene=true), pair, 0, not rehearsed)


@pytest.mark.parametrize("evolved", [True, False])
def test_a_plan_that_fails_in_the_true_room_is_revised_there(monkeypatch: pytest.MonkeyPatch, evolved: bool) -> None:
    told = executed(monkeypatch, at_once=False, evolved=evolved)
    assert (told["transferred"], told["evolved"], told["revisions"]) == (False, evolved, 2)
    assert (told["stage"], told["why"]) == ("execution", "slip: it fell")


def test_a_plan_that_was_revised_in_its_rehearsal_counts_as_evolved_only(monkeypatch: pytest.MonkeyPatch) -> None:
    told = executed(monkeypatch, at_once=True, evolved=False, rehearsed=False)
    assert (told["transferred"], told["evolved"]) == (False, True)
    assert executed(monkeypatch, at_once=True, evolved=False)["transferred"]


def test_a_plan_that_is_refuted_in_the_true_room_takes_the_proved_fix(monkeypatch: pytest.MonkeyPatch) -> None:
    true = load_scene("kitchen_t1")
    right = llm.propose(QUERY, true).task
    elsewhere = bddl.parse_formula("(ontop glass_0 refrigerator_0)")
    picked = replace(right.subtasks[1], init=elsewhere, support_init="refrigerator_0")
    wrong = replace(right, subtasks=(right.subtasks[0], picked, *right.subtasks[2:]))
    proved: list[bool] = []

    def evolve(graph: ObjectActionGraph, *given: Any, **more: Any) -> SimpleNamespace:
        proved.append(bool(graph.verify()))
        return SimpleNamespace(succeeded=True, revisions=0)

    monkeypatch.setattr(measure, "evolve", evolve)
    told = measure._executed(compose(wrong, scene=true), ScenePair("T1-1", "T1", QUERY, true, right), 0, False)
    assert proved == [True] and "table_0" in told["fix"]
    assert (told["stage"], told["transferred"], told["evolved"], told["revisions"]) == ("true plan", False, True, 1)


def called_otherwise(scene: Scene) -> tuple[Scene, dict[str, str]]:
    """Return the same room with other ids, and what the true ones are."""
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
    task = to_true_room(llm.propose(QUERY, made).task, made, names, pair)
    assert [one.target for one in task.subtasks] == [one.target for one in pair.task.subtasks]
    assert task.goal == pair.task.goal and compose(task, scene=true).verify()


def test_a_plan_about_what_stands_for_nothing_is_none() -> None:
    true = load_scene("kitchen_t1")
    made, names = called_otherwise(true)
    pair = ScenePair("T1-1", "T1", QUERY, true, llm.propose(QUERY, true).task)
    missing = next(new for new, key in names.items() if key == pair.task.subtasks[0].target)
    with pytest.raises(KeyError, match=missing):
        to_true_room(llm.propose(QUERY, made).task, made, {k: v for k, v in names.items() if k != missing}, pair)


def test_rooms_are_of_households_and_of_kitchens_by_turns_and_of_other_seeds_beyond_the_first() -> None:
    rooms = drawn(62000, 5, 4)
    assert [room.family for room in rooms[1:8:2]] == ["T1", "T2", "T3", "T4"]
    assert {room.family for room in [*rooms[:8:2], rooms[8]]} == {"household"}
    assert len({room.name for room in rooms}) == 9 and len({room.entropy for room in rooms}) == 9
    assert drawn(62000, 5, 4) == rooms and rooms[::2] == drawn(62000, 6, 0)[:5]
    assert [room.seed for room in drawn(62000, 204, 0)].count(62001) == 102


def test_what_is_measured_is_kept_and_only_the_rest_is_measured(tmp_path: Path) -> None:
    told: list[Any] = []

    def measured(room: DrawnRoom) -> dict[str, Any]:
        if room.family == "T2":
            raise KeyboardInterrupt
        return {"room": room.name}

    rooms = drawn(62000, 2, 2)
    with pytest.raises(KeyboardInterrupt):
        list(each_once(tmp_path, "room-B", rooms, measured, told.append))
    assert len(told) == 3
    again = each_once(tmp_path, "room-B", rooms, lambda room: {"room": room.name, "anew": True}, told.append)
    assert ["anew" in result for result in again] == [False, False, False, True]


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
    assert rows["all is seen: the same, with self-evolution and proved fixes"] == "100.0 % (2 of 2)"
    assert rows["all is seen, ended at: execution"] == "1" and "all is seen, ended at: query" not in rows
