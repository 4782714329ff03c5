"""Success comes from physics: nothing jumps, nothing is attached, nothing sinks in; side effects are told."""

from __future__ import annotations

from dataclasses import asdict

import numpy as np
import pytest

import bddl
import oag
from executor.records import FailureKind, Rollout
from executor.rollouts.goals import judge_at_rest
from executor.rollouts.run_record import rollout_json
from executor.sim.detectors import deepest_overlap, summarize_overlaps
from executor.sim.engine import ROBOT
from executor.skills.control import LIMIT_S, Controller
from executor.skills.trajectories import STOPS, acceleration_limits, speed_limits
from oag.measurements import measurements_json
from oag.model.robots import PAPER_ROBOT
from tests.executor.helpers import MakeWorld, at, settle
from tests.executor.rollouts.conftest import Components
from tests.executor.rollouts.tasks import t1

pytestmark = pytest.mark.physics

SPEED_LIMITS, ACCELERATION_LIMITS = speed_limits(PAPER_ROBOT), acceleration_limits(PAPER_ROBOT)
OVERSHOOT = 1.5
"""How much faster than its limit a driven joint may be for a tenth of a second."""

FASTEST_ITEM_M_S = 1.5
DEEPEST_P99_M = 0.003
BODIES = {"PhysxRigidStaticComponent", "PhysxRigidDynamicComponent", "PhysxArticulationLinkComponent"}


def test_it_succeeds(watched: tuple[Rollout, Components]) -> None:
    assert watched[0].failure is None and watched[0].succeeded


def test_no_joint_is_faster_than_its_limit(watched: tuple[Rollout, Components]) -> None:
    trajectory = watched[0].trajectory
    dt_s = np.diff(trajectory.time_s)[:, None]
    speeds = np.abs(np.diff(trajectory.robot_qpos[:, :10].astype(float), axis=0)) / dt_s
    assert (speeds.max(axis=0) < OVERSHOOT * SPEED_LIMITS).all(), speeds.max(axis=0)


def test_no_body_jumps(watched: tuple[Rollout, Components]) -> None:
    trajectory = watched[0].trajectory
    dt_s = np.diff(trajectory.time_s)
    for poses in trajectory.object_poses.values():
        speed = np.linalg.norm(np.diff(poses[:, :3].astype(float), axis=0), axis=1) / dt_s
        assert speed.max() < FASTEST_ITEM_M_S
    for joints in trajectory.joint_positions.values():
        assert (np.abs(np.diff(joints.astype(float), axis=0)) / dt_s[:, None]).max() < OVERSHOOT * SPEED_LIMITS[2]


def test_there_are_bodies_and_no_constraints_between_them(watched: tuple[Rollout, Components]) -> None:
    assert "glass_0" in watched[1].held
    assert watched[1].kinds <= BODIES, "a drive, gear or joint component would tie two bodies together"


def test_bodies_hardly_overlap(watched: tuple[Rollout, Components]) -> None:
    penetration = watched[0].penetration
    assert penetration.samples == len(watched[0].trajectory.time_s)
    assert 0.0 < penetration.p99_m <= penetration.deepest_m
    assert penetration.p99_m < DEEPEST_P99_M
    assert len(penetration.pair) == 2


def test_what_was_asked_of_the_robot_is_told_and_within_its_limits(watched: tuple[Rollout, Components]) -> None:
    peaks = watched[0].peaks
    assert rollout_json(watched[0])["peaks"] == asdict(peaks)
    assert 0.4 < peaks.base_m_s < OVERSHOOT * np.hypot(*SPEED_LIMITS[:2])
    assert peaks.yaw_rad_s < OVERSHOOT * SPEED_LIMITS[2] and peaks.arm_rad_s < OVERSHOOT * SPEED_LIMITS[3]
    assert 0.5 < peaks.base_m_s2 < OVERSHOOT * np.hypot(*ACCELERATION_LIMITS[:2])
    # A door that asks this much is opened in the episode, and nothing was asked for that the drives do not have.
    assert 10.0 < peaks.base_n < 495.0 and peaks.yaw_nm < 100.0
    assert peaks.shoulder_nm < 20.89 and 0.1 < peaks.wrist_nm < 2.882
    assert peaks.finger_n == 30.0


def test_the_record_tells_of_overlaps_and_side_effects(watched: tuple[Rollout, Components]) -> None:
    data = rollout_json(watched[0])
    assert data["penetration"] == {
        "p99_m": watched[0].penetration.p99_m,
        "deepest_m": watched[0].penetration.deepest_m,
        "pair": watched[0].penetration.pair,
        "samples": watched[0].penetration.samples,
    }
    # The glass is what the second and the third subtask move; the others must not.
    assert [dict(subtask.moved_m) for subtask in watched[0].subtasks] == [{}, {}, {}, {}]


def test_an_overlap_is_measured_with_its_pair(make_world: MakeWorld) -> None:
    world = make_world("kitchen_t1")
    settle(world, 0.2)
    assert deepest_overlap(world).depth_m < 1e-3
    T = world.T_world_link("glass_0")
    world.set_object_pose("glass_0", T @ at(0.0, 0.0, -0.01))
    world.step()
    found = deepest_overlap(world)
    assert found.depth_m == pytest.approx(0.01, abs=2e-3)
    assert set(found.pair) == {"glass_0/glass", "table_0/table"}
    assert summarize_overlaps([found]).p99_m == pytest.approx(found.depth_m, abs=1e-6)
    assert summarize_overlaps([]).samples == 0


def test_a_motion_that_takes_too_long_is_a_timeout(make_world: MakeWorld) -> None:
    world = make_world("kitchen_t1")
    start = np.array([-0.3, -0.1, 0.0, *PAPER_ROBOT.home])
    told: list[np.ndarray] = []
    control = Controller(world, start, 0.028, lambda: told.append(control.velocity))
    control.start_primitive()
    control.deadline_s -= LIMIT_S - 0.5
    end = start.copy()
    end[0] -= 1.0
    failure = control.follow(np.stack([start, end]))
    assert failure is not None and failure.kind is FailureKind.TIMEOUT
    assert measurements_json(failure.measurements)["time_s"] == pytest.approx(0.5, abs=0.1)
    assert control.q[0] > end[0] + 0.3, "the robot stops where it is"
    slower = np.abs(np.diff(told, axis=0)).max(axis=0) / world.timestep_s
    assert (slower <= 1.01 * STOPS * ACCELERATION_LIMITS).all(), "and slows down for it, no faster than its wheels can"
    assert slower[0] > 0.9 * STOPS * ACCELERATION_LIMITS[0], "which is faster than on a drive"


def test_a_thing_in_the_fingers_is_in_no_place_yet(make_world: MakeWorld) -> None:
    world = make_world("kitchen_t1")
    goal = oag.Task.from_json(t1().task.to_json(), scene=world.scene).goal
    place = world.T_world_link("refrigerator_0")[:3, 3] + [0.05, 0.0, 0.2]
    world.set_object_pose("glass_0", at(*place))
    world.step()
    assert all(reading.satisfied for reading in judge_at_rest(goal, world))
    hand = world.T_world_link(ROBOT, PAPER_ROBOT.tip_link)[:3, 3]
    for step in range(200):
        world.set_object_pose("glass_0", at(*hand))
        for joint in world.robot.active_joints[-2:]:
            joint.set_drive_target(0.028 * (1 - min(1.0, step / 50)))
        world.step()
    settle(world, 0.3)
    held = judge_at_rest(bddl.parse_formula("(and (not (open refrigerator_0)) (under glass_0 refrigerator_0))"), world)
    assert [reading.value for reading in held] == [False, False]
