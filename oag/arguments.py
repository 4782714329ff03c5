"""What the package's doors make of an argument of another kind: a typed error that says what was meant to be there."""

from __future__ import annotations

from oag.errors import MissingScene, SceneError, TaskError
from oag.jsonfile import shown
from oag.scene import Scene
from oag.task import Task

_ARGUMENT = "(argument)"


def chosen_scene(task: Task, scene: Scene | None) -> Scene:
    """Returns the scene to judge a task in: the one given, else the one that the task carries.

    Raises:
        TaskError: The task is no `Task`.
        SceneError: The scene is no `Scene`.
        MissingScene: There is none.
    """
    if not isinstance(task, Task):
        raise TaskError(
            f"expected a Task, got {shown(task)}",
            source=_ARGUMENT,
            hint="oag.Task.from_json reads one from a file's path or a mapping",
        )
    chosen = scene if scene is not None else task.scene
    if chosen is None:
        raise MissingScene(task.name)
    if not isinstance(chosen, Scene):
        raise SceneError(
            f"expected a Scene, got {shown(chosen)}",
            source=_ARGUMENT,
            hint="oag.Scene.from_json reads one from a file's path or a mapping",
        )
    return chosen
