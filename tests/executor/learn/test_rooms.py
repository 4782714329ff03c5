"""What a policy knows of the room, how it learns of the mirror image, and how it chooses a way of grasping."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch

from executor.data.formats.export import open_set
from executor.data.state_readers import ENVIRONMENT, THING, THINGS, agent_numbers
from executor.data.store import EpisodeStore
from executor.learn.acting import TrainedPolicy
from executor.learn.action_chunks import action_size, to_world_targets
from executor.learn.demonstrations import read_demonstrations
from executor.learn.observations import (
    FAR_FROM_BASE_M,
    FAR_FROM_TARGET_M,
    hinge_m,
    mirror_columns,
    mirror_joints,
    surrounding_numbers,
)
from executor.learn.policy_record import PolicyRecord
from executor.learn.settings import SettingsError
from executor.learn.training import Trainer
from executor.sim.robot.actions import arm_chain
from oag.model.robots import PAPER_ROBOT
from tests.executor.learn.conftest import small

AGENT = agent_numbers(PAPER_ROBOT)

pytestmark = pytest.mark.physics


def room() -> tuple[np.ndarray, np.ndarray]:
    """Return the robot at 1, 0, facing along y, before a box of 0.4 by 0.6 m at 1, 1 with a low thing beside it."""
    agent, environment = np.zeros((1, AGENT)), np.zeros((1, ENVIRONMENT))
    agent[0, :3] = 1.0, 0.0, np.pi / 2
    rows = environment[:, : THINGS * THING].reshape(1, THINGS, THING)
    rows[0, 0] = [1, 1.0, 1.0, 0.5, 0, 0, 0, 1, 0.4, 0.6, 1.0, 1.0, 1.0, 0.5]
    rows[0, 1] = [1, 1.3, 1.0, 0.5, 0, 0, 0, 1, 0.2, 0.2, 0.2, 1.3, 1.0, 0.5]
    return agent, environment


def test_room_is_told_from_the_base_and_from_what_is_taken() -> None:
    agent, environment = room()
    found = surrounding_numbers(agent, environment, environment[0], 4)[0]
    # Corners by the box's axes, seen by who faces along y: ahead is y, left is -x.
    assert np.allclose(found[:8].reshape(4, 2), [[1.3, -0.2], [0.7, -0.2], [0.7, 0.2], [1.3, 0.2]])
    assert np.allclose(found[10:14], [0.7, *[FAR_FROM_BASE_M] * 3])
    assert np.allclose(found[14:], [FAR_FROM_TARGET_M, FAR_FROM_TARGET_M, FAR_FROM_TARGET_M, 0.2])
    # What is as high no more is not in a hand's way.
    environment[:, THING + 3] = 1.5
    assert np.allclose(surrounding_numbers(agent, environment, environment[0], 4)[0, 14:], FAR_FROM_TARGET_M)


@pytest.mark.parametrize(("turn", "yaw"), [((0, 0, 0, 1), 0.0), ((0, 0, 1, 0), np.pi)])
def test_a_hinge_is_at_the_far_edge_or_at_its_own_side_of_two_doors(turn: tuple[float, ...], yaw: float) -> None:
    _, environment = room()
    environment[0, 4:8] = turn

    def at(*bar_m: float) -> list[float]:
        x, y = np.array([np.cos(yaw), np.sin(yaw)])
        return [1, 0, 0, 1.0 + x * bar_m[0] - y * bar_m[1], 1.0 + y * bar_m[0] + x * bar_m[1], 0.7]

    handles = environment[0, THINGS * THING :].reshape(-1, 6)
    handles[0] = at(-0.23, 0.2)
    along = np.array([np.cos(yaw), np.sin(yaw)])
    across = np.array([-along[1], along[0]])
    middle = np.array([1.0, 1.0])
    assert np.allclose(hinge_m(environment[0]), middle - 0.2 * along - 0.3 * across)
    handles[0], handles[1] = at(-0.23, -0.02), at(-0.23, 0.08)
    assert np.allclose(hinge_m(environment[0]), middle - 0.2 * along - 0.3 * across)
    handles[1] = at(-0.23, -0.12)
    assert np.allclose(hinge_m(environment[0]), middle - 0.2 * along + 0.3 * across)
    handles[1, 5] = 0.3  # Of a drawer below.
    handles[0] = at(-0.23, -0.2)
    assert np.allclose(hinge_m(environment[0]), middle - 0.2 * along + 0.3 * across)


def test_a_mirror_image_is_what_the_robot_would_look_like_in_a_mirror(picked: EpisodeStore) -> None:
    rng = np.random.default_rng(0)
    joints = np.zeros((4, 12))
    joints[:, 3:10] = rng.uniform(-1.0, 1.0, (4, 7))
    chain, mirror = arm_chain(PAPER_ROBOT), np.diag([1.0, -1.0, 1.0, 1.0])
    seen = mirror @ chain.forward(joints[:, 3:10]) @ mirror
    assert np.allclose(chain.forward(mirror_joints(PAPER_ROBOT, joints)[:, 3:10]), seen)

    columns = {name: column.copy() for name, column in next(iter(open_set(picked.path, ()).episodes())).columns.items()}
    columns["observation.state"][:, 9] = columns["action.joint_target"][:, 9] = 0.5
    image = mirror_columns(PAPER_ROBOT, columns)
    assert image is not None
    again = mirror_columns(PAPER_ROBOT, image)
    assert again is not None
    for name in (
        "observation.state",
        "observation.environment_state",
        "action",
        "action.joint_target",
        "primitive_index",
    ):
        assert np.allclose(again[name], columns[name], atol=1e-6)
    sides = mirror_columns(PAPER_ROBOT, {**columns, "primitive_index": np.array([17, 15, 16, 20, 11, 7])})
    assert sides is not None and sides["primitive_index"].tolist() == [17, 16, 15, 21, 12, 7]
    columns["action.joint_target"][0, 9] = -2.0
    assert mirror_columns(PAPER_ROBOT, columns) is None


def test_mirror_images_are_learned_from_and_a_way_is_chosen(picked: EpisodeStore, tmp_path: Path) -> None:
    settings = small(sees={"room": 4, "chooses": True}, training={"mirror": True})
    plain, both = read_demonstrations([picked.path], small()), read_demonstrations([picked.path], settings)
    assert both.names == plain.names and both.key == plain.key
    assert len(plain) <= len(both) <= 2 * len(plain)
    begun = both.begins.astype(bool)
    assert begun[both.starts].all() and (both.phases[begun] == both.steps.index(17)).all()
    record = PolicyRecord.of(settings, 0, both)
    Trainer(tmp_path, record, both).run(lambda step, loss: None)
    actor = TrainedPolicy.load(tmp_path)
    actor.begin([17, 1, 2, 3, 7], 0)
    agent, environment = room()
    actor.act({"agent_pos": agent[0] + np.eye(AGENT)[18], "environment_state": environment[0]})
    assert actor._grasp_modes.keys() == {0} and actor._grasp_modes[0] < record.grasp_modes
    straight = PolicyRecord.of(small(network={"linear": True}), 0, plain).network().eval()
    seen = torch.randn(1, 1, plain.numbers.shape[1])
    steps = [torch.full((1, 1), phase) for phase in (0, 1)]
    with torch.no_grad():
        for member in straight.members:
            member.action[-1].weight.zero_()  # type: ignore[union-attr,operator,index]
    first, second = (straight(seen, phase, grasp_mode=torch.zeros_like(phase)).actions for phase in steps)
    doubled = straight(2 * seen, steps[0], grasp_mode=torch.zeros_like(steps[0])).actions
    base = straight(0 * seen, steps[0], grasp_mode=torch.zeros_like(steps[0])).actions
    assert torch.allclose(doubled - base, 2 * (first - base), atol=1e-5) and not torch.allclose(first, second)
    numbers, none = torch.zeros(1, 1, record.sizes.numbers), torch.zeros(1, 1, dtype=torch.int64)
    assert record.network().eval()(numbers, none, grasp_mode=none).grasp_modes.shape == (1, record.grasp_modes)


def test_joints_are_put_right_by_where_the_hand_is_foretold_to_be(picked: EpisodeStore) -> None:
    settings = small(acts={"hand": True})
    data = read_demonstrations([picked.path], settings)
    assert action_size(settings.acts, PAPER_ROBOT) == 17
    moment = int(np.flatnonzero(data.phases == data.steps.index(2))[0])
    chunk = data.chunks(np.array([moment]), 8)[0][0]
    exact = to_world_targets(PAPER_ROBOT, data.qpos[moment], chunk[:, :11])
    askew = chunk.copy()
    askew[:, 3:10] += np.random.default_rng(0).normal(0.0, 0.03, (8, 7))
    hands = arm_chain(PAPER_ROBOT).forward(exact[:, 3:10])
    right, wrong = (
        arm_chain(PAPER_ROBOT).forward(to_world_targets(PAPER_ROBOT, data.qpos[moment], numbers)[:, 3:10])
        for numbers in (askew, askew[:, :11])
    )
    assert np.abs(right - hands)[:, :3, 3].max() < 1e-3 < 5e-3 < np.abs(wrong - hands)[:, :3, 3].max()
    with pytest.raises(SettingsError, match="hand's already"):
        small(acts={"hand": True, "kind": "paper"})
