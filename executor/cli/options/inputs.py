"""Checks of options that the parser's types cannot express."""

from __future__ import annotations

import math
from pathlib import Path

from executor.cli.options.bad_option import BadOption
from executor.scenes.library import load_scene
from executor.scenes.plausible import require_buildable
from executor.scenes.vary import LARGEST_SEED, MOST_EPISODES
from oag import Scene, Task


def check_seed(seed: int, episodes: int = 1) -> None:
    """Refuses seeds that the generators cannot take.

    Raises:
        BadOption: When the number of episodes is not positive or too large, or a seed is negative or too large.
    """
    if not 1 <= episodes <= MOST_EPISODES:
        raise BadOption("--episodes", episodes, f"a whole number from 1 to {MOST_EPISODES}")
    if not 0 <= seed <= LARGEST_SEED - episodes:
        raise BadOption("--seed", seed, f"a whole number from 0 to {LARGEST_SEED - episodes}")


def check_rate(record_hz: float) -> None:
    """Refuses recording rates that the physics' 250 Hz cannot serve.

    Raises:
        BadOption: When the rate is not from 1 to 125.
    """
    if not (math.isfinite(record_hz) and 1.0 <= record_hz <= 125.0):
        raise BadOption("--record-hz", record_hz, "a rate from 1 to 125 samples a second")


def refuse_existing(path: Path, *, force: bool, option: str = "--out") -> None:
    """Refuses to replace a file, unless that is what was asked for.

    Raises:
        BadOption: When the file exists and `force` is false, or the path is a folder.
    """
    if path.is_dir():
        raise BadOption(option, path, "a file, not a folder")
    if path.exists() and not force:
        raise BadOption(option, path, "a file that does not exist yet; --force replaces it")


def task_and_scene(task_path: Path, scene: str | None) -> tuple[Task, Scene]:
    """Returns a task file's task and its scene.

    Args:
        task_path: The task's file.
        scene: Name or file of the scene; without one, `<task>_scene.json` or `scene.json` beside the task.

    Raises:
        TaskError: When the task's file is missing or malformed.
        SceneError, SceneNotFound: When the scene is.
        BadOption: When no scene is named and none lies beside the task.
    """
    Task.from_json(task_path)  # A broken task is reported before a missing scene.
    found = load_scene(scene) if scene is not None else load_scene(_scene_beside(task_path))
    return Task.from_json(task_path, scene=found), found


def task_to_run(task_path: Path, scene: str | None) -> tuple[Task, Scene]:
    """Returns a task file's task and its scene, all of whose things can be built.

    Raises:
        TaskError, SceneError, SceneNotFound, BadOption: As for `task_and_scene`; or something cannot be built.
    """
    task, found = task_and_scene(task_path, scene)
    require_buildable(found)
    return task, found


def _scene_beside(task_path: Path) -> Path:
    for candidate in (task_path.with_name(f"{task_path.stem}_scene.json"), task_path.with_name("scene.json")):
        if candidate.is_file():
            return candidate
    raise BadOption("--scene", "is missing", f"a scene's name or file, since none lies beside {task_path}")
