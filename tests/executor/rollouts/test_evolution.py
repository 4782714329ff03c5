"""Self-evolution in the physics, on fixed seeds: failures become successes, exactly repeatable, all of it told."""

from __future__ import annotations

import json
from collections.abc import Iterator

import pytest

import oag
from executor.records import Event, PlanRefused
from executor.rollouts.evolution_record import Evolution
from executor.rollouts.evolve import evolve
from executor.rollouts.rollout import rollout
from executor.rollouts.run_record import evolution_json
from executor.scenes import library
from executor.system.files import json_text
from llm.evolve import GiveUp, Situation
from oag.model.actions import flow_to_json
from oag.revision import History, Revision
from tests.executor.rollouts.tasks import T1_PAPER_FLOWS, T1_ROLES, closing, graph, open_joints, t1

pytestmark = pytest.mark.physics

SEED = 7001


class Repeats:
    """A supervisor that always answers with the flow that failed."""

    def __init__(self) -> None:
        self.asked: list[Situation] = []

    def revise(self, situation: Situation) -> Revision:
        self.asked.append(situation)
        return Revision(situation.attempt.flow, "parameters", "once more")


@pytest.fixture(scope="module")
def closed() -> Iterator[Evolution]:
    """A door that was left ajar, evolved; several tests look at it."""
    yield evolve(closing(), seed=SEED)


def test_a_small_failure_evolves(closed: Evolution) -> None:
    assert closed.succeeded and not closed.succeeded_at_once
    story = closed.stories[0]
    assert [attempt.outcome for attempt, _ in story.history.iterations] == ["failed", "succeeded"]
    assert story.history.revisions[0].cause_step == 3
    assert flow_to_json(closed.evolved.subtasks[0].flow or ()) == [1, 2, 3, {"19": [0.0, 0.5]}, 5]


def test_the_same_seed_tells_the_same_story(closed: Evolution) -> None:
    again = evolve(closing(), seed=SEED)
    assert again.rollout.state_hash == closed.rollout.state_hash
    assert [story.history for story in again.stories] == [story.history for story in closed.stories]


def test_the_evolved_task_runs_by_itself_to_the_same_states(closed: Evolution) -> None:
    scene = open_joints()
    alone = rollout(oag.compose(closed.evolved, scene=scene), scene, SEED)
    assert alone.succeeded
    assert alone.state_hash == closed.rollout.state_hash
    assert len(alone.trajectory.time_s) == len(closed.rollout.trajectory.time_s)


def test_every_attempt_starts_from_the_same_checkpoint(closed: Evolution) -> None:
    first, second = closed.stories[0].records
    assert first.checkpoint == second.checkpoint
    assert first.state_hash != second.state_hash


def test_what_was_so_when_an_attempt_began_is_read(closed: Evolution) -> None:
    first, second = (seen.start for seen in closed.stories[0].observations)
    assert first is not None and first == second
    assert first.facts == ("(open refrigerator_0)", "(ontop glass_0 table_0)")
    pose = library.load("kitchen_t1").robot
    assert first.base[:2] == pytest.approx(pose.position[:2], abs=0.3)
    assert first.base[2] == pytest.approx(pose.yaw_rad, abs=0.3)


def test_the_story_is_data(closed: Evolution) -> None:
    told = json.loads(json_text(evolution_json(closed)))
    history = History.from_json(told["subtasks"][0]["history"])
    assert [attempt.flow for attempt, _ in history.iterations] == [
        attempt.flow for attempt, _ in closed.stories[0].history.iterations
    ]
    critique = history.iterations[0].attempt.critiques[3]
    assert critique.finds_fault and critique.motion_verified is True and critique.state_reached is False
    evidence = told["subtasks"][0]["history"]["iterations"][0]["attempt"]["critiques"][3]["evidence"]
    assert evidence["measurements"]["fraction_reached"] == pytest.approx(0.2, abs=0.02)
    assert len(told["subtasks"][0]["records"]) == 2


def test_what_may_not_run_does_not_run() -> None:
    supervisor = Repeats()
    evolution = evolve(closing(), seed=SEED, supervisor=supervisor)
    story = evolution.stories[0]
    assert not evolution.succeeded and len(story.records) == 1
    assert isinstance(story.gave_up, GiveUp) and "attempt 1 ran the same flow" in story.gave_up.reason
    assert [len(situation.objections) for situation in supervisor.asked] == [0, 1, 2]


def test_the_limit_ends_it_with_the_reason() -> None:
    evolution = evolve(closing(), seed=SEED, limit=0)
    story = evolution.stories[0]
    assert not evolution.succeeded and story.gave_up is not None
    assert story.gave_up.reason.startswith("0 revisions were tried, and that is the limit")
    assert "(not (open refrigerator_0)) does not hold" in story.gave_up.reason
    assert story.gave_up.cause == "the joint limits end too early"


def test_what_is_refuted_is_not_evolved() -> None:
    events: list[Event] = []
    ajar = graph("kitchen_t1", T1_ROLES[:1], [[1, 2, 3, {"4": [0.0, 0.03]}, 5]], "(open refrigerator_0)", {})
    with pytest.raises(PlanRefused, match="REFUTED"):
        evolve(ajar, seed=SEED, listen=events.append)
    assert events == []


@pytest.mark.slow
def test_the_papers_flows_for_t1_evolve_to_success() -> None:
    events: list[Event] = []
    evolution = evolve(t1(T1_PAPER_FLOWS), seed=SEED, listen=events.append)
    assert evolution.succeeded and evolution.revisions == 1
    assert [len(story.records) for story in evolution.stories] == [1, 1, 1, 2]
    revision = evolution.stories[3].history.revisions[0]
    assert revision.cause == "the joint limits end too early" and revision.change == "parameters"
    assert [event.message for event in events if event.kind == "revision"] == [revision.explanation]
    placing, closing = (evolution.stories[index].observations[0].start for index in (2, 3))
    assert placing is not None and placing.facts == ("(open refrigerator_0)", "(inside glass_0 gripper)")
    assert closing is not None and closing.facts == ("(open refrigerator_0)", "(inside glass_0 refrigerator_0)")
