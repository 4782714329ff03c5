"""Worker process that runs units of a benchmark: `python -m executor.bench.worker`.

`serve_units` serves any other runner of units, such as a baseline's.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from functools import partial
from typing import Any

from executor.bench.any_task import run_wish
from executor.bench.units import Unit
from executor.bench.work import run_unit
from executor.campaign.versions import outcome_version
from executor.records import Rollout
from executor.scenes.generators.any_task import FAMILY
from executor.sim.render.cameras import VIEWS, cameras_for
from executor.sim.render.stage import SceneRenderer, shared_renderer
from executor.system.files import plain
from executor.system.workers import check_version, serve

# Picture size of common policies.
SIZE = (224, 224)


def _draw_views(scene_renderer: SceneRenderer, rollout: Rollout) -> dict[str, object]:
    """Render color, depth and segmentation of all states; return the number of pictures and a hash over them.

    The pictures are dropped: drawing and reading them is measured, not a disk. They have no shadows, which would double
    the time.
    """
    cameras = cameras_for(rollout.scene, VIEWS, aspect=SIZE[0] / SIZE[1], task=rollout.task)
    digest = hashlib.blake2b(digest_size=16)
    states = rollout.trajectory.packed_states
    with scene_renderer.stage(rollout.scene, cameras, dict.fromkeys(VIEWS, SIZE), shadows=False) as stage:
        for state in states:
            for sensed in stage.sense(state).values():
                for picture in (sensed.color, sensed.depth_mm, sensed.segmentation):
                    digest.update(b"" if picture is None else picture.tobytes())
    return {
        "views": list(VIEWS),
        "size": list(SIZE),
        "states": len(states),
        "hash": digest.hexdigest(),
        "renderer": scene_renderer.renderer,
    }


def serve_units(run: Callable[[Unit], dict[str, Any]], version: str) -> None:
    """Run the requested units until standard input ends.

    Args:
        run: Returns the result of a unit.
        version: The version of the program that its results are for; requests for others are refused.
    """

    def handle(request: dict[str, Any]) -> dict[str, Any]:
        check_version(request["version"], version)
        result: dict[str, Any] = plain(run(Unit.from_json(request)))
        return result

    serve(handle)


def main() -> None:
    """Run units of the executor itself."""
    with shared_renderer() as scene_renderer:

        def run(unit: Unit) -> dict[str, Any]:
            if unit.family == FAMILY:
                return run_wish(unit.seed)
            return run_unit(unit, partial(_draw_views, scene_renderer()) if unit.setting.views else None)

        serve_units(run, outcome_version())


if __name__ == "__main__":
    main()
