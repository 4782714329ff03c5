"""A robot of full size takes things as they are, and what it did comes out again."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from executor.campaign.versions import outcome_version
from executor.cli.app import run
from executor.data.formats.selection import NothingToExport
from executor.data.formats.store_reader import stream_of
from executor.data.store import EpisodeStore
from executor.data.units import DemoUnit, Origin
from executor.data.worker import run_unit
from executor.envs.scene_environment import SceneEnvironment
from executor.scenes.generators import household

pytestmark = pytest.mark.physics
SEED, GLASS = 62900, 4


@pytest.mark.slow
def test_a_glass_is_taken_as_it_is_and_again_through_the_environment(tmp_path: Path) -> None:
    small, store = household.pair(SEED, GLASS), EpisodeStore(tmp_path / "s")
    store.add_requests([])
    run_unit(store, DemoUnit(Origin(family="T6"), SEED, GLASS, full_size=True), outcome_version())
    (episode,) = store.demonstrations()
    assert episode.succeeded and episode.meta["scaled"] == []
    width_m = min(episode.scene["glass_0"].extent_m[:2])
    assert min(small.scene["glass_0"].extent_m[:2]) <= 0.052 < width_m <= 0.077
    fingers_m = episode.arrays["robot_qpos"][:, 10:].sum(axis=1)
    assert fingers_m.max() == pytest.approx(0.08, abs=1e-3) and fingers_m[-1] == pytest.approx(width_m, abs=2e-3)
    assert run(["replay", str(store.path), "--through", "env", "--actions", "paper"]) == 0


def test_an_environment_has_the_limits_of_its_robot() -> None:
    small, full = SceneEnvironment("T6"), SceneEnvironment("T6", full_size=True)
    assert np.allclose([env.action_space.high[-1] for env in (small, full)], [0.028, 0.04])


def test_a_data_set_is_of_one_robot(made_store: EpisodeStore, tmp_path: Path) -> None:
    store = EpisodeStore(Path(shutil.copytree(made_store.path, tmp_path / "s")))
    told = next(store.demonstrations()).path / "unit.json"
    meta = json.loads(told.read_text(encoding="utf-8"))
    meta["robot"]["scale"] = 1.0
    told.write_text(json.dumps(meta), encoding="utf-8")
    with pytest.raises(NothingToExport, match="different robots"):
        stream_of(store)
