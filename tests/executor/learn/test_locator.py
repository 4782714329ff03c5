"""Where things are told to be from clouds, and a policy that acts on that and on nothing else of the simulator."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch

from executor.data.store import EpisodeStore
from executor.learn.acting import TrainedPolicy
from executor.learn.demonstrations import Demonstrations, read_demonstrations
from executor.learn.evaluation import environment_for
from executor.learn.networks import Locator, PolicyNetwork
from executor.learn.observations import THING_NUMBERS, robot_number_count
from executor.learn.policy_record import PolicyRecord
from executor.learn.settings import PolicySettings
from executor.learn.training import Trainer
from oag.model.robots import PAPER_ROBOT
from tests.executor.learn.conftest import small

ROBOT_NUMBERS = robot_number_count(PAPER_ROBOT)

pytestmark = pytest.mark.physics
FROM_HAND = slice(4, 7)


def settings(steps: int = 40) -> PolicySettings:
    return small(
        sees={"kind": "cloud", "locates": True, "points": 128, "handles": 0},
        network={"point_widths": [16, 32]},
        training={"steps": steps, "batch": 16, "clouds": 16, "learning_rate": 3e-3, "warm_up": 1},
    )


@pytest.fixture(scope="module")
def data(picked: EpisodeStore) -> Demonstrations:
    return read_demonstrations([picked.path], settings())


def test_the_hands_points_stand_still_when_seen_from_the_hand(data: Demonstrations) -> None:
    assert data.clouds is not None and data.numbers.shape[1] == ROBOT_NUMBERS + THING_NUMBERS
    seen: list[torch.Tensor] = []
    locator = Locator(17, 1, 0, (8,))
    locator.whole.register_forward_pre_hook(lambda _, given: seen.append(given[0]))
    moments = np.arange(int(data.ends[0]))
    with torch.inference_mode():
        locator(*(torch.from_numpy(part[moments].astype(np.float32)) for part in (data.clouds, robots(data))))
    points = seen[0].numpy()
    moved_m, of_hand = np.ptp(points, axis=0), points[0, :, 3] == 1.0
    palm = of_hand & (moved_m[:, FROM_HAND].max(axis=1) < 0.004)
    assert palm.sum() > of_hand.sum() / 3 and (moved_m[of_hand, FROM_HAND] < 0.05).all()
    assert (moved_m[of_hand, :3].max(axis=1) > 0.1).all() and (moved_m[~of_hand, FROM_HAND].max(axis=1) > 0.1).all()


def robots(data: Demonstrations) -> np.ndarray:
    return data.numbers[:, :ROBOT_NUMBERS]


def test_training_brings_places_nearer_and_the_policy_acts_on_a_cloud_alone(data: Demonstrations, out: Path) -> None:
    record = PolicyRecord.of(settings(), 0, data)
    assert data.clouds is not None
    moments = np.arange(0, len(data), 7)
    robot, cloud = robots(data)[moments], data.clouds[moments].astype(np.float32)

    def off_m(network: PolicyNetwork) -> float:
        told = network.located(robot, cloud)
        assert np.array_equal(told[:, :ROBOT_NUMBERS], robot)
        return float(np.abs(told[:, -3:] - data.numbers[moments, -3:]).mean())

    torch.manual_seed(0)
    before = off_m(record.network().eval())
    Trainer(out, record, data).run(lambda step, loss: None)
    actor = TrainedPolicy.load(out)
    assert off_m(actor._network) < 0.6 * before
    env = environment_for(actor, record.kinds[0])
    observation, _ = env.reset(seed=62985)
    assert set(observation) == {"agent_pos", "point_cloud"}
    actor.begin(record.steps, 62985)
    action = actor.act(observation)
    assert action.shape == (12,) and np.isfinite(action).all()
    env.close()
