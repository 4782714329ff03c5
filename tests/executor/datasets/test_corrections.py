"""Recovery as data: the motions that failed, with their causes and corrections."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from executor.bench.units import outcome_version
from executor.datasets import samples
from executor.datasets.plan import series_of
from executor.datasets.store import EpisodeStore
from executor.datasets.worker import run_unit

pytestmark = pytest.mark.physics


def test_what_failed_is_kept_with_what_was_done_about_it(tmp_path: Path) -> None:
    store = EpisodeStore(tmp_path / "s")
    wanted = {"seed": 62400, "episodes": 1, "evolve": True, "flows": "paper", "sources": [{"families": ["T4"]}]}
    (series,) = series_of(wanted)
    (unit,) = series.units()
    run_unit(store, unit, outcome_version())
    (episode,) = store.episodes()
    corrections = episode.meta["corrections"]
    assert episode.succeeded and corrections
    for pair in corrections:
        arrays = samples.unpacked((episode.path / pair["samples"]).read_bytes())
        assert np.all(arrays["subtask"] == pair["context"]["subtask"])
        # The failed attempt begins where the one that counts begins, or an earlier subtask was revised.
        if pair["revision"]["subtask"] == pair["context"]["subtask"]:
            first, _ = episode.meta["subtasks"][pair["context"]["subtask"]]["span"]
            assert np.array_equal(arrays["robot_qpos"][0], episode.arrays["robot_qpos"][first])
        assert pair["failure"]["kind"] and pair["revision"]["cause"]
