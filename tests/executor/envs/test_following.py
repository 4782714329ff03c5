"""The arm follows the pose that hand actions add up to, at speeds that its joints have, and never owes much."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from executor.envs.hand_control import OWED_M, Elbow, HandFollower, arm_speeds
from executor.envs.scene_environment import target_speeds
from executor.geometry import Array
from executor.sim.robot.actions import OPENING, arm_chain, hand_actions, hand_numbers, joint_limits
from executor.sim.robot.description import FINGER_DRIVE
from executor.sim.world import World
from oag import Scene
from oag.model.robots import PAPER_ROBOT, ROBOTS, Robot
from oag.model.scene import RobotPose

pytestmark = pytest.mark.physics

PERIOD_S = 0.1
START = np.array([0.3, -0.2, 0.5, *PAPER_ROBOT.home, 0.028, 0.028])
STILL = np.array([0.0] * 6 + [1.0] + [0.0] * 3)


@pytest.fixture(scope="module")
def elbow() -> Iterator[Elbow]:
    """Return one with nothing around it but the floor."""
    with World(Scene("bare", RobotPose(), {}, (), frozenset())) as world:
        yield Elbow(world)


def _moved(x_m: float = 0.0, z_m: float = 0.0) -> Array:
    action = STILL.copy()
    action[0], action[2] = x_m, z_m
    return action


def _hand(target: Array) -> Array:
    return np.asarray(arm_chain(PAPER_ROBOT).forward(target[None, 3:10])[0, :3, 3])


def test_what_one_action_leaves_undone_the_next_ones_make_good(elbow: Elbow) -> None:
    follower, target = HandFollower(PAPER_ROBOT, START, 0.02, elbow), START
    before = _hand(START)
    target = follower.joint_target(target, _moved(x_m=0.04))
    assert np.linalg.norm(_hand(target) - before) < 0.03
    for _ in range(5):
        target = follower.joint_target(target, STILL)
    assert np.allclose(_hand(target) - before, [0.04, 0.0, 0.0], atol=1e-4)


def test_no_more_is_owed_than_comes_back_soon(elbow: Elbow) -> None:
    follower, target = HandFollower(PAPER_ROBOT, START, PERIOD_S, elbow), START
    for _ in range(20):
        target = follower.joint_target(target, _moved(x_m=0.1))
    stretched = _hand(target)
    for _ in range(8):
        target = follower.joint_target(target, _moved(x_m=-0.03))
    # Out of the stretched arm joints are at their fastest: another two periods make good what speeds left undone.
    for _ in range(2):
        target = follower.joint_target(target, STILL)
    assert _hand(target)[0] < stretched[0] - (8 * 0.03 - OWED_M) + 0.002


def test_joints_keep_to_their_limits_and_speeds_and_the_hand_to_its_way(elbow: Elbow) -> None:
    follower, target = HandFollower(PAPER_ROBOT, START, PERIOD_S, elbow), START
    rng = np.random.default_rng(62000)
    low, high = joint_limits(PAPER_ROBOT)[3:10].T
    # Smooth wandering about where the arm begins, as fast as hands of demonstrations are.
    ways = 0.12 * np.sin(np.arange(200)[:, None] * rng.uniform(0.02, 0.08, 3))
    for step in np.diff(ways, axis=0):
        action = STILL.copy()
        action[:3] = step
        after = follower.joint_target(target, action)
        assert (np.abs(after - target)[3:10] <= arm_speeds(PAPER_ROBOT) * PERIOD_S + 1e-9).all()
        assert (after[3:10] >= low).all() and (after[3:10] <= high).all()
        target = after
    assert np.allclose(_hand(target), _hand(START) + ways[-1] - ways[0], atol=2e-3)


@pytest.mark.parametrize("robot", ROBOTS.values(), ids=ROBOTS)
def test_the_arm_of_every_robot_follows_a_hand(robot: Robot) -> None:
    with World(Scene("bare", RobotPose(name=robot.name), {}, (), frozenset())) as world:
        target = np.array([*robot.start(0.3, -0.2, 0.5), 0.02, 0.02])
        follower = HandFollower(robot, target, PERIOD_S, Elbow(world))
        action = np.zeros(hand_numbers(robot))
        action[2], action[OPENING] = -0.01, 1.0
        before = arm_chain(robot).forward(target[None, robot.arm])[0]
        for _ in range(10):
            target = follower.joint_target(target, action)
        before[2, 3] -= 0.1
        assert np.allclose(arm_chain(robot).forward(target[None, robot.arm])[0], before, atol=2e-3)


def test_a_hand_that_is_told_nothing_leaves_the_arm_alone(elbow: Elbow) -> None:
    follower = HandFollower(PAPER_ROBOT, START, PERIOD_S, elbow)
    assert np.allclose(follower.joint_target(START, STILL), START, atol=1e-6)


def test_fingers_press_as_they_were_told(elbow: Elbow) -> None:
    pressing_m = -FINGER_DRIVE[2] / FINGER_DRIVE[0]
    assert np.allclose(joint_limits(PAPER_ROBOT)[10:, 0], pressing_m)
    pressed = START.copy()
    pressed[10:] = pressing_m
    action = hand_actions(PAPER_ROBOT, START, pressed)[0]
    assert np.allclose(
        HandFollower(PAPER_ROBOT, START, PERIOD_S, elbow).joint_target(START, action), pressed, atol=1e-6
    )


def test_only_an_arm_that_follows_is_faster_than_planned_motions() -> None:
    following, planned = (target_speeds(PAPER_ROBOT, following=following) for following in (True, False))
    assert (following[3:10] > planned[3:10]).all()
    assert np.array_equal(following[[0, 1, 2, 10, 11]], planned[[0, 1, 2, 10, 11]])
