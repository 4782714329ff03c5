"""What boxes show to be free is free for the engine; paths get the engine's answers, at the same effort."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from executor.geometry import Array, inverse
from executor.planning.cargo import carried_by
from executor.planning.collision import CollisionOracle, fingers_may_touch
from executor.planning.paths import segment
from executor.scenes import library
from executor.sim.world import World
from oag.model.robots import LIFTED, PAPER_ROBOT, Robot
from tests.executor.helpers import scene_at_paper_size

pytestmark = pytest.mark.physics
DOOR = ("refrigerator_0", "door_hinge")
MARGINS_M = (0.0, 0.003, 0.012, 0.03)


@pytest.fixture(scope="module", params=[PAPER_ROBOT, LIFTED], ids=lambda robot: robot.name)
def oracle(request: pytest.FixtureRequest) -> Iterator[CollisionOracle]:
    """Of kitchen_t1, with the paper's robot and with one that lifts."""
    robot: Robot = request.param
    scene = (
        scene_at_paper_size("kitchen_t1") if robot.keeps_order else library.load("kitchen_t1").with_robot(robot.name)
    )
    with World(scene) as world, World(scene, oracle=True) as oracle_world:
        world.step()
        oracle = CollisionOracle(oracle_world)
        oracle.synchronize(world)
        yield oracle


def configurations(oracle: CollisionOracle, seed: int, count: int) -> Array:
    """Return (N, Q) configurations about the furniture, half of the arms near the posture at home."""
    kinematics, robot = oracle.kinematics, oracle.robot
    rng = np.random.default_rng(seed)
    lift = [[0.0], [robot.lift_m]] if robot.lift_m else [[], []]
    base = rng.uniform([-0.6, -1.4, -np.pi, *lift[0]], [1.6, 1.0, np.pi, *lift[1]], (count, 3 + len(lift[0])))
    anyhow = rng.uniform(kinematics.arm_lower, kinematics.arm_upper, (count, len(robot.home)))
    at_home = np.array(robot.home) + rng.normal(0.0, 0.2, anyhow.shape)
    return np.concatenate([base, np.where(rng.uniform(size=(count, 1)) < 0.5, anyhow, at_home)], axis=1)


def take(oracle: CollisionOracle, name: str) -> None:
    """Let the hand hold a thing by its middle."""
    q = np.concatenate([np.zeros(len(oracle.robot.base_joints)), oracle.robot.home])
    T_world_eef = oracle.kinematics.forward(q)
    off = np.eye(4)
    off[:3, 3] = (inverse(oracle.world.T_world_link(name)) @ T_world_eef)[:3, 3]
    oracle.carried = carried_by(oracle.world, name, oracle.world.T_world_link(name) @ off)


@settings(max_examples=40, deadline=None)
@given(
    seed=st.integers(0, 10**6),
    margin_m=st.sampled_from(MARGINS_M),
    door_rad=st.floats(0.0, 1.8),
    opening=st.floats(0.0, 1.0),
    holds=st.booleans(),
    same_arm=st.booleans(),
)
def test_what_boxes_show_to_be_free_is_free(
    oracle: CollisionOracle,
    seed: int,
    margin_m: float,
    door_rad: float,
    opening: float,
    holds: bool,
    same_arm: bool,
) -> None:
    oracle.carried = None
    oracle.set_joint(DOOR, door_rad)
    if holds:
        take(oracle, "glass_0")
    path = configurations(oracle, seed, 12)
    if same_arm:
        path[:, 3:] = path[0, 3:]
    opening_m = opening * oracle.kinematics.finger_upper_m
    surely = oracle.surely_free(path, opening_m=opening_m, margin_m=margin_m)
    for q in path[surely]:
        assert oracle.hits(q, opening_m=opening_m, margin_m=margin_m) == []


def test_most_of_what_is_free_is_known_without_the_engine(oracle: CollisionOracle) -> None:
    oracle.carried = None
    path = configurations(oracle, 1, 300)
    free = np.array([oracle.is_free(q, margin_m=0.003) for q in path])
    surely = oracle.surely_free(path, margin_m=0.003)
    assert not (surely & ~free).any()
    assert surely.sum() > 0.6 * free.sum() > 20


def test_a_box_that_is_nearer_than_the_margin_is_left_to_the_engine(oracle: CollisionOracle) -> None:
    oracle.carried = None
    oracle.set_joint(DOOR, 0.0)
    home = np.concatenate([np.zeros(len(oracle.robot.base_joints)), oracle.robot.home])
    # Straight towards the refrigerator, a millimetre at a time.
    drive = np.array([home + x * np.eye(len(home))[0] for x in np.arange(-0.3, 0.9, 0.001)])
    free = np.array([oracle.is_free(q, margin_m=0.03) for q in drive])
    surely = oracle.surely_free(drive, margin_m=0.03)
    assert free[0]
    last, last_sure = int(np.flatnonzero(~free)[0]), int(np.flatnonzero(~surely)[0])
    assert last - 3 <= last_sure <= last


def test_what_may_touch_does_not_count_and_else_it_does(oracle: CollisionOracle) -> None:
    oracle.carried = None
    robot, kinematics = oracle.robot, oracle.kinematics
    q = np.concatenate([np.zeros(len(robot.base_joints)), robot.home])
    # The glass between the open fingers, and nothing else near.
    q[:2] += (-2.0, 2.0)
    T = np.eye(4)
    T[:3, 3] = kinematics.forward(q)[:3, 3]
    with World(oracle.world.scene) as world:
        before = world.T_world_link("glass_0")
        world.set_object_pose("glass_0", T)
        oracle.synchronize(world)
        touch = fingers_may_touch(robot, "glass_0", hand=True)
        assert not oracle.surely_free(q[None], margin_m=0.012)[0]
        assert oracle.surely_free(q[None], margin_m=0.012, allowed=touch)[0]
        world.set_object_pose("glass_0", before)
        oracle.synchronize(world)


def test_paths_get_the_answers_of_the_engine_at_the_same_effort(
    oracle: CollisionOracle, monkeypatch: pytest.MonkeyPatch
) -> None:
    oracle.carried = None
    effort, ends = oracle.kinematics.effort, configurations(oracle, 2, 60)

    def answers() -> list[object]:
        found: list[object] = []
        for start, end in zip(ends[::2], ends[1::2], strict=True):
            path = segment(oracle.robot, start, start + 0.1 * (end - start))
            for margin_m in (0.0, 0.012):
                before = effort.queries
                found += [oracle.is_path_free(path, margin_m=margin_m), oracle.first_hit(path, margin_m=margin_m)]
                found.append(effort.queries - before)
        return found

    known = answers()
    monkeypatch.setattr(CollisionOracle, "surely_free", lambda self, path, **_: np.zeros(len(path), dtype=bool))
    assert known == answers()
    assert {True, False} <= {answer for answer in known if isinstance(answer, bool)}
