"""Parts of things and spots next to them, in queries: what is refused, and what a note says."""

from __future__ import annotations

import pytest

import llm
import oag

_SCENE = oag.scene(
    {
        "table_0": "table",
        "counter_0": "counter",
        "bowl_0": "bowl",
        "cup_0": "cup",
        "apple_0": "apple",
        "cabinet_0": "bottom_cabinet",
        "wardrobe_0": "wardrobe",
    },
    ["(ontop bowl_0 table_0)", "(ontop cup_0 table_0)", "(ontop apple_0 table_0)"],
    closed="all",
)


@pytest.mark.parametrize(
    "query",
    [
        "put the apple in the top drawer of the cabinet and the cup in the bottom drawer of the cabinet",
        "open the top drawer of the cabinet and the bottom drawer of the cabinet",
    ],
)
def test_two_parts_of_one_thing_are_refused(query: str) -> None:
    with pytest.raises(llm.QueryError, match="one part of a thing") as refused:
        llm.propose(query, _SCENE)
    assert refused.value.code == "unsupported-relation"


def test_one_part_after_the_other_is_planned() -> None:
    query = "open the top drawer of the cabinet, close it and open the bottom drawer of the cabinet"
    found = [str(subtask.where or "") for subtask in llm.propose(query, _SCENE).task.subtasks]
    assert found == ["top drawer", "", "bottom drawer"]


def test_a_spot_that_only_says_which_thing_is_meant_is_noted() -> None:
    aside = llm.propose("put the cup on the counter next to the bowl", _SCENE)
    assert any("next to" in note for note in aside.notes)
    meant = llm.propose("put the cup next to the bowl", _SCENE)
    assert str(meant.task.subtasks[-1].where) == "next to bowl_0" and not meant.notes


@pytest.mark.parametrize(
    ("query", "where"),
    [
        ("put the apple next to the bowl on the table", "next to bowl_0"),
        ("put the apple on the table next to the bowl", "next to bowl_0"),
        ("put the apple on the table to the left of the bowl", "left of bowl_0"),
        ("clear the counter onto the table next to the bowl", "next to bowl_0"),
        # It stands elsewhere, and is no neighbour there.
        ("put the apple on the shelf next to the bowl", ""),
        # The only plate is beside the bowl on the table: by either reading it goes onto the table beside it.
        ("put the plate beside the bowl on the table", "next to bowl_0"),
    ],
)
def test_a_neighbour_that_stands_there_says_the_spot(query: str, where: str) -> None:
    things = {
        "table_0": "table",
        "counter_0": "counter",
        "shelf_0": "shelf",
        "bowl_0": "bowl",
        "apple_0": "apple",
        "plate_0": "plate",
    }
    facts = ["(ontop bowl_0 table_0)", "(ontop apple_0 counter_0)", "(ontop plate_0 counter_0)"]
    plan = llm.propose(query, oag.scene(things, [*facts, "(nextto plate_0 bowl_0)"], closed="all"))
    assert str(plan.task.subtasks[-1].where or "") == where


def test_of_two_tables_that_is_meant_on_which_the_neighbour_stands() -> None:
    things = {"table_0": "table", "table_1": "table", "counter_0": "counter", "bowl_0": "bowl", "can_0": "can"}
    scene = oag.scene(things, ["(ontop bowl_0 table_1)", "(ontop can_0 counter_0)"], closed="all")
    plan = llm.propose("put the can on the table next to the bowl", scene).task
    assert plan.subtasks[-1].support_goal == "table_1" and str(plan.subtasks[-1].where) == "next to bowl_0"


@pytest.mark.parametrize("query", ["open the desk", "put the can in the desk"])
def test_of_things_of_one_name_those_are_meant_that_serve(query: str) -> None:
    things = {"desk_0": "desk", "desk_1": "desk_with_drawers", "table_0": "table", "can_0": "can"}
    plan = llm.propose(query, oag.scene(things, ["(ontop can_0 table_0)"], closed="all"))
    assert any("desk_1" in str(part) for part in (plan.task.goal,)) and any("desk_0" in note for note in plan.notes)


@pytest.mark.parametrize("query", ["put the apple on the box", "put the apple in the carton"])
def test_what_does_not_serve_is_no_other_thing(query: str) -> None:
    things = {"box_0": "box", "carton_0": "carton", "apple_0": "apple", "table_0": "table"}
    facts = ["(ontop apple_0 table_0)", "(ontop box_0 table_0)", "(ontop carton_0 table_0)"]
    with pytest.raises(llm.QueryError, match="has no"):
        llm.propose(query, oag.scene(things, facts, closed="all"))


def test_a_part_is_not_taken_on_trust_and_a_part_of_nothing_is_asked_about() -> None:
    assert llm.propose("open the left door of the wardrobe", _SCENE).notes == ()
    with pytest.raises(llm.QueryError, match="third drawer of"):
        llm.propose("open the third drawer", _SCENE)
