"""Wishes to push things: beside what stands on the same thing, by a flow that takes nothing."""

from __future__ import annotations

import pytest

import bddl
import llm
import oag
from oag.flows import PUSH
from oag.sizes import Sizing


def scene(*facts: str, gripper_facts: str = "") -> oag.Scene:
    wide = {"position": [1.0, 0.0, 0.8], "bbox_extent": [0.24, 0.16, 0.04]}
    narrow = {"position": [1.0, 0.4, 0.8], "bbox_extent": [0.06, 0.06, 0.10]}
    floor = {"position": [1.0, 0.0, 0.4], "bbox_extent": [1.0, 1.4, 0.8]}
    things = {
        "table_0": {"category": "table", **floor},
        "shelf_0": {"category": "shelf", **floor},
        "book_0": {"category": "book", **wide},
        "cup_0": {"category": "cup", **narrow},
        "can_0": {"category": "can", **narrow},
        "die_0": {"category": "die", **narrow},
        "tray_0": {"category": "tray", "position": [1.0, 0.0, 0.8], "bbox_extent": [0.5, 0.8, 0.02]},
    }
    known = facts or ("(ontop book_0 table_0)", "(ontop cup_0 table_0)", "(ontop can_0 shelf_0)")
    data = {"name": "desk", "objects": things, "facts": [*known, gripper_facts] if gripper_facts else list(known)}
    return oag.Scene.from_json({**data, "closed": ["ontop", "inside", "open"]})


@pytest.mark.parametrize(
    ("query", "where"),
    [
        ("push the book next to the cup", "next to cup_0"),
        ("Please slide the book to the left of the cup.", "left of cup_0"),
        ("nudge the book to the right of the cup", "right of cup_0"),
        ("could you push the book behind the cup?", "behind cup_0"),
        ("push the book in front of the cup", "in front of cup_0"),
    ],
)
def test_a_thing_is_pushed_beside_another_one(query: str, where: str) -> None:
    proposal = llm.propose(query, scene(), sizing=Sizing(keep=True))
    (subtask,) = proposal.task.subtasks
    assert (subtask.target, str(subtask.where)) == ("book_0", where)
    assert tuple(action.primitive for action in subtask.flow or ()) == PUSH
    assert bddl.format(proposal.task.goal) == "(ontop book_0 table_0)"
    report = oag.compose(proposal.task, scene=scene()).verify()
    assert report
    assert "task/vacuous" not in [diagnostic.code for diagnostic in report.diagnostics]
    assert oag.recheck(report.certificate)


def test_the_understood_wish_is_read_back() -> None:
    first = llm.propose("push the book behind the cup, then pick up the cup", scene(), sizing=Sizing(keep=True))
    again = llm.propose(first.expanded.task_name, scene(), sizing=Sizing(keep=True))
    assert again.task.subtasks == first.task.subtasks
    assert [str(subtask.where) for subtask in first.task.subtasks] == ["behind cup_0", "None"]


def test_what_is_too_wide_for_the_hand_is_pushed_and_that_is_said() -> None:
    proposal = llm.propose("put the book next to the cup", scene(), sizing=Sizing(keep=True))
    assert [subtask.name for subtask in proposal.task.subtasks] == ["push_book_on_table"]
    assert any("too wide" in note and "pushed" in note for note in proposal.notes)


def test_what_the_hand_takes_is_put() -> None:
    proposal = llm.propose("put the cup next to the book", scene(), sizing=Sizing(keep=True))
    assert [subtask.name for subtask in proposal.task.subtasks] == ["pick_up_cup", "put_cup_on_table"]


def test_what_stands_elsewhere_and_is_too_wide_is_still_refused() -> None:
    with pytest.raises(llm.QueryError) as caught:
        llm.propose("put the book next to the can", scene(), sizing=Sizing(keep=True))
    assert caught.value.code == "too-large"


@pytest.mark.parametrize(
    ("query", "code", "reason"),
    [
        ("push the book next to the can", "unsupported-relation", "along what both stand on"),
        ("push the book into the cup", "unsupported-relation", "beside another one"),
        ("push the book against the cup", "unsupported-relation", "beside another one"),
        ("push the book next to the book", "affordance", "cannot be pushed"),
        ("push the table next to the cup", "affordance", "fixture"),
        ("push the chair next to the cup", "unknown-object", 'called "chair"'),
        ("nudge the book next to the fork", "unknown-object", 'called "fork"'),
        ("push the chair aside", "unknown-action", "nothing here pushes"),
        ("push the book aside", "unknown-action", "nothing here pushes"),
        ("push the book to the left", "unknown-action", "nothing here pushes"),
    ],
)
def test_other_pushes_are_refused_with_the_reason(query: str, code: str, reason: str) -> None:
    with pytest.raises(llm.QueryError) as caught:
        llm.propose(query, scene(), sizing=Sizing(keep=True))
    assert caught.value.code == code
    assert reason in caught.value.problem


