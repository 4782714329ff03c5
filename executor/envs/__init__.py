"""Gymnasium environments of scenes and tasks; importing this registers them and loads no simulator.

    import gymnasium
    env = gymnasium.make("scene2demo/T1-v0")

In an installation, importing Gymnasium registers them (`scripts/scene2demo_gymnasium.py`). In a checkout that is not
installed, use the name "executor.envs:scene2demo/T1-v0", which imports this module.

There is `scene2demo/T1-v0` to `scene2demo/T6-v0`, whose seeds are those of the benchmark, and `scene2demo/Task-v0`,
which takes a `scene` and a `query`. docs/datasets.md has their actions, observations, rewards and arguments.
"""

from __future__ import annotations

from importlib.util import find_spec

FAMILIES = ("T1", "T2", "T3", "T4", "T5", "T6")
_MODULE = "executor.envs.scene_environment"  # Imported when the first environment is made.
TASK_ID = "scene2demo/Task-v0"
MOST_STEPS = {"T1": 1000, "T2": 1000, "T3": 1500, "T4": 1500, "T5": 400, "T6": 400}
"""Actions of an episode, at ten a second: about twice what planned demonstrations take."""

MOST_TASK_STEPS = 2000
"""Actions of an episode of any other task."""


def register() -> None:
    """Register the environments with Gymnasium; importing this package does it, and a second call does nothing.

    Raises:
        ModuleNotFoundError: Gymnasium is not installed.
    """
    # While Gymnasium itself is being imported, its top module has no `register` yet.
    from gymnasium.envs.registration import register, registry

    if TASK_ID in registry:
        return
    entry = f"{_MODULE}:SceneEnvironment"
    for family in FAMILIES:
        register(f"scene2demo/{family}-v0", entry, max_episode_steps=MOST_STEPS[family], kwargs={"family": family})
    register(TASK_ID, entry, max_episode_steps=MOST_TASK_STEPS)


if find_spec("gymnasium") is not None:
    register()
