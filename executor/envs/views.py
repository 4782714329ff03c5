"""Pictures of episodes while they go on: a second world, which cameras see, takes on the state of the first."""

from __future__ import annotations

from contextlib import ExitStack

from executor.pictures.cameras import VIEWS
from executor.pictures.frames import Picture
from executor.pictures.overview import cameras_for
from executor.pictures.stage import Draughtsman, Stage
from oag import Scene, Task


class Views:
    """The three cameras, in one scene after the other.

    Args:
        size: Width and height of the pictures.

    Raises:
        RendererNotFound: Nothing on this machine can draw.
    """

    def __init__(self, size: tuple[int, int]) -> None:
        self._size = size
        self._draughtsman = Draughtsman()
        self._open = ExitStack()
        self._scene: Scene | None = None
        self._stage: Stage | None = None

    def show(self, scene: Scene, task: Task, state: bytes) -> dict[str, Picture]:
        """Returns view name -> (H, W, 3) uint8 RGB of a packed physical state of a scene.

        Args:
            scene: The concrete scene; a stage is built when it is another one than before.
            task: What the global camera is to show.
            state: As `World.pack` gives it.
        """
        if self._stage is None or scene is not self._scene:
            self._leave()
            cameras = cameras_for(scene, VIEWS, aspect=self._size[0] / self._size[1], task=task)
            sizes = dict.fromkeys(VIEWS, self._size)
            self._stage = self._open.enter_context(self._draughtsman.stage(scene, cameras, sizes))
            self._scene = scene
        return self._stage.show(state)

    def close(self) -> None:
        """Lets go of the renderer's objects; nothing can be drawn afterwards."""
        self._leave()
        self._draughtsman.close()

    def _leave(self) -> None:
        self._stage = None
        self._open.close()
