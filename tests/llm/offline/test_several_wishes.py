"""Several objects and several steps: doors once, one hand, the order as said, pronouns, and what is said about it."""

from __future__ import annotations

from dataclasses import replace

import pytest

import bddl
import llm
import oag
from llm.offline.intents import Intent, IntentKind, Request, carries_past_doors, order_for_one_hand
from llm.offline.viewpoint import gap_m, left_m, on_side
from tests.llm.kitchens import SCENES, noted


def steps(scene: str, query: str) -> list[str]:
    """Return the names of the subtasks that a query leads to."""
    return [subtask.name for subtask in llm.propose(query, SCENES[scene]).task.subtasks]


def test_a_door_is_opened_once_for_several_objects() -> None:
    assert steps("breakfast", "put the apple and the cup into the fridge") == [
        "open_refrigerator",
        "pick_up_apple", "put_apple_into_refrigerator",
        "pick_up_glass", "put_glass_into_refrigerator",
        "close_refrigerator",
    ]  # fmt: skip


def test_a_wish_to_close_what_is_closed_on_the_way_adds_no_step() -> None:
    plain = steps("breakfast", "put the apple into the fridge")
    assert steps("breakfast", "put the apple into the fridge, then close it") == plain


def test_a_wish_to_open_is_respected_to_the_end() -> None:
    proposal = llm.propose("open the fridge, take out the milk and put it on the table", SCENES["breakfast"])
    names = [subtask.name for subtask in proposal.task.subtasks]
    assert names == ["open_refrigerator", "pick_up_milk", "put_milk_on_table"]
    assert bddl.format(proposal.task.goal) == "(and (ontop milk_0 table_0) (open refrigerator_0))"


def test_what_is_left_open_at_the_end_is_noted_with_the_container_that_was_used() -> None:
    proposal = llm.propose("open the fridge and put the glass in it", SCENES["breakfast"])
    assert noted(proposal) == ("refrigerator_0 stays open, since no wish closes it again",)


def test_two_containers_are_closed_each_before_the_next_is_needed() -> None:
    assert steps("house", "put the apple into the microwave and the plate into the cabinet") == [
        "open_microwave", "pick_up_apple", "put_apple_into_microwave", "close_microwave",
        "open_cabinet", "pick_up_plate", "put_plate_into_cabinet", "close_cabinet",
    ]  # fmt: skip


def test_both_doors_stay_open_while_several_things_go_from_one_to_the_other() -> None:
    scene = replace(
        SCENES["house"],
        facts=tuple(
            bddl.parse_formula(text)
            for text in (
                "(inside banana_0 cabinet_0)", "(inside apple_0 cabinet_0)", "(ontop glass_0 table_0)",
                "(ontop plate_0 table_0)", "(inside milk_0 refrigerator_0)", "(not (open refrigerator_0))",
                "(not (open cabinet_0))", "(not (open microwave_0))",
            )
        ),
    )  # fmt: skip
    task = llm.propose("empty the cabinet into the fridge", scene).task
    doors = [subtask.name for subtask in task.subtasks if subtask.name.startswith(("open", "close"))]
    assert doors == ["open_cabinet", "open_refrigerator", "close_refrigerator", "close_cabinet"]
    assert oag.compose(task).verify().verdict is oag.Verdict.PROVED


def test_a_later_wish_about_the_same_thing_counts() -> None:
    proposal = llm.propose("put the glass into the fridge, then put the glass on the table", SCENES["breakfast"])
    assert bddl.format(proposal.task.goal) == "(and (ontop glass_0 table_0) (not (open refrigerator_0)))"
    assert [s.target for s in proposal.task.subtasks].count("glass_0") == 4


def test_what_is_so_already_is_left_out_and_noted() -> None:
    proposal = llm.propose("put the apple and the milk on the table", SCENES["breakfast"])
    assert noted(proposal) == ("apple_0 is on table_0 already; nothing is done for it",)
    assert "(ontop apple_0 table_0)" in bddl.format(proposal.task.goal)
    assert not any(subtask.target == "apple_0" for subtask in proposal.task.subtasks)


def test_nothing_is_carried_while_a_door_is_opened() -> None:
    proposal = llm.propose("pick up the glass, open the fridge and put the glass into it", SCENES["breakfast"])
    assert proposal.task.subtasks[0].name == "open_refrigerator"
    assert "the hand has to be free for a handle, so nothing is carried while a door is opened or closed" in (
        proposal.notes
    )


