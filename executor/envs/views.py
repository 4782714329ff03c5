"""Pictures of an episode while it goes on: a second world, which cameras see, takes on the state of the first."""

from __future__ import annotations

from typing import Any

from executor.machine.vulkan import activate
from executor.pictures.cameras import VIEWS
from executor.pictures.frames import Picture
from executor.pictures.overview import cameras_for
from executor.pictures.stage import Stage, warm_up
from executor.world.world import World
from oag import Scene, Task


class Views:
    """The three cameras in one scene.

    Args:
        scene: The concrete scene.
        task: What the global camera is to show.
        size: Width and height of the pictures.

    Raises:
        RendererNotFound: Nothing on this machine can draw.
    """

    def __init__(self, scene: Scene, task: Task, size: tuple[int, int]) -> None:
        activate()
        # Shaders that are compiled live as long as a scene that uses them.
        self._shaders: Any = warm_up()
        self._world = World(scene, visual=True)
        cameras = cameras_for(scene, VIEWS, aspect=size[0] / size[1], task=task)
        self._stage: Stage | None = Stage(self._world, cameras, dict.fromkeys(VIEWS, size))

    def show(self, state: bytes) -> dict[str, Picture]:
        """Returns view name -> (H, W, 3) uint8 RGB of a packed physical state."""
        assert self._stage is not None, "views that were closed draw nothing"
        return self._stage.show(state)

    def close(self) -> None:
        """Lets go of the renderer's objects; nothing can be drawn afterwards."""
        self._stage = None
        self._world.close()
        self._shaders = None
