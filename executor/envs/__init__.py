"""Scenes and tasks as Gymnasium environments; importing this registers them and loads no simulator.

    import gymnasium
    env = gymnasium.make("executor.envs:scene2demo/T1-v0")

There is `scene2demo/T1-v0` to `scene2demo/T6-v0`, whose seeds are those of the benchmark, and `scene2demo/Task-v0`,
which takes a `scene` and a `query`. docs/environment.md has their actions, observations, rewards and arguments.
"""

from __future__ import annotations

from executor.machine.extras import installed_version, require

FAMILIES = ("T1", "T2", "T3", "T4", "T5", "T6")
_MODULE = "executor.envs.environment"  # Imported when the first environment is made.
TASK_ID = "scene2demo/Task-v0"
MOST_STEPS = {"T1": 1000, "T2": 1000, "T3": 1500, "T4": 1500, "T5": 400, "T6": 400}
"""Actions of an episode, at ten a second: about twice what planned demonstrations take."""

MOST_TASK_STEPS = 2000
"""The same of any task."""


def register() -> None:
    """Makes the environments known to Gymnasium; once is enough, and importing this package does it.

    Raises:
        MissingExtra: Gymnasium is not installed.
    """
    gymnasium = require("gymnasium", "gym")
    entry = f"{_MODULE}:SceneEnvironment"
    for family in FAMILIES:
        gymnasium.register(
            f"scene2demo/{family}-v0", entry, max_episode_steps=MOST_STEPS[family], kwargs={"family": family}
        )
    gymnasium.register(TASK_ID, entry, max_episode_steps=MOST_TASK_STEPS)


if installed_version("gymnasium") is not None:
    register()
