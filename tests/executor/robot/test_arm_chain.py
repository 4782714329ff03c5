"""The arm's own kinematics agree with SAPIEN's and with pytorch-kinematics', and lines follow their poses."""

from __future__ import annotations

import numpy as np
import pytest

from executor.robot.description import BASE_LINK, TCP_LINK, robot_urdf
from executor.robot.kinematics import Kinematics
from executor.robot.tracking import ArmChain
from tests.executor.helpers import MakeWorld

pytestmark = pytest.mark.physics


@pytest.fixture(scope="module")
def chain() -> ArmChain:
    return ArmChain(robot_urdf(visual=False), BASE_LINK, TCP_LINK)


def postures(count: int) -> np.ndarray:
    return np.random.default_rng(0).uniform(-1.5, 1.5, (count, 7))


def test_poses_agree_with_the_engine(chain: ArmChain, make_world: MakeWorld) -> None:
    kinematics = Kinematics(make_world("kitchen_t1").robot)
    arms = postures(20)
    for arm, T in zip(arms, chain.forward(arms), strict=True):
        np.testing.assert_allclose(T, kinematics.forward(np.concatenate([np.zeros(3), arm])), atol=1e-5)


def test_poses_and_jacobians_agree_with_pytorch_kinematics(chain: ArmChain) -> None:
    pk = pytest.importorskip("pytorch_kinematics")
    torch = pytest.importorskip("torch")
    robot = robot_urdf(visual=False).read_bytes()
    theirs = pk.build_serial_chain_from_urdf(robot, TCP_LINK, root_link_name=BASE_LINK).to(dtype=torch.float64)
    arms = postures(10)
    poses, jacobians = chain.forward_and_jacobian(arms)
    np.testing.assert_allclose(poses, theirs.forward_kinematics(torch.as_tensor(arms)).get_matrix().numpy(), atol=1e-6)
    np.testing.assert_allclose(jacobians, theirs.jacobian(torch.as_tensor(arms)).numpy(), atol=1e-6)


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
        ArmChain(robot_urdf(visual=False), "world_root", TCP_LINK)
