"""Clean episodes that physics made, once a session: two kinds in seconds, and more for the slow tests."""

from __future__ import annotations

from pathlib import Path

import pytest

from executor.campaign.versions import outcome_version
from executor.data.generation import series_of
from executor.data.store import EpisodeStore
from executor.data.worker import run_unit

FEW = {"seed": 62990, "episodes": 1, "sources": [{"families": ["T5", "T6"]}]}
MORE = {
    "seed": 63100,
    "episodes": 1,
    "sources": [
        {"families": ["T1", "T5", "T6"]},
        {"query": "put the apple into the bowl", "scene": "kitchen_t3"},
        {"query": "open the refrigerator", "scene": "kitchen_t1"},
    ],
}


def _made(folder: Path, plan: dict[str, object]) -> EpisodeStore:
    store, series = EpisodeStore(folder), series_of(plan)
    store.add_requests([one.to_json() for one in series])
    for one in series:
        for unit in one.units():
            run_unit(store, unit, outcome_version())
    return store


@pytest.fixture(scope="session")
def clean(tmp_path_factory: pytest.TempPathFactory) -> EpisodeStore:
    """Return a store of an opened thing and one picked up; tests copy it first."""
    return _made(tmp_path_factory.mktemp("clean") / "s", FEW)


@pytest.fixture(scope="session")
def more(tmp_path_factory: pytest.TempPathFactory) -> EpisodeStore:
    """Return a store of five kinds of episodes."""
    return _made(tmp_path_factory.mktemp("more") / "s", MORE)
