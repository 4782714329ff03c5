"""Doors that weak fingers lose or that something stops: another hold, and an end where no flow helps."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from llm.evolve import GiveUp, SearchSupervisor
from llm.evolve.diagnosis import stopped_at
from oag.model.actions import flow_from_json, flow_to_json
from oag.revision import Attempt, History, Revision
from tests.llm.evolve.attempts import failed, paper_task, situation

AGAIN = [5, 6, 17, 1, 2, 3]
OPENING: list[Any] = [1, 2, 3, {"4": None}, 5]


def lost(reached: float, before: float = 0.0, flow: list[Any] = OPENING, step: int = 3, **more: Any) -> Attempt:
    """Return an attempt in which the fingers lost the handle."""
    measured = {"fraction_before": before, "fraction_reached": reached, "fraction_asked": 0.85, **more}
    return failed(flow_from_json(flow), step, "slipped", measurements=measured)


def answer(*attempts: Attempt) -> Revision | GiveUp:
    """Return the answer to the last of some attempts at opening T1's refrigerator."""
    history = History(0)
    for attempt in attempts[:-1]:
        history = history.add(attempt, Revision(attempt.flow, "parameters", "tried"))
    return SearchSupervisor().revise(situation("T1", 0, attempts[-1], history))


def flow_of(said: Revision | GiveUp) -> list[Any]:
    assert isinstance(said, Revision), said
    return flow_to_json(said.flow)


def test_a_handle_that_is_lost_is_taken_hold_of_again_half_way() -> None:
    assert flow_of(answer(lost(0.2))) == [1, 2, 3, {"4": [0.0, 0.42]}, *AGAIN, {"4": None}, 5]


@pytest.mark.parametrize("reached", [0.0, 0.02])
def test_a_door_that_is_lost_before_it_is_ajar_gets_another_hold_and_then_an_end(reached: float) -> None:
    first = lost(reached)
    said = answer(first)
    end = answer(first, lost(reached, flow=flow_of(said)))
    assert isinstance(end, GiveUp) and end.cause == "the grip was lost"
    assert end.needed == "fingers that press harder, and no primitive sets their force"
    assert end.reason.startswith("no flow of the library corrects this: the fingers slid off refrigerator_0 before")
    assert isinstance(answer(first, lost(0.3, flow=flow_of(said))), Revision)


def test_one_loss_does_not_tell_a_stop_and_two_at_one_place_do() -> None:
    assert stopped_at([lost(0.06)]) is None
    assert stopped_at([lost(0.06), lost(0.08)]) is None
    assert stopped_at([lost(0.06), lost(0.3)]) is None
    assert stopped_at([lost(0.06), lost(0.055)]) == 0.06


def test_a_door_that_ends_ajar_whatever_is_asked_is_opened_to_there() -> None:
    first = lost(0.06)
    second = lost(0.058, flow=flow_of(answer(first)))
    assert flow_of(answer(first, second)) == [1, 2, 3, {"4": [0.0, 0.06]}, 5]


def test_a_hand_that_does_not_get_past_such_a_door_is_no_matter_of_a_flow() -> None:
    first = lost(0.06)
    second = lost(0.058, flow=flow_of(answer(first)))
    opened = flow_from_json([1, 2, 3, {"4": [0.0, 0.06]}, 5])
    history = History(0)
    for attempt in (first, second):
        history = history.add(attempt, Revision(opened, "parameters", "tried"))
    history = history.add(Attempt(opened, "succeeded"))
    flow = paper_task("T1").subtasks[2].flow or ()
    kept_out = failed(flow, 0, "unexpected-contact", failure_measurements={"mover": "glass_0", "other": "unseen_box_0"})
    asked = replace(situation("T1", 2, kept_out), earlier=(history, History(1)))
    end = SearchSupervisor().revise(asked)
    assert isinstance(end, GiveUp) and end.cause == "the door was opened too little"
    assert "the door of refrigerator_0 ends at 0.06 of its range however far it is to be opened" in end.reason
    wide = history.iterations[2].attempt
    free = replace(asked, earlier=(History(0).add(wide), History(1)))
    assert isinstance(SearchSupervisor().revise(free), Revision)
