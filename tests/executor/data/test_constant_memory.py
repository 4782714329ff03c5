"""However many units are made, neither the process that counts them nor one that makes them grows with their number."""

from __future__ import annotations

import gc
import sys
import tracemalloc
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

from executor.campaign.engine import Campaign
from executor.campaign.versions import outcome_version
from executor.data.generation import WORKER, Tally, generate, series_of
from executor.data.store import EpisodeStore
from executor.data.units import DemoUnit
from executor.system.workers import WorkerProcess

INVENTED = "tests.executor.data.invented_worker"
SUCCEED = (0, 1, 2, 6, 7, 8)  # Last digits of seeds: what the invented worker makes without ado.


def test_what_counts_units_keeps_nothing_of_each(folder: Path) -> None:
    plan = {"seed": 0, "episodes": 100, "sources": [{"families": ["T1"]}]}
    units = [unit for series in series_of(plan) for unit in series.units() if unit.seed % 10 in SUCCEED]
    told_of, held_bytes = list[int](), list[int]()

    def told(unit: DemoUnit, result: Mapping[str, Any]) -> None:
        told_of.append(unit.seed)
        # What is made once is made with the first few.
        if len(told_of) in (30, 45, 60):
            gc.collect()
            held_bytes.append(tracemalloc.get_traced_memory()[0])

    tracemalloc.start()
    try:
        generate(Campaign(EpisodeStore(folder), INVENTED, 1), [(unit, "a version") for unit in units], told, Tally())
    finally:
        tracemalloc.stop()
    assert len(told_of) == 60
    # A unit's answer alone is 500 bytes. What a unit leaves behind shows in each part; what is made once, in one.
    grown = (held_bytes[1] - held_bytes[0], held_bytes[2] - held_bytes[1])
    assert min(grown) / 15 < 100, grown


@pytest.mark.slow
@pytest.mark.physics
@pytest.mark.skipif(sys.platform != "linux", reason="memory is read from /proc")
def test_what_makes_units_keeps_nothing_of_each(folder: Path) -> None:
    source = {"query": "open the refrigerator", "scene": "examples/policies/kitchen.json"}
    plan = {"seed": 62000, "episodes": 80, "sources": [source]}
    units = [unit for series in series_of(plan) for unit in series.units()]
    assert len(units) == 80
    worker, held_mb = WorkerProcess(WORKER), []
    try:
        assert "ready" in worker.receive()
        for unit in units:
            worker.send({"unit": unit.to_json(), "store": str(folder), "version": outcome_version()})
            assert worker.receive()["finished"]["ended"] in ("succeeded", "failed")
            held_mb.append(resident_mb(worker.pid))
    finally:
        worker.close()
    # A world alone is 5 MB; what the allocator keeps and gives back goes up and down by as much.
    assert max(held_mb[-20:]) - max(held_mb[30:50]) < 15, held_mb


def resident_mb(pid: int) -> float:
    """Return how much of a process is in memory."""
    status = Path(f"/proc/{pid}/status").read_text()
    return next(int(line.split()[1]) / 1000 for line in status.splitlines() if line.startswith("VmRSS"))
