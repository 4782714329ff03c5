"""The arm's own kinematics agree with SAPIEN's and with pytorch-kinematics', and lines follow their poses."""

from __future__ import annotations

import numpy as np
import pytest

from executor.data.state_readers import HAND_POINTS, CloudReader
from executor.sim.robot.description import BASE_LINK, robot_urdf
from executor.sim.robot.kinematics import ArmChain, Kinematics
from oag.model.robots import PAPER_ROBOT
from tests.executor.helpers import MakeWorld

pytestmark = pytest.mark.physics


@pytest.fixture(scope="module")
def chain() -> ArmChain:
    return ArmChain(robot_urdf(visual=False), BASE_LINK, PAPER_ROBOT.tip_link)


def postures(count: int) -> np.ndarray:
    return np.random.default_rng(0).uniform(-1.5, 1.5, (count, 7))


def test_poses_agree_with_the_engine(chain: ArmChain, make_world: MakeWorld) -> None:
    world = make_world("kitchen_t1")
    kinematics = Kinematics(world.robot, world.model)
    arms = postures(20)
    for arm, T in zip(arms, chain.forward(arms), strict=True):
        np.testing.assert_allclose(T, kinematics.forward(np.concatenate([np.zeros(3), arm])), atol=1e-5)


def test_poses_and_jacobians_agree_with_pytorch_kinematics(chain: ArmChain) -> None:
    pk = pytest.importorskip("pytorch_kinematics")
    torch = pytest.importorskip("torch")
    robot = robot_urdf(visual=False).read_bytes()
    theirs = pk.build_serial_chain_from_urdf(robot, PAPER_ROBOT.tip_link, root_link_name=BASE_LINK).to(
        dtype=torch.float64
    )
    arms = postures(10)
    poses, jacobians = chain.forward_and_jacobian(arms)
    np.testing.assert_allclose(poses, theirs.forward_kinematics(torch.as_tensor(arms)).get_matrix().numpy(), atol=1e-6)
    np.testing.assert_allclose(jacobians, theirs.jacobian(torch.as_tensor(arms)).numpy(), atol=1e-6)


def test_a_clouds_points_on_the_hand_are_where_pytorch_kinematics_has_them(make_world: MakeWorld) -> None:
    pk = pytest.importorskip("pytorch_kinematics")
    torch = pytest.importorskip("torch")
    world = make_world("kitchen_t1")
    chain = pk.build_chain_from_urdf(robot_urdf(world.model, visual=False).read_bytes())
    chain = chain.to(dtype=torch.float64)
    names = [joint.name for joint in world.robot.active_joints]
    random, cloud = np.random.default_rng(0), CloudReader(world, ("glass_0",), 0)
    told, seen = [], []
    for _ in range(5):
        base, arm, fingers = random.uniform(-1.0, 1.0, 3), random.uniform(-1.5, 1.5, 7), random.uniform(0.0, 0.02, 2)
        world.robot.set_qpos(np.concatenate([base, arm, fingers]))
        points = cloud.read()
        seen.append(points[points[:, 3] == 1.0][:, :3])
        told.append(dict(zip(names, world.robot.get_qpos(), strict=True)))
    columns = {name: torch.tensor([row[name] for row in told]) for name in chain.get_joint_parameter_names()}
    links = {link: T.get_matrix().numpy() for link, T in chain.forward_kinematics(columns).items()}
    # Which of the three links a point is on, the cloud does not say: it moves as one of them does, and as that alone.
    moves = [
        np.linalg.inv(links[BASE_LINK]) @ links[link] for link in (PAPER_ROBOT.hand_link, *PAPER_ROBOT.finger_links)
    ]
    first = np.concatenate([seen[0], np.ones((len(seen[0]), 1))], axis=1)
    away_m = [
        [np.linalg.norm((first @ (T[k] @ np.linalg.inv(T[0])).T)[:, :3] - seen[k], axis=1) for k in range(1, 5)]
        for T in moves
    ]
    worst_m = np.array(away_m).max(axis=1)
    assert len(first) == HAND_POINTS and worst_m.min(axis=0).max() < 1e-5
    assert {int(link) for link in worst_m.argmin(axis=0)} == {0, 1, 2}, "hand and both fingers have points"


def test_jacobians_are_the_slopes_of_the_poses(chain: ArmChain) -> None:
    arms, step = postures(5), 1e-6
    poses, jacobians = chain.forward_and_jacobian(arms)
    for j in range(arms.shape[1]):
        moved = arms.copy()
        moved[:, j] += step
        slope = (chain.forward(moved)[:, :3, 3] - poses[:, :3, 3]) / step
        np.testing.assert_allclose(jacobians[:, :3, j], slope, atol=1e-5)


def test_links_that_no_chain_connects_are_refused() -> None:
    with pytest.raises(ValueError, match="no joints from panda_hand to panda_link1"):
        ArmChain(robot_urdf(visual=False), "panda_hand", "panda_link1")
    with pytest.raises(ValueError, match="base_x is prismatic"):
        ArmChain(robot_urdf(visual=False), "world_root", PAPER_ROBOT.tip_link)
