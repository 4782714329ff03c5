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


def test_a_part_is_not_taken_on_trust_and_a_part_of_nothing_is_asked_about() -> None:
    assert llm.propose("open the left door of the wardrobe", _SCENE).notes == ()
    with pytest.raises(llm.QueryError, match="third drawer of"):
        llm.propose("open the third drawer", _SCENE)