def test_what_is_too_wide_to_be_picked_up_and_put_there_may_be_pushed() -> None:
    with pytest.raises(llm.QueryError) as caught:
        llm.propose("pick up the book and put it next to the cup", scene(), sizing=Sizing(keep=True))
    assert caught.value.code == "too-large"
    assert tuple(caught.value.suggestions) == ("push book_0 next to cup_0",)
    with pytest.raises(llm.QueryError) as caught:
        llm.propose("pick up the book and put it next to the can", scene(), sizing=Sizing(keep=True))
    assert caught.value.code == "too-large"
    assert not caught.value.suggestions


def test_what_is_too_wide_for_the_hand_is_not_pushed_along_what_is_loose() -> None:
    place = scene("(ontop book_0 tray_0)", "(ontop cup_0 tray_0)", "(ontop tray_0 table_0)")
    with pytest.raises(llm.QueryError) as caught:
        llm.propose("put the book next to the cup", place, sizing=Sizing(keep=True))
    assert caught.value.code == "too-large"


@pytest.mark.parametrize(
    ("facts", "reason"),
    [
        (("(inside book_0 shelf_0)", "(inside cup_0 shelf_0)"), "book_0 is in shelf_0; only what stands on top"),
        (("(inside book_0 shelf_0)", "(ontop cup_0 table_0)"), "book_0 is in shelf_0; only what stands on top"),
        (("(inside book_0 gripper)", "(ontop cup_0 table_0)"), "book_0 is in the hand"),
        (("(ontop book_0 tray_0)", "(ontop cup_0 tray_0)"), "book_0 is on tray_0, which is loose"),
        (("(ontop book_0 tray_0)", "(ontop cup_0 table_0)"), "book_0 is on tray_0, which is loose"),
        (("(ontop book_0 table_0)", "(ontop cup_0 tray_0)"), "book_0 is on table_0, and cup_0 is not"),
        (("(ontop book_0 table_0)", "(ontop cup_0 book_0)"), "book_0 carries cup_0"),
        (("(ontop book_0 table_0)", "(ontop cup_0 shelf_0)"), "book_0 is on table_0, and cup_0 is not"),
    ],
)
def test_where_things_stand_is_said_as_it_is(facts: tuple[str, ...], reason: str) -> None:
    with pytest.raises(llm.QueryError) as caught:
        llm.propose("push the book next to the cup", scene(*facts, "(ontop tray_0 table_0)"), sizing=Sizing(keep=True))
    assert reason in caught.value.problem


def test_what_is_on_what_it_would_be_pushed_beside_stands_on_a_loose_thing() -> None:
    place = scene("(ontop cup_0 tray_0)", "(ontop tray_0 table_0)")
    with pytest.raises(llm.QueryError, match="cup_0 is on tray_0, which is loose"):
        llm.propose("push the cup next to the tray", place, sizing=Sizing(keep=True))


def test_what_carries_something_and_what_a_full_hand_would_push_is_refused() -> None:
    loaded = scene("(ontop book_0 table_0)", "(ontop cup_0 table_0)", "(ontop die_0 book_0)")
    holding = scene("(ontop book_0 table_0)", "(ontop cup_0 table_0)", "(inside die_0 gripper)")
    for place, reason in ((loaded, "carries die_0"), (holding, "has to be free to push")):
        with pytest.raises(llm.QueryError, match=reason):
            llm.propose("push the book next to the cup", place, sizing=Sizing(keep=True))


@pytest.mark.parametrize("query", ["push the drawer of the dresser shut", "slide the drawer of the dresser open"])
def test_drawers_are_still_pushed_and_slid(query: str) -> None:
    drawers = oag.scene(
        objects={"dresser_0": "dresser"},
        facts=["(not (open dresser_0))" if query.endswith("open") else "(open dresser_0)"],
    )
    assert llm.propose(query, drawers).task.subtasks[0].target == "dresser_0"
