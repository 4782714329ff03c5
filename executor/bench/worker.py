"""Worker process that runs units of a benchmark: `python -m executor.bench.worker`."""

from __future__ import annotations

import hashlib
from functools import partial
from typing import Any

from executor.bench.units import Unit
from executor.bench.work import run_unit
from executor.campaign.versions import outcome_version
from executor.records import Rollout
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


def main() -> None:
    """Serve requests until standard input ends."""
    own = outcome_version()
    with shared_renderer() as scene_renderer:

        def handle(request: dict[str, Any]) -> dict[str, Any]:
            check_version(request["version"], own)
            unit = Unit.from_json(request)
            draw = partial(_draw_views, scene_renderer()) if unit.setting.views else None
            result: dict[str, Any] = plain(run_unit(unit, draw))
            return result

        serve(handle)


if __name__ == "__main__":
    main()
