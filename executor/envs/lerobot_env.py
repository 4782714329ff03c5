"""LeRobot's access to these environments: an environment type for `lerobot-eval`, and the function that its hub calls.

Importing this registers the type `scene2demo` where LeRobot is installed; else it does nothing. Nothing here needs
LeRobot itself.

Source: lerobot 0.6.1, `EnvConfig` and `make_env` of its module `envs`.
"""

from __future__ import annotations

import importlib
from dataclasses import dataclass
from functools import partial
from typing import Any

from executor.data.state_readers import ENVIRONMENT, agent_numbers
from executor.sim.render.cameras import VIEWS
from executor.sim.robot.actions import hand_numbers
from executor.system.extras import installed_version, require
from oag.model.robots import PAPER_ROBOT, chosen_robot, robot_named

TYPE = "scene2demo"
_FIRST_TASK = "T1-v0"

Vectors = dict[str, dict[int, Any]]
"""Suite -> number of the task -> Gymnasium vector environment, as LeRobot expects."""


def make_env(n_envs: int = 1, use_async_envs: bool = False, cfg: Any = None) -> Vectors:
    """Return environments as LeRobot's hub requests them from an `env.py`.

    Args:
        use_async_envs: Whether each has its own process, forked from a server that has loaded nothing.
        cfg: LeRobot's configuration of an environment; its `task` is such as "T1-v0", its `gym_kwargs` go to
            `gymnasium.make`. By default T1.
    """
    gymnasium = require("gymnasium", "gym")
    task, options = getattr(cfg, "task", None) or _FIRST_TASK, dict(getattr(cfg, "gym_kwargs", None) or {})
    # The name includes the module, since a new process has registered nothing.
    made = partial(gymnasium.make, f"executor.envs:{TYPE}/{task}", disable_env_checker=True, **options)
    settings: dict[str, Any] = {"autoreset_mode": gymnasium.vector.AutoresetMode.SAME_STEP}
    if use_async_envs and n_envs > 1:
        vector = gymnasium.vector.AsyncVectorEnv([made] * n_envs, context="forkserver", **settings)
    else:
        vector = gymnasium.vector.SyncVectorEnv([made] * n_envs, **settings)
    return {TYPE: {0: vector}}


def register() -> None:
    """Register the environment type with LeRobot, which has to be installed.

    Its options on LeRobot's command line are `--env.task`, `--env.observation_mode` ("state" or "pixels"),
    `--env.action_mode`, `--env.normalised`, `--env.full_size`, `--env.robot`, `--env.fps`, `--env.width`,
    `--env.height`, `--env.episode_length`.
    """
    base = importlib.import_module("lerobot.envs.configs").EnvConfig
    kinds = importlib.import_module("lerobot.configs.types")
    feature, kind = kinds.PolicyFeature, kinds.FeatureType

    @base.register_subclass(TYPE)
    @dataclass
    class Scene2DemoEnv(base):  # type: ignore[misc,valid-type]
        task: str | None = _FIRST_TASK
        fps: int = 10
        episode_length: int | None = None
        observation_mode: str = "state"
        action_mode: str = "joint_target"
        normalised: bool = False
        full_size: bool = False
        robot: str = ""
        width: int = 128
        height: int = 128

        def __post_init__(self) -> None:
            robot = robot_named(chosen_robot(self.robot, full_size=self.full_size) or PAPER_ROBOT.name)
            joints = len(robot.joint_names)
            numbers = joints if self.action_mode == "joint_target" else hand_numbers(robot)
            self.features = {
                "action": feature(kind.ACTION, (numbers,)),
                "agent_pos": feature(kind.STATE, (agent_numbers(robot),)),
            }
            self.features_map = {"action": "action", "agent_pos": "observation.state"}
            if self.observation_mode == "state":
                self.features["environment_state"] = feature(kind.ENV, (ENVIRONMENT,))
                self.features_map["environment_state"] = "observation.environment_state"
            elif self.observation_mode == "pixels":
                for view in VIEWS:
                    self.features[f"pixels/{view}"] = feature(kind.VISUAL, (self.height, self.width, 3))
                    self.features_map[f"pixels/{view}"] = f"observation.images.{view}"

        @property
        def gym_kwargs(self) -> dict[str, Any]:
            limit = {} if self.episode_length is None else {"max_episode_steps": self.episode_length}
            return {
                "observation_mode": self.observation_mode,
                "action_mode": self.action_mode,
                "normalised": self.normalised,
                "full_size": self.full_size,
                "robot": self.robot,
                "rate_hz": float(self.fps),
                "size": (self.width, self.height),
                "render_mode": "rgb_array",
                **limit,
            }

        def create_envs(self, n_envs: int, use_async_envs: bool = False) -> Vectors:
            return make_env(n_envs, use_async_envs, self)


if installed_version("lerobot") is not None:
    register()