def test_the_only_other_place_is_taken_with_a_note_and_the_nearest_surface_of_several() -> None:
    proposal = llm.propose("clear the table", SCENES["breakfast"])
    assert noted(proposal) == ("refrigerator_0 is the only other place that can take apple_0, glass_0 and bowl_0",)
    proposal = llm.propose("clear the nightstand", SCENES["bedroom"])
    assert noted(proposal) == ("no usual place of cup_0 is known; desk_0 is the nearest other surface",)


def test_everything_leaves_out_what_stands_in_another_item() -> None:
    proposal = llm.propose("put the apple into the bowl, then put everything into the fridge", SCENES["breakfast"])
    goal = bddl.format(proposal.task.goal)
    assert "(inside apple_0 bowl_0)" in goal
    assert "(inside bowl_0 refrigerator_0)" in goal
    assert oag.compose(proposal.task).verify().verdict is oag.Verdict.PROVED


@pytest.mark.parametrize(
    ("query", "code"),
    [
        ("put the apple in the microwave and the plate in the cabinet. Open the fridge and the cabinet, close it",
         "ambiguous-object"),
        ("put the apple in the bowl, put it on the table", "ambiguous-object"),
        ("open the fridge and put them in", "not-understood"),
        ("put the glass in", "missing-place"),
        ("go to the fridge", "not-understood"),
    ],
)  # fmt: skip
def test_a_pronoun_without_one_meaning_is_refused(query: str, code: str) -> None:
    scene = SCENES["house" if "microwave" in query else "breakfast"]
    with pytest.raises(llm.QueryError) as caught:
        llm.propose(query, scene)
    assert caught.value.code == code


def test_what_is_too_close_to_call_is_neither_left_nor_right() -> None:
    scene = SCENES["trio"]
    assert on_side(("glass_0", "glass_1"), "left", scene) == ("glass_0",)
    # The apple is 0.1 m further left than the glass; a robot that looks along their line sees no side.
    assert left_m("apple_0", scene) - left_m("glass_0", scene) == pytest.approx(0.1)
    turned = replace(scene, robot=replace(scene.robot, yaw_rad=-1.5707963))
    assert on_side(("glass_0", "apple_0"), "left", turned) == ("glass_0", "apple_0")
    # Footprints: 0.1 m between the centres, 0.04 m and 0.035 m of it inside the two.
    assert gap_m("apple_0", "glass_0", scene) == pytest.approx(0.025)
    assert gap_m("glass_0", "table_0", scene) == 0.0


GLASS_UP = Intent(IntentKind.PICK, "glass_0")
GLASS_IN = Intent(IntentKind.PLACE, "glass_0", "inside", "refrigerator_0")
OPEN = Intent(IntentKind.OPEN, "refrigerator_0")
CLOSE = Intent(IntentKind.CLOSE, "refrigerator_0")
APPLE_IN = Intent(IntentKind.PLACE, "apple_0", "inside", "refrigerator_0")


@pytest.mark.parametrize(
    ("asked", "kept"),
    [
        ((GLASS_UP, GLASS_IN), (GLASS_IN,)),
        ((GLASS_UP, OPEN, GLASS_IN), (OPEN, GLASS_IN)),
        ((GLASS_UP, CLOSE, GLASS_IN), (GLASS_IN, CLOSE)),
        # The same door twice, or another thing placed meanwhile: another order would end otherwise.
        ((GLASS_UP, CLOSE, OPEN, GLASS_IN), (GLASS_UP, CLOSE, OPEN, GLASS_IN)),
        ((GLASS_UP, APPLE_IN, GLASS_IN), (GLASS_UP, APPLE_IN, GLASS_IN)),
        ((OPEN, GLASS_UP), (OPEN, GLASS_UP)),
    ],
)
def test_one_hand(asked: tuple[Intent, ...], kept: tuple[Intent, ...]) -> None:
    assert order_for_one_hand(Request(asked)) == Request(kept)
    reordered = asked != kept and len(asked) > 2
    assert carries_past_doors(Request(asked)) is reordered


def test_the_sentence_of_a_request_groups_what_goes_together() -> None:
    request = Request((OPEN, APPLE_IN, GLASS_IN, CLOSE))
    assert str(request) == (
        "open refrigerator_0, then put apple_0 and glass_0 into refrigerator_0, then close refrigerator_0"
    )
    assert llm.propose(str(request), SCENES["breakfast"]).expanded.task_name == str(request)
