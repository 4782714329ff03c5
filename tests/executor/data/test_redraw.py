"""A store drawn anew: what moved stays as it was, what is seen is what was asked for, and it is so each time."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from executor.cli.app import run
from executor.data.card import contents_of
from executor.data.rerender import RerenderSettings, plan_rerender, rerender_unit
from executor.data.store import META, SAMPLES, EpisodeStore, StoredEpisode
from executor.data.units import DemoUnit
from executor.data.upkeep import find_flaws
from executor.data.views import POSES, look_of
from executor.sim.render.stage import SceneRenderer

WANTED = RerenderSettings(("wrist",), (64, 48), depth=True, segmentation=False, vary=("surfaces", "lights"), look=7)
WORDS = ["--views", "wrist", "--size", "64", "48", "--channels", "rgb", "depth", "--vary", "surfaces", "lights"]


@pytest.fixture(scope="module")
def scene_renderer() -> Iterator[SceneRenderer]:
    found = SceneRenderer()
    yield found
    found.close()


def _unit(episode: StoredEpisode) -> DemoUnit:
    return DemoUnit.from_json(episode.meta["unit"])


@pytest.mark.physics
def test_a_unit_is_the_same_but_for_how_it_is_looked_at(made_store: EpisodeStore) -> None:
    for episode in made_store.episodes():
        unit = WANTED.of(_unit(episode))
        assert unit.recording.views == ("wrist",)
        assert replace(unit, recording=_unit(episode).recording, variation=_unit(episode).variation) == _unit(episode)
        first, seventh = (
            look_of(replace(unit, variation=replace(unit.variation, look=look)), episode.scene, episode.task)
            for look in (0, 7)
        )
        assert first.surfaces != seventh.surfaces
        assert first.lights != seventh.lights
        assert "look" not in replace(unit, variation=replace(unit.variation, look=0)).to_json()["variation"]


@pytest.mark.slow
@pytest.mark.physics
@pytest.mark.render
def test_a_store_is_drawn_from_the_command_line_and_goes_on_where_it_ended(
    made_store: EpisodeStore, scene_renderer: SceneRenderer, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    # One episode is drawn here, the others by the command, which finds it there.
    out = EpisodeStore(tmp_path / "drawn")
    episode, unit = plan_rerender(made_store, out, WANTED)[0]
    rerender_unit(episode, out, unit, lambda: scene_renderer)
    command = ["dataset", "render", str(made_store.path), "--out", str(out.path), *WORDS, "--seed", "7", "--json"]
    count = sum(1 for _ in made_store.episodes())
    told = []
    for _ in range(2):
        assert run([*command, "--workers", "1"]) == 0
        told.append(json.loads(capsys.readouterr().out)["drawn"])
    assert told == [count - 1, 0]
    assert list(find_flaws(out)) == []
    assert contents_of(out).to_json()["parts"] == contents_of(made_store).to_json()["parts"]
    for before, after in zip(made_store.episodes(), out.episodes(), strict=True):
        assert {path.name for path in after.path.iterdir()} == {META, SAMPLES, "wrist.mp4", "wrist.depth.mkv"}
        assert after.meta["state_hash"] == before.meta["state_hash"]
        for name, array in before.arrays.items():
            assert np.array_equal(after.arrays[name], array), name
        assert set(after.arrays) - set(before.arrays) == {f"{POSES}wrist"}
        assert after.meta["pictures"]["surfaces"] is not None
    again = EpisodeStore(tmp_path / "again")
    rerender_unit(episode, again, plan_rerender(made_store, again, WANTED)[0][1], lambda: scene_renderer)
    (same,) = again.episodes()
    for path in same.path.iterdir():
        assert path.read_bytes() == (out.path / "units" / same.name / path.name).read_bytes(), path.name


@pytest.mark.physics
def test_what_cannot_be_drawn_is_said_before_anything_is_written(
    made_store: EpisodeStore, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    store = str(made_store.path)
    for words in (
        ["--out", str(tmp_path / "a"), "--channels", "depth"],
        ["--out", str(tmp_path / "a"), "--size", "63", "64"],
        ["--out", str(tmp_path / "a"), "--views", "head", "head"],
        ["--out", str(tmp_path / "a"), "--seed", "-1"],
        ["--out", store],
    ):
        assert run(["dataset", "render", store, *words]) == 2
        assert len(capsys.readouterr().err.strip().splitlines()) < 4
    assert not (tmp_path / "a").exists()
