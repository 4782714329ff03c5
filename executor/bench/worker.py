"""A process that runs units of a benchmark, one after the other: `python -m executor.bench.worker`."""

from __future__ import annotations

import hashlib
from typing import Any

from executor.bench.units import Unit
from executor.bench.work import run_unit
from executor.machine import vulkan
from executor.machine.files import plain
from executor.machine.workers.process import serve
from executor.pictures.cameras import VIEWS, cameras_for
from executor.pictures.stage import Stage, warm_up
from executor.records.rollout import Rollout
from executor.world.world import World

# Pictures as policies take them.
SIZE = (224, 224)


class Draughtsman:
    """Draws color, depth and segmentation of every recorded state from three cameras.

    The first picture of a process compiles shaders for seconds, so one of these is kept for many rollouts.

    Raises:
        RendererNotFound: When nothing on this machine can draw.
    """

    def __init__(self) -> None:
        self._renderer = vulkan.activate()
        # Compiled shaders live as long as a scene that uses them.
        self._shaders: Any = warm_up()

    def draw(self, rollout: Rollout) -> dict[str, object]:
        """Draws all states, and returns how many pictures there are and a hash over all of them.

        The pictures are dropped: what is measured is drawing and reading them, not a disk. They have no shadows, which
        would double the time.
        """
        cameras = cameras_for(rollout.scene, VIEWS, aspect=SIZE[0] / SIZE[1], task=rollout.task)
        seen = hashlib.blake2b(digest_size=16)
        states = rollout.trajectory.packed_states
        with World(rollout.scene, visual=True) as world:
            stage = Stage(world, cameras, dict.fromkeys(VIEWS, SIZE), shadows=False)
            for state in states:
                for sensed in stage.sense(state).values():
                    seen.update(sensed.color.tobytes())
                    seen.update(sensed.depth_mm.tobytes())
                    seen.update(sensed.segmentation.tobytes())
            del stage
        return {
            "views": list(VIEWS),
            "size": list(SIZE),
            "states": len(states),
            "hash": seen.hexdigest(),
            "renderer": self._renderer.why,
        }

    def close(self) -> None:
        """Lets go of the shaders; a scene that is alive while the interpreter shuts down can abort the process."""
        self._shaders = None


def main() -> None:
    """Serves requests until standard input ends."""
    draughtsmen: list[Draughtsman] = []

    def handle(request: dict[str, Any]) -> dict[str, Any]:
        unit = Unit.from_json(request)
        if unit.setting.views and not draughtsmen:
            draughtsmen.append(Draughtsman())
        draw = draughtsmen[0].draw if unit.setting.views else None
        result: dict[str, Any] = plain(run_unit(unit, draw))
        return result

    try:
        serve(handle)
    finally:
        for draughtsman in draughtsmen:
            draughtsman.close()


if __name__ == "__main__":
    main()
