"""Causes in an earlier subtask: found by what was measured there, corrected there, and never without a reason."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from llm.evolve import GiveUp, SearchSupervisor, Situation
from oag.measurements import MeasuredEvidence
from oag.model.actions import ActionFlow, flow_to_json
from oag.revision import Attempt, Critique, Hindsight, History, Revision, admissible
from tests.llm.evolve.attempts import failed, measured, paper_task
from tests.oag.paper import scene


def reached(flow: ActionFlow, **numbers: dict[str, Any]) -> Attempt:
    """Return an attempt that reached its goal, with what its steps measured, by the primitive's name."""
    critiques = tuple(
        Critique(
            step=step,
            primitive=action.primitive,
            motion_verified=True,
            text=f"{action} ran as asked.",
            evidence=MeasuredEvidence(measurements=measured(**numbers.get(action.primitive.name, {}))),
        )
        for step, action in enumerate(flow)
    )
    return Attempt(flow, "succeeded", critiques=critiques, filled=flow)


def after(name: str, subtask: int, attempt: Attempt, limit: int = 5, **numbers: dict[str, Any]) -> Situation:
    """Return the situation in which a subtask failed after the others were reached with these measurements."""
    task = paper_task(name)
    flows = [subtask.flow or () for subtask in task.subtasks]
    earlier = tuple(History(i, limit=limit).add(reached(flow, **numbers)) for i, flow in enumerate(flows[:subtask]))
    return Situation(task, subtask, scene(name), attempt, History(subtask), earlier=earlier)


def flow_of(name: str, subtask: int) -> ActionFlow:
    return paper_task(name).subtasks[subtask].flow or ()


BESIDE = {"held_off_m": 0.018, "held_forward_m": 0.015, "held_left_m": -0.01, "grip_force_n": 25.0}


def test_what_slips_because_it_was_taken_beside_its_middle_is_taken_anew() -> None:
    attempt = failed(flow_of("T1", 2), 0, "slipped", failure_measurements={"slip_m": 0.026})
    answer = SearchSupervisor().revise(after("T1", 2, attempt, GRASP=BESIDE))
    assert isinstance(answer, Revision)
    assert (answer.subtask, answer.cause, answer.cause_step) == (1, "the item was taken badly", 3)
    assert flow_to_json(answer.flow) == [17, {"16": 0.01}, {"13": 0.015}, 1, 2, 3, {"7": 0.2}]
    assert "It shows only now: it went wrong." in answer.explanation


@pytest.mark.parametrize(("leaning_deg", "blamed"), [(0.0, None), (25.0, 1)])
def test_what_leads_nowhere_is_the_grasps_fault_only_where_the_item_leans(
    leaning_deg: float, blamed: int | None
) -> None:
    """Planning knows where in the hand an item is; what leans to the side it cannot set upright."""
    stance = {"stance": "nominal: the flow's numbers reach no free spot", "leaning_deg": leaning_deg}
    attempt = failed(flow_of("T1", 2), 0, measurements=stance)
    answer = SearchSupervisor().revise(after("T1", 2, attempt, GRASP=BESIDE))
    assert isinstance(answer, Revision) and answer.subtask == blamed


def test_a_weak_grip_on_the_middle_is_taken_again() -> None:
    attempt = failed(flow_of("T3", 1), 0, "dropped")
    answer = SearchSupervisor().revise(after("T3", 1, attempt, GRASP={"held_off_m": 0.001, "grip_force_n": 0.2}))
    assert isinstance(answer, Revision) and answer.subtask == 0
    assert flow_to_json(answer.flow) == [1, 2, 3, 5, 6, 17, 1, 2, 3, {"7": 0.2}]


def test_a_sound_grip_is_not_blamed_while_something_else_can_be_tried() -> None:
    attempt = failed(flow_of("T3", 1), 1, "slipped")
    answer = SearchSupervisor().revise(after("T3", 1, attempt, GRASP={"held_off_m": 0.001, "grip_force_n": 28.0}))
    assert isinstance(answer, Revision) and answer.subtask is None


