"""Primitives refuse or fail for a measured reason when they are called out of place."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from executor.planning.collision import CollisionOracle
from executor.planning.planner import Planner
from executor.records import FailureKind
from executor.sim.world import World
from executor.skills.articulate import articulate
from executor.skills.control import Controller
from executor.skills.grasp import converge, grasp, ungrasp
from executor.skills.library import LIBRARY, move
from executor.skills.navigate import navigate_to_target, nearest_home, retreat
from executor.skills.session import Session
from oag import Action, Primitive
from oag.measurements import OutOfReach, RetreatMeasured, first_of, measurements_json
from oag.model.robots import PAPER_ROBOT
from tests.executor.helpers import scene_at_paper_size
from tests.executor.rollouts.tasks import t1

pytestmark = pytest.mark.physics


@pytest.fixture(scope="module")
def planner() -> Iterator[Planner]:
    """A planner for kitchen_t1."""
    world = World(scene_at_paper_size("kitchen_t1"), oracle=True)
    yield Planner(CollisionOracle(world))
    world.close()


@pytest.fixture
def session(planner: Planner) -> Iterator[Session]:
    """A session at the start of T1's second subtask's flow, the robot at home before the refrigerator."""
    scene = scene_at_paper_size("kitchen_t1")
    world = World(scene)
    start = np.array([scene.robot.position[0], scene.robot.position[1], scene.robot.yaw_rad, *PAPER_ROBOT.home])
    control = Controller(world, start, planner.kinematics.finger_upper_m, lambda: None)
    planner.start_subtask(world, 0, 0)
    subtask = t1().task.subtasks[1]
    yield Session(world, control, planner, subtask, subtask.flow or ())
    world.close()


def test_a_heading_is_measured_within_a_turn(session: Session) -> None:
    # A base that has turned round and round counts on; people read where it faces.
    turned = session.q
    turned[2] -= 4 * np.pi
    qpos = np.asarray(session.world.robot.get_qpos())
    qpos[2] = turned[2]
    session.world.robot.set_qpos(qpos)
    session.control.target[2] = turned[2]
    outcome = navigate_to_target(session, Action(Primitive.NAVIGATE_TO_TARGET))
    assert outcome.failure is None and session.q[2] < -2 * np.pi
    heading = measurements_json(outcome.measurements)["base_yaw_deg"]
    assert isinstance(heading, float) and abs(heading) <= 180.0
    assert np.cos(np.deg2rad(heading)) == pytest.approx(np.cos(session.q[2]), abs=1e-3)


def test_every_primitive_has_a_runner() -> None:
    assert set(LIBRARY) == set(Primitive)
    assert len(LIBRARY) == 21


def test_closing_on_air_is_a_missed_grasp(session: Session) -> None:
    outcome = grasp(session, Action(Primitive.GRASP))
    assert outcome.failure is not None
    assert outcome.failure.kind is FailureKind.GRASP_MISSED
    assert measurements_json(outcome.measurements)["fingers_touching"] == 0
    assert outcome.session.hand.held is None


def test_converging_without_an_approach_is_refused(session: Session) -> None:
    outcome = converge(session, Action(Primitive.CONVERGE))
    assert outcome.failure is not None and outcome.failure.kind is FailureKind.PRECONDITION


def test_articulating_without_a_handle_in_hand_is_refused(session: Session) -> None:
    outcome = articulate(session, Action(Primitive.ARTICULATE_OPEN))
    assert outcome.failure is not None and outcome.failure.kind is FailureKind.PRECONDITION


def test_an_open_number_that_nothing_planned_is_refused(session: Session) -> None:
    outcome = move(session, Action(Primitive.LIFT_EEF_UP))
    assert outcome.failure is not None and outcome.failure.kind is FailureKind.PRECONDITION


def test_retreating_at_home_and_opening_an_empty_hand_do_nothing(session: Session) -> None:
    before = session.q
    assert retreat(session, Action(Primitive.RETREAT)).measurements == (RetreatMeasured(already_home=True),)
    assert ungrasp(session, Action(Primitive.UNGRASP)).failure is None
    np.testing.assert_array_equal(session.q, before)


@pytest.mark.parametrize(
    ("primitive", "amount", "moved"),
    [
        (Primitive.MOVE_BASE_FORWARD, 0.1, (0.1, 0.0, 0.0)),
        (Primitive.MOVE_BASE_LEFT, 0.2, (0.0, 0.2, 0.0)),
        (Primitive.MOVE_BASE_RIGHT, 0.2, (0.0, -0.2, 0.0)),
        (Primitive.MOVE_BASE_BACKWARD, 0.3, (-0.3, 0.0, 0.0)),
        (Primitive.LIFT_EEF_UP, 0.1, (0.0, 0.0, 0.1)),
        (Primitive.LIFT_EEF_DOWN, 0.1, (0.0, 0.0, -0.1)),
        (Primitive.MOVE_EEF_FORWARD, 0.1, (0.1, 0.0, 0.0)),
        (Primitive.MOVE_EEF_BACKWARD, 0.05, (-0.05, 0.0, 0.0)),
        (Primitive.MOVE_EEF_LEFT, 0.1, (0.0, 0.1, 0.0)),
        (Primitive.MOVE_EEF_RIGHT, 0.1, (0.0, -0.1, 0.0)),
    ],
)
def test_parameterised_moves_do_what_their_number_says(
    session: Session, primitive: Primitive, amount: float, moved: tuple[float, float, float]
) -> None:
    before = session.planner.kinematics.forward(session.control.q)[:3, 3]
    outcome = move(session, Action(primitive, amount))
    after = session.planner.kinematics.forward(session.control.q)[:3, 3]
    assert outcome.failure is None
    np.testing.assert_allclose(after - before, moved, atol=2e-3)


@pytest.mark.parametrize(("primitive", "sign"), [(Primitive.TURN_BASE_LEFT, 1.0), (Primitive.TURN_BASE_RIGHT, -1.0)])
def test_turns_are_in_degrees_and_left_is_counter_clockwise(
    session: Session, primitive: Primitive, sign: float
) -> None:
    outcome = move(session, Action(primitive, 45.0))
    assert outcome.failure is None
    assert session.control.q[2] == pytest.approx(sign * np.pi / 4, abs=5e-3)


def test_what_the_arm_does_reach_is_told_where_it_does_not_reach_all(session: Session) -> None:
    asked = Action(Primitive.MOVE_EEF_FORWARD, 0.6)
    failure = move(session, asked).failure
    assert failure is not None and failure.kind is FailureKind.UNREACHABLE
    short = first_of(failure.measurements, OutOfReach)
    assert short is not None
    assert 0.0 < short.reach_m < 0.6 and short.reach_m + short.residual_m == pytest.approx(0.6, abs=1e-3)
    assert f"reaches {short.reach_m:.2f} m of 0.6 m" in failure.message
    assert move(session, Action(Primitive.MOVE_EEF_FORWARD, short.reach_m - 1e-4)).failure is None


def test_a_slide_before_a_retreat_is_kept_by_approach(session: Session) -> None:
    """The paper's T2 has RETREAT between NAVIGATE_TO_TARGET and APPROACH."""
    flow = (
        Action(Primitive.NAVIGATE_TO_TARGET),
        Action(Primitive.RETREAT),
        Action(Primitive.MOVE_BASE_LEFT, 0.02),
        Action(Primitive.RETREAT),
        Action(Primitive.APPROACH),
    )
    session = replace(session, flow=flow)
    hands = []
    for step, action in enumerate(flow):
        outcome = LIBRARY[action.primitive](replace(session, step=step), action)
        assert outcome.failure is None, outcome.failure
        session = outcome.session
        if step in (0, 4):
            assert session.plan.stance is not None
            hands.append(session.planner.kinematics.forward(session.plan.stance.approach[0])[:3, 3])
    hands.append(session.planner.kinematics.forward(session.control.q)[:3, 3])
    left = np.array([-np.sin(session.q[2]), np.cos(session.q[2]), 0.0])
    assert hands[1] - hands[0] == pytest.approx(0.02 * left, abs=1e-4)
    assert hands[2] == pytest.approx(hands[1], abs=2e-3)


def test_of_several_stances_the_one_nearest_to_home_is_taken_and_those_not_found_are_passed_over(
    session: Session, monkeypatch: pytest.MonkeyPatch
) -> None:
    home, planner = np.array(PAPER_ROBOT.home), session.planner
    away_rad = {0: None, 1: 0.5, 2: -0.2, 3: 0.2}
    monkeypatch.setattr(planner, "seed", 9)

    def posture(seed: int) -> np.ndarray | None:
        by = away_rad[seed]
        return None if by is None else home + by

    assert nearest_home(replace(session, stances=4), lambda: planner.seed, posture) == 2, "the first of equal ones"
    assert planner.seed == 2, "what is planned later goes on with it"
    assert nearest_home(replace(session, stances=1), lambda: "as it comes", lambda _: None) == "as it comes"
    assert nearest_home(replace(session, stances=1), lambda: planner.seed, posture) == 2, "one is not compared"
