"""Worker process that runs units of baselines: `python -m benchmarks.baselines.worker`."""

from __future__ import annotations

from benchmarks.baselines.methods import baseline_version, run_baseline
from executor.bench.worker import serve_units

if __name__ == "__main__":
    serve_units(lambda unit, plan: run_baseline(unit), baseline_version())