def test_a_door_that_is_hardly_open_is_opened_further() -> None:
    attempt = failed(flow_of("T1", 2), 1, "unexpected-contact", measurements={"asked_m": 0.4, "eef_moved_m": 0.2})
    answer = SearchSupervisor().revise(after("T1", 2, attempt, ARTICULATE_OPEN={"fraction_reached": 0.2}))
    assert isinstance(answer, Revision)
    assert (answer.subtask, answer.cause) == (0, "the door was opened too little")
    assert flow_to_json(answer.flow) == [1, 2, 3, {"4": [0.0, 0.85]}, 5]


def test_a_door_that_is_wide_open_is_not_blamed() -> None:
    attempt = failed(flow_of("T1", 2), 1, "unexpected-contact", measurements={"asked_m": 0.4, "eef_moved_m": 0.2})
    answer = SearchSupervisor().revise(after("T1", 2, attempt, ARTICULATE_OPEN={"fraction_reached": 0.85}))
    assert isinstance(answer, Revision) and answer.subtask is None


def test_a_subtask_that_was_revised_often_enough_is_left_alone() -> None:
    attempt = failed(flow_of("T1", 2), 0, "slipped")
    answer = SearchSupervisor().revise(after("T1", 2, attempt, limit=0, GRASP=BESIDE))
    assert isinstance(answer, GiveUp) or answer.subtask is None


FAILURES = ("slipped", "dropped", "unexpected-contact", "stalled", "unreachable", "no-collision-free-path", "")
NUMBER = st.floats(-0.05, 0.05, allow_nan=False)


@given(st.data())
def test_what_is_revised_earlier_may_run_and_repeats_nothing(data: st.DataObject) -> None:
    name, subtask = data.draw(st.sampled_from([("T1", 2), ("T1", 3), ("T2", 2), ("T2", 3), ("T3", 1), ("T4", 1)]))
    flow = flow_of(name, subtask)
    attempt = failed(flow, data.draw(st.integers(0, len(flow) - 1)), data.draw(st.sampled_from(FAILURES)))
    held = {key: data.draw(NUMBER) for key in ("held_off_m", "held_forward_m", "held_left_m")}
    asked = after(
        name,
        subtask,
        attempt,
        GRASP={**held, "grip_force_n": data.draw(st.floats(0.0, 30.0))},
        ARTICULATE_OPEN={"fraction_reached": data.draw(st.floats(0.0, 1.0))},
    )
    tried = 0
    while True:
        answer = SearchSupervisor().revise(asked)
        assert answer == SearchSupervisor().revise(asked), "the same question has the same answer"
        if isinstance(answer, GiveUp) or answer.subtask is None:
            return
        tried += 1
        assert tried <= 5 * subtask, "it ends"
        assert 0 <= answer.subtask < subtask
        assert attempt.message in answer.explanation
        history = asked.earlier[answer.subtask]
        blamed, before = history.reopened(Hindsight(subtask, attempt.failure, attempt.message))
        admission = admissible(asked.task, answer.subtask, answer.flow, scene=asked.scene, history=before.add(blamed))
        assert admission, str(admission)
        # The revised flow reaches its goal as well, and the same later step fails again.
        again = before.add(blamed, answer).add(reached(answer.flow))
        earlier = (*asked.earlier[: answer.subtask], again, *asked.earlier[answer.subtask + 1 :])
        asked = Situation(asked.task, subtask, asked.scene, attempt, History(subtask), earlier=earlier)


@pytest.mark.parametrize("subtask", [0, 1, 2])
def test_nothing_earlier_is_blamed_for_what_is_judged_alone(subtask: int) -> None:
    flow = flow_of("T1", subtask)
    attempt = failed(flow, 0, "too-wide-for-gripper")
    answer = SearchSupervisor().revise(after("T1", subtask, attempt, GRASP=BESIDE))
    assert isinstance(answer, GiveUp)
