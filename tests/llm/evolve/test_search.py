"""The supervisor without a model: its revisions may run, follow the measurements, never repeat, end with a reason."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

import oag
from llm.evolve import GiveUp, Miss, SearchSupervisor, Supervisor
from oag.model.actions import ActionFlow, flow_from_json, flow_to_json
from oag.revision import Attempt, History, Revision, admissible, same_flow
from tests.llm.evolve.attempts import PAPER_SUBTASKS, failed, paper_task, situation
from tests.oag.paper import scene

FAILURES = (
    "",
    "unreachable",
    "no-collision-free-path",
    "grasp-missed",
    "too-wide-for-gripper",
    "slipped",
    "stalled",
    "dropped",
    "unexpected-contact",
    "side-effect",
    "precondition",
    "timeout",
)
SHORT = st.floats(-0.5, 0.5, allow_nan=False)
MEASUREMENTS = st.fixed_dictionaries(
    {},
    optional={
        "fraction_before": st.floats(0, 1),
        "fraction_reached": st.floats(0, 1),
        "fraction_asked": st.floats(0, 1),
        "residual_m": st.floats(0, 1),
        "eef_moved_m": st.floats(0, 0.5),
        "asked_m": st.floats(0, 0.5),
        "target_left_m": SHORT,
        "target_up_m": SHORT,
        "target_forward_m": SHORT,
        "mover": st.just("panda_link5"),
        "other": st.just("refrigerator_0"),
    },
)
MISSES = st.lists(st.builds(Miss, st.just("(inside a b)"), SHORT, SHORT, SHORT, SHORT, SHORT), max_size=2)


def revise(name: str, subtask: int, attempt: Attempt, history: History | None = None) -> Revision:
    answer = SearchSupervisor().revise(situation(name, subtask, attempt, history))
    assert isinstance(answer, Revision), answer
    return answer


def flow_of(name: str, subtask: int) -> ActionFlow:
    flow = paper_task(name).subtasks[subtask].flow
    assert flow is not None
    return flow


@given(st.data())
def test_every_revision_may_run_and_none_repeats(data: st.DataObject) -> None:
    name, subtask = data.draw(st.sampled_from(PAPER_SUBTASKS))
    history = History(subtask)
    flow = flow_of(name, subtask)
    while not history.exhausted:
        step = data.draw(st.integers(0, len(flow) - 1))
        misses = data.draw(MISSES)
        attempt = failed(
            flow,
            step,
            data.draw(st.sampled_from(FAILURES)),
            measurements=data.draw(MEASUREMENTS),
            misses=misses,
        )
        asked = situation(name, subtask, attempt, history)
        answer = SearchSupervisor().revise(asked)
        assert answer == SearchSupervisor().revise(asked), "the same question has the same answer"
        if isinstance(answer, GiveUp):
            assert ("tried" in answer.reason or answer.needed) and answer.cause
            return
        admission = admissible(asked.task, subtask, answer.flow, scene=scene(name), history=history.add(attempt))
        assert admission, str(admission)
        assert admission.report is not None and admission.report.verdict is oag.Verdict.PROVED
        assert all(not same_flow(answer.flow, earlier.flow) for earlier, _ in history.iterations)
        assert answer.cause_step is not None and answer.explanation.startswith("Root cause at step ")
        history = history.add(attempt, answer)
        flow = answer.flow


def test_it_is_a_supervisor() -> None:
    assert isinstance(SearchSupervisor(), Supervisor)


def test_a_door_left_ajar_is_closed_by_what_is_missing() -> None:
    attempt = failed(flow_of("T1", 3), 4, measurements={"fraction_reached": 0.352, "fraction_asked": 0.35})
    revision = revise("T1", 3, attempt)
    assert flow_to_json(revision.flow) == [17, 1, 2, 3, {"19": [0.0, 0.86]}, 5]
    assert (revision.change, revision.cause, revision.cause_step) == (
        "parameters",
        "the joint limits end too early",
        4,
    )
    assert "0.35 of the range was left open" in revision.explanation


@pytest.mark.parametrize(
    ("miss", "expected"),
    [
        (Miss("(inside glass_0 refrigerator_0)", 0.04, 0.0, 0.0), [18, {"13": 0.4}, {"9": 0.14}, 5]),
        (Miss("(inside glass_0 refrigerator_0)", -0.06, 0.0, 0.0), [18, {"13": 0.4}, {"9": 0.04}, 5]),
        (Miss("(inside glass_0 refrigerator_0)", 0.3, 0.0, 0.0), [18, {"13": 0.7}, {"9": 0.1}, 5]),
        (Miss("(inside glass_0 refrigerator_0)", 0.0, 0.05, 0.0), [18, {"11": 0.05}, {"13": 0.4}, {"9": 0.1}, 5]),
        (Miss("(inside glass_0 refrigerator_0)", 0.0, -0.3, 0.0), [18, {"16": 0.3}, {"13": 0.4}, {"9": 0.1}, 5]),
        (Miss("(inside glass_0 refrigerator_0)", 0.0, 0.0, -0.08), [18, {"13": 0.4}, {"9": 0.1}, {"8": 0.08}, 5]),
        (
            Miss("(inside glass_0 refrigerator_0)", 0.02, -0.03, 0.05),
            [18, {"7": 0.05}, {"12": 0.03}, {"13": 0.4}, {"9": 0.12}, 5],
        ),
    ],
)
def test_what_is_let_go_beside_its_place_is_moved_by_the_miss(miss: Miss, expected: list[Any]) -> None:
    attempt = failed(flow_of("T1", 2), 3, "dropped", misses=[miss])
    assert flow_to_json(revise("T1", 2, attempt).flow) == expected


def test_an_insertion_that_is_blocked_goes_aside_to_the_middle_first() -> None:
    miss = Miss("(inside glass_0 refrigerator_0)", 0.2, 0.1, 0.0, 0.3, 0.12)
    attempt = failed(
        flow_of("T1", 2),
        1,
        "unexpected-contact",
        measurements={"asked_m": 0.4, "eef_moved_m": 0.2},
        failure_measurements={"mover": "panda_link5", "other": "refrigerator_0"},
        misses=[miss],
    )
    revision = revise("T1", 2, attempt)
    assert flow_to_json(revision.flow) == [18, {"11": 0.12}, {"13": 0.4}, {"9": 0.1}, 5]
    assert revision.change == "sequence"


def test_numbers_that_lead_nowhere_are_opened_one_at_a_time_from_the_last() -> None:
    flow = flow_of("T3", 1)
    history = History(1)
    opened = []
    for _ in range(3):
        attempt = failed(flow, 0, measurements={"stance": "nominal: the flow's numbers reach no free spot"})
        revision = revise("T3", 1, attempt, history)
        opened.append(flow_to_json(revision.flow))
        history, flow = history.add(attempt, revision), revision.flow
    assert opened[0] == [18, {"13": 0.4}, {"9": 0.1}, {"8": None}, 5]
    assert opened[1] == [18, {"13": 0.4}, {"9": None}, {"8": None}, 5]
    assert opened[2] == [18, {"13": None}, {"9": None}, {"8": None}, 5]


def test_a_base_that_ended_beside_a_nominal_place_drives_again_at_once() -> None:
    measured = {"stance": "nominal: the flow's numbers reach no free spot", "beside_m": 0.12}
    revision = revise("T3", 1, failed(flow_of("T3", 1), 0, measurements=measured))
    assert flow_to_json(revision.flow) == [18, {"14": 0.1}, 18, {"13": 0.4}, {"9": 0.1}, {"8": None}, 5]
    assert "to the geometric planner, and go back a little and drive there again" in revision.explanation


def test_how_far_moves_came_from_a_nominal_place_counts_for_nothing() -> None:
    """A flow that found a place and failed at its second step is built upon, not the one that failed at its fourth."""
    nominal = {"stance": "nominal: the flow's numbers reach no free spot"}
    first = replace(failed(flow_of("T3", 1), 0, measurements=nominal), failed_step=3)
    revision = revise("T3", 1, first)
    placed = failed(
        revision.flow,
        1,
        "unexpected-contact",
        measurements={"beside_m": 0.12, "asked_m": 0.4, "eef_moved_m": 0.1},
        failure_measurements={"mover": "base_body", "other": "table_0"},
    )
    second = revise("T3", 1, placed, History(1).add(first, revision))
    assert "drive there again" in second.explanation and "came furthest" not in second.explanation


def test_a_worse_attempt_is_not_built_upon() -> None:
    flow = flow_of("T1", 2)
    first = failed(flow, 3, "dropped", misses=[Miss("(inside a b)", 0.04, 0.0, 0.0, 0.1, 0.0)])
    revision = revise("T1", 2, first)
    worse = failed(revision.flow, 1, "unreachable", measurements={"residual_m": 0.1})
    second = revise("T1", 2, worse, History(2).add(first, revision))
    assert "in attempt 1, which came furthest" in second.explanation
    assert flow_to_json(second.flow) == [18, {"13": 0.4}, {"9": 0.2}, 5]


def test_it_gives_up_with_a_reason_when_nothing_was_found_at_fault() -> None:
    flow = flow_of("T1", 0)
    attempt = Attempt(flow, "failed", failure="goal-not-reached", message="it is not open")
    answer = SearchSupervisor().revise(situation("T1", 0, attempt))
    assert answer == GiveUp("no step of any attempt was found at fault, so there is nothing to correct")


def test_it_gives_up_with_the_cause_when_no_correction_is_known() -> None:
    """A thing that is too wide for the gripper is no matter of the flow."""
    attempt = failed(flow_of("T1", 0), 0, "too-wide-for-gripper")
    answer = SearchSupervisor().revise(situation("T1", 0, attempt))
    assert isinstance(answer, GiveUp)
    assert answer.cause == "too wide for the gripper"
    assert answer.reason == f"no flow of the library corrects this: it went wrong; it would take {answer.needed}"
    assert answer.needed == "a narrower thing, or its size measured anew, and no primitive does either"


def test_a_hand_that_meets_something_on_its_way_down_stops_just_above() -> None:
    attempt = failed(
        flow_of("T3", 1),
        3,
        "unexpected-contact",
        measurements={"asked_m": 0.3, "eef_moved_m": 0.125},
        failure_measurements={"mover": "held", "other": "bowl_0"},
        misses=[Miss("(inside apple_0 bowl_0)", 0.0, 0.0, -0.03)],
    )
    lowered = [revision["8"] for revision in flow_to_json(revise("T3", 1, attempt).flow)[-2:-1]]  # type: ignore[index]
    assert lowered == [0.12]


def test_the_hand_is_taken_away_from_what_it_still_touches() -> None:
    unmet = {"(ontop glass_0 table_0)": {"touching": True, "fingers_touching": 1}}
    attempt = failed(flow_of("T4", 1), 4, unmet=unmet)
    revision = revise("T4", 1, attempt)
    assert flow_to_json(revision.flow) == [18, {"13": 0.4}, {"9": 0.1}, {"8": 0.3}, 5, 6]
    assert revision.cause == "the hand still touches what it let go of"


@pytest.mark.parametrize(
    ("mover", "expected"),
    [
        ("panda_hand", [17, {"14": 0.008}, 1, 2, 3, {"7": 0.2}]),
        ("panda_leftfinger", [17, 1, 2, 3, {"7": 0.2}]),
    ],
)
def test_a_palm_that_meets_what_it_is_to_take_stays_further_back(mover: str, expected: list[Any]) -> None:
    attempt = failed(
        flow_of("T3", 0),
        1,
        "unexpected-contact",
        measurements={"residual_m": 0.002, "target_up_m": 0.005},
        failure_measurements={"mover": mover, "other": "apple_0"},
    )
    assert flow_to_json(revise("T3", 0, attempt).flow) == expected


def test_a_second_slide_changes_the_first_one() -> None:
    flow = flow_from_json([17, 6, {"13": 0.02}, {"15": 0.01}, 1, 2, 3, {"7": 0.2}])
    attempt = failed(
        flow, 7, "slipped", measurements={"target_forward_m": -0.005, "target_left_m": -0.03, "eef_moved_m": 0.01}
    )
    revision = revise("T2", 1, attempt)
    assert flow_to_json(revision.flow) == [17, 6, {"16": 0.02}, {"13": 0.015}, 1, 2, 3, {"7": 0.2}]


def test_a_base_that_meets_something_on_its_way_sets_out_from_elsewhere() -> None:
    met = {"mover": "base_body", "other": "unseen_box_0"}
    attempt = failed(flow_of("T2", 2), 0, "unexpected-contact", failure_measurements=met)
    first = revise("T2", 2, attempt)
    assert flow_to_json(first.flow) == [{"15": 0.5}, 18, {"13": 0.4}, {"9": 0.1}, 5]
    blocked = {"mover": "base_body", "other": "table_0"}
    again = failed(first.flow, 0, "unexpected-contact", failure_measurements=blocked)
    second = revise("T2", 2, again, History(2).add(attempt, first))
    assert flow_to_json(second.flow) == [{"16": 0.5}, 18, {"13": 0.4}, {"9": 0.1}, 5]
    assert "in attempt 1, which came furthest" in second.explanation


def test_a_step_that_takes_too_long_is_asked_for_less_and_then_left_to_the_planner() -> None:
    flow = flow_of("T1", 3)
    attempt = failed(flow, 4, "timeout")
    revision = revise("T1", 3, attempt)
    assert revision.cause == "it took longer than a step may" and revision.cause_step == 4
    assert not same_flow(revision.flow, flow)


def test_where_no_stance_serves_a_flow_its_numbers_are_opened_then_it_drives_then_it_makes_room() -> None:
    """A place to stand is chosen for the whole flow, so that a lift which is too high lets no hand near the thing."""
    history, revisions = History(0), []
    flow = flow_of("T3", 0)
    for _ in range(4):
        attempt = failed(flow, len(flow) - 4, "no-collision-free-path")
        revision = revise("T3", 0, attempt, history)
        history = history.add(attempt, revision)
        revisions.append(flow_to_json(revision.flow))
        flow = revision.flow
    assert revisions[0] == [1, 2, 3, {"7": None}]
    assert revisions[1] == [17, 1, 2, 3, {"7": None}]
    assert len({str(revision) for revision in revisions}) == 4
    lifts = [sum(action == {"7": 0.05} for action in revision[:-1]) for revision in revisions]
    assert max(lifts) <= 1, revisions


@pytest.mark.parametrize(("free_to", "opened_to"), [(0.62, 0.59), (None, 0.7)])
def test_a_door_that_has_no_way_is_opened_less_far(free_to: float | None, opened_to: float) -> None:
    flow = tuple(
        replace(action, parameter=(0.0, 0.76)) if action.primitive is oag.Primitive.ARTICULATE_OPEN else action
        for action in flow_of("T1", 0)
    )
    unplanned = {"joint": "door_hinge", "free_to_fraction": free_to}
    attempt = failed(flow, 0, "no-collision-free-path", failure_measurements=unplanned)
    revision = revise("T1", 0, attempt)
    assert flow_to_json(revision.flow) == [1, 2, 3, {"4": [0.0, opened_to]}, 5]
