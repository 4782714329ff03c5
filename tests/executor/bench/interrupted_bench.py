"""`scene2demo bench` with invented units, as a process of its own that a test can send signals to."""

from __future__ import annotations

import sys

from executor.campaign import versions
from executor.cli import app
from executor.cli.commands import bench

if __name__ == "__main__":
    bench.WORKER = "tests.executor.bench.invented_worker"
    versions.outcome_version = lambda: "the version of a test"
    app.main(sys.argv[1:])
