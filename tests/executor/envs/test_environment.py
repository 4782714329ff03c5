"""The environment keeps Gymnasium's rules, draws the benchmark's scenes, and loads nothing heavy before it must."""

from __future__ import annotations

import copy
import json
import os
import pickle
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import executor.envs
from executor.data.state_readers import ENVIRONMENT, HANDLE, HANDLES, THING, THINGS, agent_numbers
from executor.data.units import Variation
from executor.envs.scene_environment import SceneEnvironment
from executor.scenes.generators.families import pair_of
from executor.sim.engine import Physics
from executor.sim.robot.actions import joint_limits
from oag.model.robots import LIFTED, PAPER_ROBOT
from tests.source_tree import ROOT

AGENT = agent_numbers(PAPER_ROBOT)

SEED, INDEX = 62990, 0
Make = Callable[..., SceneEnvironment]


@pytest.fixture
def make() -> Iterator[Make]:
    """Make environments of T5 and closes them."""
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


REGISTERED = (
    "import gymnasium, sys\n"
    "assert 'sapien' not in sys.modules and 'lark' not in sys.modules, 'too much for who wants other environments'\n"
    "import executor.envs\n"
    "env = gymnasium.make('scene2demo/T1-v0')\n"
    "print(env.spec.id, sum(name.startswith('scene2demo/') for name in gymnasium.registry))"
)


@pytest.mark.slow
def test_gymnasium_alone_makes_them_where_what_the_wheel_has_is_installed(tmp_path: Path) -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())
    installed = tmp_path / "scene2demo-9.dist-info"
    installed.mkdir()
    (installed / "METADATA").write_text("Metadata-Version: 2.1\nName: scene2demo\nVersion: 9\n")
    points = project["project"]["entry-points"]
    text = "".join(
        f"[{group}]\n" + "".join(f"{k} = {v}\n" for k, v in names.items()) for group, names in points.items()
    )
    (installed / "entry_points.txt").write_text(text)
    for source, name in project["tool"]["hatch"]["build"]["targets"]["wheel"]["force-include"].items():
        shutil.copy(ROOT / source, tmp_path / name)
    # Before the packages of whatever is installed here.
    code = f"import site, sys; sys.path.insert(0, {str(tmp_path)!r}); site.addsitedir({str(tmp_path)!r})\n"
    alone = code + REGISTERED.replace("import executor.envs\n", "")
    for started in (alone, code + REGISTERED, f"import executor.envs\n{alone}"):
        run = [sys.executable, "-W", "error", "-c", started]
        found = subprocess.run(run, cwd=ROOT, capture_output=True, text=True, timeout=120, check=False)
        assert found.stdout.split() == ["scene2demo/T1-v0", "7"], found.stderr


def test_gymnasium_alone_makes_them_after_the_set_up(tmp_path: Path) -> None:
    """Whoever changed what the wheel has runs `make setup` again."""
    code = REGISTERED.replace("import executor.envs\n", "")
    run = [sys.executable, "-c", code]
    found = subprocess.run(run, cwd=tmp_path, capture_output=True, text=True, timeout=120, check=False)
    assert found.stdout.split() == ["scene2demo/T1-v0", "7"], found.stderr


def test_making_one_loads_no_simulator(make: Make) -> None:
    env = make()
    assert env.metadata["render_fps"] == 10 and isinstance(env.metadata["render_fps"], int)
    assert env.action_space.shape == (12,)
    with pytest.raises(gymnasium.error.ResetNeeded):
        env.step(env.action_space.sample())


@pytest.mark.slow
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
    low, high = joint_limits(PAPER_ROBOT).T
    wanted = np.clip(first.target + 0.05, low, high).astype(np.float32)
    for _ in range(3):
        a, b = first.step(wanted), second.step(wanted)
        assert all(np.array_equal(a[0][name], b[0][name]) for name in a[0]) and a[1] == b[1]


@pytest.mark.physics
@pytest.mark.parametrize("action_mode", ["joint_target", "paper"])
@pytest.mark.parametrize("wrong", [np.nan, np.inf, -np.inf])
def test_an_action_that_is_no_number_is_refused_and_moves_nothing(make: Make, action_mode: Any, wrong: float) -> None:
    refused, spared = make(action_mode=action_mode), make(action_mode=action_mode)
    still = np.zeros(refused.action_space.shape or (), np.float32)
    for env in (refused, spared):
        env.reset(seed=SEED, options={"index": INDEX})
        env.step(still)
    action = still.copy()
    action[4] = wrong
    with pytest.raises(ValueError, match="number 4"):
        refused.step(action)
    with pytest.raises(ValueError, match="shape"):
        refused.step(still[:1])
    after, as_before = refused.step(still), spared.step(still)
    assert all(np.array_equal(after[0][name], as_before[0][name]) for name in after[0])
    assert after[1:] == as_before[1:] and np.isfinite(after[0]["agent_pos"]).all()


@pytest.mark.physics
@pytest.mark.parametrize("copied", [copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env))])
def test_a_copy_is_made_of_the_same_arguments_and_draws_the_same_episodes(
    copied: Callable[[SceneEnvironment], SceneEnvironment],
) -> None:
    arguments: dict[str, Any] = {"action_mode": "paper", "normalised": True, "rate_hz": 5.0, "size": (64, 48)}
    env = gymnasium.make("executor.envs:scene2demo/T5-v0", **arguments)
    env.reset(seed=SEED)
    env.step(env.action_space.sample())
    other = copied(env)
    assert other.spec == env.spec and other.action_space == env.action_space
    assert other.unwrapped.metadata == env.unwrapped.metadata and other.unwrapped.spec == env.unwrapped.spec
    with pytest.raises(gymnasium.error.ResetNeeded):
        other.unwrapped.step(env.action_space.sample())
    seen, known = env.reset()
    found, told = other.reset()
    assert told == known and all(np.array_equal(found[name], seen[name]) for name in seen)
    other.close()
    env.step(env.action_space.sample())
    env.close()


def test_an_environment_of_a_task_of_ones_own_can_be_copied() -> None:
    pair = pair_of("T5", SEED, INDEX)
    for arguments in (
        {"scene": pair.scene, "task": pair.task, "query": pair.query, "physics": Physics(item_mass=1.2)},
        {"scene": "kitchen_t1", "query": "open the refrigerator", "variation": Variation(physics=True)},
    ):
        env = SceneEnvironment(**arguments)  # type: ignore[arg-type]
        other = pickle.loads(pickle.dumps(env))
        assert other.task == env.task and other.task_description == env.task_description
        assert copy.copy(env).task == env.task


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


def test_a_scenes_file_has_its_own_robot_and_drawn_kitchens_the_papers(tmp_path: Path) -> None:
    table = {"category": "table", "position": [1.2, 0, 0.375], "bbox_extent": [0.8, 1.4, 0.75]}
    (tmp_path / "own.json").write_text(json.dumps({"objects": {"table_0": table}}))
    for scene, robot in ((tmp_path / "own.json", LIFTED), ("t1", PAPER_ROBOT), ("kitchen_t1", PAPER_ROBOT)):
        env = SceneEnvironment(scene=scene, query="open the refrigerator")
        assert env.action_space.shape == SceneEnvironment("T1", robot=robot.name).action_space.shape
        env.close()
    assert LIFTED.joint_names != PAPER_ROBOT.joint_names


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
