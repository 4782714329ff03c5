"""A store with two demonstrations of the kitchen for policies, and a policy trained on it for a few steps."""

from __future__ import annotations

from pathlib import Path

import pytest

from executor.campaign.versions import outcome_version
from executor.data.generation import series_of
from executor.data.store import EpisodeStore
from executor.data.worker import run_unit
from executor.learn.settings import PolicySettings, settings_of
from tests.source_tree import ROOT

KITCHEN = ROOT / "examples" / "policies" / "kitchen.json"
PLAN = {
    "seed": 62980,
    "episodes": 2,
    "vary": ["target"],
    "noise_m": 0.005,
    "sources": [{"query": "pick up the glass", "scene": str(KITCHEN)}],
}


@pytest.fixture(scope="session")
def picked(tmp_path_factory: pytest.TempPathFactory) -> EpisodeStore:
    """Return the store: seconds of physics."""
    store, series = EpisodeStore(tmp_path_factory.mktemp("picked") / "s"), series_of(PLAN)
    store.add_requests([one.to_json() for one in series])
    for one in series:
        for unit in one.units():
            run_unit(store, unit, outcome_version())
    return store


def small(**parts: dict[str, object]) -> PolicySettings:
    """Return settings of a small policy of the state."""
    content: dict[str, dict[str, object]] = {
        "sees": {"phase": True, "way": True},
        "acts": {"chunk": 8, "execute": 4},
        "network": {"width": 32, "layers": 2},
        "training": {"steps": 6, "batch": 16, "average": 0.9},
    }
    for name, more in parts.items():
        content[name] = {**content.get(name, {}), **more}
    return settings_of(content, "small")


@pytest.fixture
def out(tmp_path: Path) -> Path:
    """Return where a new policy may go."""
    return tmp_path / "p"
