"""A process that makes units and puts them into a store, one after the other: `python -m executor.datasets.worker`."""

from __future__ import annotations

import resource
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from executor.bench.units import outcome_version
from executor.datasets import samples
from executor.datasets.corrections import write_corrections
from executor.datasets.footage import Filmed, film_unit
from executor.datasets.store import SAMPLES, EpisodeStore
from executor.datasets.units import DemoUnit
from executor.datasets.work import Made, NotNeeded, drawn_values, make, meta_of, noise_of, physics_of
from executor.machine.files import plain
from executor.machine.workers.process import check_version, serve
from executor.pictures.stage import Draughtsman, kept_draughtsman
from executor.records.rollout import PlanRefused, Rollout, Trajectory
from executor.scenes.pair import NotDrawn
from llm import QueryError

_KINDS: dict[type[Exception], str] = {
    PlanRefused: "plan-refused",
    NotDrawn: "not-drawn",
    NotNeeded: "not-needed",
    QueryError: "not-planned",
}

Draw = Callable[[DemoUnit, Rollout, Trajectory, Path], Filmed]
"""Draws what a unit's recording asks for of a motion in its rollout's scene into a folder."""


def run_unit(
    store: EpisodeStore,
    unit: DemoUnit,
    version: str,
    draw: Draw | None = None,
    maker: Callable[[DemoUnit], Made] = make,
) -> dict[str, Any]:
    """Makes a unit, writes its folder, and returns how it ended in a few words; a failed rollout is a result too.

    Args:
        store: Where it goes.
        unit: What to make.
        version: Hash of the program, which has to be the one that this process runs.
        draw: Draws the pictures of what is kept.
        maker: Makes it.

    Raises:
        HandoverRefused: This process runs another version of the program, or finds another scene under the name of the
            unit's; nothing is written.
        OSError: The folder cannot be written.
    """
    check_version(version, outcome_version())
    began, began_cpu_s = time.perf_counter(), _cpu_s()
    with store.writing(unit, version) as folder:
        try:
            made = maker(unit)
        except tuple(_KINDS) as problem:
            failure = {"kind": _KINDS[type(problem)], "message": str(problem)}
            meta: dict[str, Any] = {"ended": "failed", "failure": failure}
        else:
            meta = {**meta_of(made), "drawn": drawn_values(unit, made.of.graph.scene, made.of.strays)}
            if made.story is not None:
                film = None if draw is None else partial(draw, unit, made.rollout)
                meta["corrections"] = write_corrections(folder, made.story, physics_of(unit), noise_of(unit), film)
            if made.rollout.succeeded or unit.recording.failures:
                arrays = samples.columns(made.rollout)
                if draw is not None:
                    filmed = draw(unit, made.rollout, made.rollout.trajectory, folder)
                    meta["pictures"] = plain(filmed.described)
                    arrays |= filmed.poses
                (folder / SAMPLES).write_bytes(samples.packed(arrays))
        meta["wall_s"], meta["cpu_s"] = time.perf_counter() - began, _cpu_s() - began_cpu_s
        store.write(unit, version, meta, folder)
        size = sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())
    failure = meta.get("failure") or {}
    words = {"kind": failure.get("kind"), "message": failure.get("message")}
    return {"ended": meta["ended"], **words, "bytes": size, "cpu_s": meta["cpu_s"]}


def _cpu_s() -> float:
    used = resource.getrusage(resource.RUSAGE_SELF)
    return used.ru_utime + used.ru_stime


def drawn(draughtsman: Draughtsman, unit: DemoUnit, rollout: Rollout, motion: Trajectory, folder: Path) -> Filmed:
    """Draws a motion in a rollout's scene as its unit's recording asks for."""
    return film_unit(draughtsman, folder, unit, rollout.scene, rollout.task, motion.time_s, motion.packed_states)


def main() -> None:
    """Serves requests until standard input ends."""
    with kept_draughtsman() as draughtsman:

        def handle(request: dict[str, Any]) -> dict[str, Any]:
            unit = DemoUnit.from_json(request["unit"])
            draw = partial(drawn, draughtsman()) if unit.recording.views else None
            return run_unit(EpisodeStore(Path(request["store"])), unit, request["version"], draw)

        serve(handle)


if __name__ == "__main__":
    main()
