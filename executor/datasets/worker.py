"""A process that makes units and puts them into a store, one after the other: `python -m executor.datasets.worker`."""

from __future__ import annotations

import resource
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from executor.datasets import samples
from executor.datasets.store import SAMPLES, EpisodeStore
from executor.datasets.units import DemoUnit
from executor.datasets.work import make, meta_of
from executor.machine.workers.process import serve
from executor.records.rollout import PlanRefused, Rollout
from executor.scenes.pair import NotDrawn

Draw = Callable[[DemoUnit, Rollout, Path], dict[str, Any]]
"""Draws what a unit's recording asks for into a folder, and returns what its `unit.json` is to say of it."""


def run_unit(store: EpisodeStore, unit: DemoUnit, version: str, draw: Draw | None = None) -> dict[str, Any]:
    """Makes a unit, writes its folder, and returns how it ended in a few words; a failed rollout is a result too.

    Args:
        store: Where it goes.
        unit: What to make.
        version: Hash of the program.
        draw: Draws the pictures of what is kept.

    Raises:
        OSError: The folder cannot be written.
    """
    began, began_cpu_s = time.perf_counter(), _cpu_s()
    with store.writing(unit, version) as folder:
        try:
            made = make(unit)
        except (PlanRefused, NotDrawn) as problem:
            kind = "plan-refused" if isinstance(problem, PlanRefused) else "not-drawn"
            meta: dict[str, Any] = {"ended": "failed", "failure": {"kind": kind, "message": str(problem)}}
        else:
            meta = meta_of(made)
            if made.rollout.succeeded or unit.recording.failures:
                (folder / SAMPLES).write_bytes(samples.packed(samples.columns(made.rollout)))
                if draw is not None and unit.recording.views:
                    meta["pictures"] = draw(unit, made.rollout, folder)
        meta["wall_s"], meta["cpu_s"] = time.perf_counter() - began, _cpu_s() - began_cpu_s
        store.write(unit, version, meta, folder)
        size = sum(path.stat().st_size for path in folder.iterdir())
    failure = meta.get("failure") or {}
    words = {"kind": failure.get("kind"), "message": failure.get("message")}
    return {"ended": meta["ended"], **words, "bytes": size, "cpu_s": meta["cpu_s"]}


def _cpu_s() -> float:
    used = resource.getrusage(resource.RUSAGE_SELF)
    return used.ru_utime + used.ru_stime


def handle(request: dict[str, Any]) -> dict[str, Any]:
    """Makes the unit that a request names, and returns how it ended."""
    unit = DemoUnit.from_json(request["unit"])
    return run_unit(EpisodeStore(Path(request["store"])), unit, request["version"])


if __name__ == "__main__":
    serve(handle)
