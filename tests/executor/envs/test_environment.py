"""The environment keeps Gymnasium's rules, draws the benchmark's scenes, and loads nothing heavy before it must."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import executor.envs
from executor.bench.units import pair_of
from executor.datasets.formats.observations import AGENT, ENVIRONMENT, HANDLE, HANDLES, THING, THINGS
from executor.envs.environment import SceneEnvironment
from executor.robot.actions import joint_limits
from oag.model.scenefile import PAPER_SCALE
from tests.source_tree import ROOT

SEED, INDEX = 62990, 0
Make = Callable[..., SceneEnvironment]


@pytest.fixture
def make() -> Iterator[Make]:
    """Makes environments of T5 and closes them."""
    made: list[SceneEnvironment] = []

    def environment(family: Any = "T5", **options: Any) -> SceneEnvironment:
        made.append(SceneEnvironment(family, **options))
        return made[-1]

    yield environment
    for env in made:
        env.close()


def test_importing_it_registers_and_loads_no_simulator() -> None:
    code = (
        "import sys, gymnasium, executor.envs\n"
        "print('sapien' in sys.modules, sum(name.startswith('scene2demo/') for name in gymnasium.registry))"
    )
    run = {"cwd": ROOT, "capture_output": True, "text": True, "timeout": 120, "check": True}
    assert subprocess.run([sys.executable, "-c", code], **run).stdout.split() == ["False", "7"]  # type: ignore[call-overload]


def test_making_one_loads_no_simulator(make: Make) -> None:
    env = make()
    assert env.metadata["render_fps"] == 10 and isinstance(env.metadata["render_fps"], int)
    assert env.action_space.shape == (12,)
    with pytest.raises(gymnasium.error.ResetNeeded):
        env.step(env.action_space.sample())


@pytest.mark.physics
@pytest.mark.parametrize("action_mode", ["joint_target", "paper"])
@pytest.mark.parametrize("observation_mode", ["state", "point_cloud"])
@pytest.mark.filterwarnings("ignore:.*:UserWarning:gymnasium")
def test_gymnasium_finds_nothing_wrong(make: Make, action_mode: Any, observation_mode: Any) -> None:
    check_env(make(action_mode=action_mode, observation_mode=observation_mode, normalised=True))


@pytest.mark.physics
def test_a_seed_is_the_benchmarks(make: Make) -> None:
    env = make()
    observation, info = env.reset(seed=SEED, options={"index": INDEX})
    pair = pair_of("T5", SEED, INDEX)
    assert info["query"] == env.task_description == pair.query
    rows = observation["environment_state"][: THINGS * THING].reshape(THINGS, THING)
    target = pair.scene.objects[pair.task.subtasks[0].target]
    assert np.allclose(rows[0, 1:4], target.position, atol=1e-3) and rows[0, 0] == 1.0
    handles = observation["environment_state"][THINGS * THING :].reshape(HANDLES, HANDLE)
    assert handles[0, 0] == 1.0 and observation["agent_pos"].shape == (AGENT,) and ENVIRONMENT == THINGS * THING + 48
    assert info["success"] is False and info["is_success"] is False and 0.0 < info["progress"] < 1.0


@pytest.mark.physics
def test_equal_seeds_and_actions_give_equal_observations(make: Make) -> None:
    first, second = make(), make()
    for env in (first, second):
        env.reset(seed=SEED, options={"index": INDEX})
    low, high = joint_limits(PAPER_SCALE).T
    wanted = np.clip(first.target + 0.05, low, high).astype(np.float32)
    for _ in range(3):
        a, b = first.step(wanted), second.step(wanted)
        assert all(np.array_equal(a[0][name], b[0][name]) for name in a[0]) and a[1] == b[1]


@pytest.mark.physics
def test_targets_move_no_faster_than_planned_motions(make: Make) -> None:
    env = make()
    env.reset(seed=SEED)
    before = env.target
    env.step(env.action_space.high)
    moved = np.abs(env.target - before)
    assert np.all(moved[:3] <= [0.0501, 0.0501, 0.1001]) and np.all(moved[3:10] <= 0.1202)
    assert moved[:10].max() > 0.04


@pytest.mark.physics
def test_a_hand_action_moves_the_hand_so(make: Make) -> None:
    env = make(action_mode="paper")
    before = env.reset(seed=SEED)[0]["agent_pos"]
    after = before
    for _ in range(5):
        after = env.step(np.array([0, 0, 0.01, 0, 0, 0, 1, 0, 0, 0], np.float32))[0]["agent_pos"]
    after = env.step(np.array([0, 0, 0, 0, 0, 0, 1, 0, 0, 0], np.float32))[0]["agent_pos"]
    assert np.allclose((after - before)[12:15], [0.0, 0.0, 0.05], atol=2e-3)
    assert np.allclose((after - before)[:3], 0.0, atol=1e-3)


@pytest.mark.physics
def test_points_lie_on_the_models_and_follow_the_hand(make: Make) -> None:
    env = make(observation_mode="point_cloud", action_mode="paper")
    cloud = env.reset(seed=SEED)[0]["point_cloud"]
    assert cloud[:, 3].sum() == 128 and np.isfinite(cloud).all()
    for _ in range(6):
        after = env.step(np.array([0, 0, 0.01, 0, 0, 0, 1, 0, 0, 0], np.float32))[0]["point_cloud"]
    moved = (after - cloud)[:, :3]
    hand = cloud[:, 3] == 1.0
    assert np.allclose(moved[hand].mean(axis=0), [0.0, 0.0, 0.06], atol=0.015)
    assert np.allclose(moved[~hand], 0.0, atol=2e-3)


@pytest.mark.physics
@pytest.mark.slow
def test_processes_of_their_own_step_it() -> None:
    made = [lambda: gymnasium.make("executor.envs:scene2demo/T5-v0", disable_env_checker=True)] * 2
    envs = gymnasium.vector.AsyncVectorEnv(made, context="spawn")
    try:
        observations, _ = envs.reset(seed=[SEED, SEED])
        assert observations["agent_pos"].shape == (2, AGENT)
        assert np.array_equal(observations["agent_pos"][0], observations["agent_pos"][1])
        assert envs.call("_max_episode_steps") == (executor.envs.MOST_STEPS["T5"],) * 2
        assert len(set(envs.call("task_description"))) == 1
        _, rewards, *_ = envs.step(envs.action_space.sample())
        assert rewards.shape == (2,) and os.getpid() > 0
    finally:
        envs.close()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"family": "T1", "query": "open it"}, "a family; or a scene"),
        ({"query": "open it"}, "a family; or a scene"),
        ({"family": "T1", "action_mode": "velocity"}, "'joint_target', 'paper'"),
        ({"family": "T1", "rate_hz": 1000}, "1 to 250"),
    ],
)
def test_arguments_that_contradict_each_other_are_refused(arguments: dict[str, Any], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        SceneEnvironment(**arguments)


@pytest.mark.physics
def test_there_is_no_such_index(make: Make) -> None:
    with pytest.raises(ValueError, match="has no index 99"):
        make().reset(seed=SEED, options={"index": 99})


@pytest.mark.render
def test_pictures_are_drawn_of_three_views(make: Make) -> None:
    env = make(observation_mode="pixels", size=(64, 48), render_mode="rgb_array")
    observation, _ = env.reset(seed=SEED)
    assert observation in env.observation_space
    assert all(picture.std() > 5.0 for picture in observation["pixels"].values())
    drawn = env.render()
    assert drawn is not None and np.array_equal(drawn, observation["pixels"]["global"])
