"""A task's own sentence is held against its goal."""

from __future__ import annotations

from dataclasses import replace

import pytest

import bddl
import llm
import oag
from llm.offline.rereading import other_readings
from tests.llm.kitchens import SCENES
from tests.oag.paper import NAMES, scene, task_json

QUERY = "put the apple into the bowl, then put the glass into the fridge and close it"


def planned(query: str = QUERY, scene_name: str = "breakfast", **changes: object) -> oag.Task:
    return replace(llm.propose(query, SCENES[scene_name]).task, **changes)  # type: ignore[arg-type]


def warned(task: oag.Task, name: str = "breakfast") -> list[str]:
    found = other_readings(task, SCENES[name])
    assert {(each.code, each.severity) for each in found} <= {("answer/other-reading", "warning")}
    return [each.message for each in found]


def test_what_the_planner_writes_means_its_goal() -> None:
    assert warned(planned()) == []
    assert warned(planned("take the milk out of the fridge")) == []
    assert warned(planned("put the glass into the fridge", "kitchen_t1"), "kitchen_t1") == []


@pytest.mark.parametrize("name", NAMES)
def test_the_papers_tasks_mean_their_goals(name: str) -> None:
    where = scene(name)
    assert other_readings(oag.Task.from_json(task_json(name), scene=where), where) == ()


@pytest.mark.parametrize("field", ["name", "detail"])
@pytest.mark.parametrize(
    ("goal", "difference"),
    [
        ("(inside apple_0 bowl_0)", "(inside glass_0 refrigerator_0), (not (open refrigerator_0)) is asked for"),
        (
            "(and (inside apple_0 bowl_0) (inside glass_0 refrigerator_0))",
            "(not (open refrigerator_0)) is asked for and not in the goal",
        ),
        (
            "(and (inside apple_0 refrigerator_0) (inside glass_0 refrigerator_0) (not (open refrigerator_0)))",
            "(inside apple_0 bowl_0) is asked for and not in the goal; (inside apple_0 refrigerator_0) is in the goal",
        ),
    ],
)
def test_another_goal_is_warned_of(field: str, goal: str, difference: str) -> None:
    words = {"name": "", "detail": "", field: QUERY.replace(" ", "_") if field == "name" else QUERY}
    (message,) = warned(planned(goal=bddl.parse_formula(goal), **words))
    assert difference in message


def test_a_goal_for_all_is_compared_and_a_choice_is_not() -> None:
    query = "put the apple into the bowl"
    everything = "(forall (?x - apple) (inside ?x bowl_0))"
    assert warned(planned(query, goal=bddl.parse_formula(everything))) == []
    assert warned(planned(query, goal=bddl.parse_formula("(forall (?x - apple) (not (inside ?x bowl_0)))")))
    choice = "(or (inside apple_0 bowl_0) (inside glass_0 bowl_0))"
    assert warned(planned(query, goal=bddl.parse_formula(choice))) == []


@pytest.mark.parametrize("door", ["", "(open refrigerator_0)", "(not (open refrigerator_0))"])
@pytest.mark.parametrize("query", ["put the glass into the fridge", "open the fridge and put the glass into it"])
def test_a_door_on_the_way_may_end_either_way(query: str, door: str) -> None:
    goal = bddl.parse_formula(f"(and (inside glass_0 refrigerator_0) {door})")
    assert warned(planned(query, "kitchen_t1", goal=goal, name=query), "kitchen_t1") == []


def test_a_door_that_no_wish_goes_through_does_not() -> None:
    task = planned(
        "open the fridge and put the apple into the bowl", goal=bddl.parse_formula("(inside apple_0 bowl_0)")
    )
    assert "(open refrigerator_0) is asked for and not in the goal" in warned(task)[0]


def test_words_that_are_no_wish_say_nothing() -> None:
    goal = bddl.parse_formula("(inside glass_0 refrigerator_0)")
    assert warned(planned(goal=goal, name="variant_7", detail="The glass is on the table. It is tall.")) == []


def test_the_query_counts_as_a_sentence() -> None:
    silent = planned(name="task", detail="", goal=bddl.parse_formula("(inside apple_0 bowl_0)"))
    assert other_readings(silent, SCENES["breakfast"]) == ()
    (found,) = other_readings(silent, SCENES["breakfast"], query=QUERY)
    assert found.code == "answer/other-reading" and "(inside glass_0 refrigerator_0)" in found.message


def test_of_what_cannot_be_read_the_items_that_the_goal_forgets_are_noted() -> None:
    words = "For the night, glass_0 had better be stowed, apple_0 too."
    task = planned(name="task", detail=words, goal=bddl.parse_formula("(inside apple_0 bowl_0)"))
    (found,) = other_readings(task, SCENES["breakfast"])
    assert (found.code, found.severity) == ("answer/forgotten-object", "note")
    assert "names glass_0, and the goal" in found.message
    every = bddl.parse_formula("(forall (?g - object) (not (inside ?g gripper)))")
    assert other_readings(replace(task, goal=every), SCENES["breakfast"]) == ()
