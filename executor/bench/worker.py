"""A process that runs units of a benchmark, one after the other: `python -m executor.bench.worker`."""

from __future__ import annotations

import hashlib
from functools import partial
from typing import Any

from executor.bench.units import Unit, outcome_version
from executor.bench.work import run_unit
from executor.machine.files import plain
from executor.machine.workers.process import check_version, serve
from executor.pictures.cameras import VIEWS
from executor.pictures.overview import cameras_for
from executor.pictures.stage import Draughtsman, kept_draughtsman
from executor.records.rollout import Rollout

# Pictures as policies take them.
SIZE = (224, 224)


def _drawn(draughtsman: Draughtsman, rollout: Rollout) -> dict[str, object]:
    """Draws color, depth and segmentation of all states; returns how many pictures there are, a hash over all of them.

    The pictures are dropped: what is measured is drawing and reading them, not a disk. They have no shadows, which
    would double the time.
    """
    cameras = cameras_for(rollout.scene, VIEWS, aspect=SIZE[0] / SIZE[1], task=rollout.task)
    seen = hashlib.blake2b(digest_size=16)
    states = rollout.trajectory.packed_states
    with draughtsman.stage(rollout.scene, cameras, dict.fromkeys(VIEWS, SIZE), shadows=False) as stage:
        for state in states:
            for sensed in stage.sense(state).values():
                for picture in (sensed.color, sensed.depth_mm, sensed.segmentation):
                    seen.update(b"" if picture is None else picture.tobytes())
    return {
        "views": list(VIEWS),
        "size": list(SIZE),
        "states": len(states),
        "hash": seen.hexdigest(),
        "renderer": draughtsman.renderer,
    }


def main() -> None:
    """Serves requests until standard input ends."""
    own = outcome_version()
    with kept_draughtsman() as draughtsman:

        def handle(request: dict[str, Any]) -> dict[str, Any]:
            check_version(request["version"], own)
            unit = Unit.from_json(request)
            draw = partial(_drawn, draughtsman()) if unit.setting.views else None
            result: dict[str, Any] = plain(run_unit(unit, draw))
            return result

        serve(handle)


if __name__ == "__main__":
    main()
