"""A store with two demonstrations that physics made, once a session."""

from __future__ import annotations

from pathlib import Path

import pytest

from executor.bench.units import outcome_version
from executor.datasets.plan import series_of
from executor.datasets.store import EpisodeStore
from executor.datasets.worker import run_unit

# One opens something, one picks something up: seconds each.
PLAN = {"seed": 62990, "episodes": 1, "sources": [{"families": ["T5", "T6"]}]}


@pytest.fixture(scope="session")
def made_store(tmp_path_factory: pytest.TempPathFactory) -> EpisodeStore:
    """Returns the store; tests that change one copy it first."""
    store, series = EpisodeStore(tmp_path_factory.mktemp("store") / "s"), series_of(PLAN)
    store.add_requests([one.to_json() for one in series])
    for one in series:
        for unit in one.units():
            run_unit(store, unit, outcome_version())
    return store


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Returns where a new store may go."""
    return tmp_path / "d"
