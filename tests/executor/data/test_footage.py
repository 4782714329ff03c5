"""Pictures of stored episodes: what is written is what was drawn, and it says truly where things are."""

from __future__ import annotations

from collections.abc import Iterator
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest

from executor.data.store import EpisodeStore, StoredEpisode
from executor.data.units import Recording
from executor.data.views import (
    DEPTH,
    POSES,
    SEGMENTATION,
    Look,
    RenderedViews,
    footage_path,
    kinds,
    pictures,
    render_views,
)
from executor.geometry import transform_from_quaternion
from executor.sim.render.cameras import VIEWS, cameras_for
from executor.sim.render.stage import SceneRenderer

pytestmark = [pytest.mark.physics, pytest.mark.render]

RECORDING = Recording(10, VIEWS, (96, 64))
EVERY = 20


@pytest.fixture(scope="module")
def scene_renderer() -> Iterator[SceneRenderer]:
    found = SceneRenderer()
    yield found
    found.close()


@pytest.fixture(scope="module")
def episode(made_store: EpisodeStore) -> StoredEpisode:
    return next(made_store.demonstrations())


def _film(scene_renderer: SceneRenderer, episode: StoredEpisode, folder: Path) -> RenderedViews:
    states = [state.tobytes() for state in episode.arrays["packed_states"][::EVERY]]
    look = Look(cameras_for(episode.scene, VIEWS, 96 / 64, task=episode.task))
    folder.mkdir()
    return render_views(scene_renderer, folder, episode.scene, states, look, RECORDING, Fraction(1, 2))


@pytest.fixture(scope="module")
def filmed(
    scene_renderer: SceneRenderer, episode: StoredEpisode, tmp_path_factory: pytest.TempPathFactory
) -> tuple[Path, RenderedViews]:
    folder = tmp_path_factory.mktemp("footage") / "a"
    return folder, _film(scene_renderer, episode, folder)


@pytest.mark.slow
def test_every_view_has_its_pictures_of_the_size_that_was_asked_for(
    filmed: tuple[Path, RenderedViews], episode: StoredEpisode
) -> None:
    folder, render_views = filmed
    count = len(episode.arrays["time_s"][::EVERY])
    assert render_views.described["count"] == count
    for view in VIEWS:
        for kind in kinds(RECORDING):
            drawn = list(pictures(footage_path(folder, view, kind)))
            assert len(drawn) == count
            assert {picture.shape[:2] for picture in drawn} == {(64, 96)}
        assert render_views.poses[f"{POSES}{view}"].shape == (count, 7)


@pytest.mark.slow
def test_the_same_states_give_the_same_files(
    filmed: tuple[Path, RenderedViews], scene_renderer: SceneRenderer, episode: StoredEpisode, tmp_path: Path
) -> None:
    _film(scene_renderer, episode, tmp_path / "b")
    for path in sorted(filmed[0].iterdir()):
        again = tmp_path / "b" / path.name
        # Pictures first: where they differ the renderer is to blame, else the encoder.
        for row, (one, other) in enumerate(zip(pictures(path), pictures(again), strict=True)):
            assert np.array_equal(one, other), f"{path.name}: picture {row} at {np.argwhere(one != other)}"
        assert path.read_bytes() == again.read_bytes(), path.name


@pytest.mark.parametrize("view", VIEWS)
def test_depth_camera_and_legend_say_where_movable_things_are(
    view: str, filmed: tuple[Path, RenderedViews], episode: StoredEpisode
) -> None:
    folder, render_views = filmed
    matrix = np.asarray(render_views.described["views"][view]["intrinsics"])
    depths, numbers = (list(pictures(footage_path(folder, view, kind))) for kind in (DEPTH, SEGMENTATION))
    seen = 0
    for row, (depth, number) in enumerate(zip(depths, numbers, strict=True)):
        T_world_camera = transform_from_quaternion(*np.split(render_views.poses[f"{POSES}{view}"][row], [3]))
        for code in np.unique(number[number > 0]):
            thing = render_views.described["legend"][str(code)]["object"]
            if thing not in episode.meta["object_ids"]:
                continue
            v, u = np.nonzero(number == code)
            along = depth[v, u] / 1000.0
            rays = np.linalg.inv(matrix) @ np.stack([u + 0.5, v + 0.5, np.ones(len(u))])
            points = (T_world_camera[:3, :3] @ (rays * along)).T + T_world_camera[:3, 3]
            place = episode.meta["object_ids"].index(thing)
            centre = episode.arrays["object_poses"][::EVERY][row, place, :3]
            reach_m = np.linalg.norm(episode.scene.objects[thing].extent_m)
            assert np.linalg.norm(points - centre, axis=1).max() < reach_m + 0.005
            seen += len(u)
    assert seen > 20 or view == "wrist"


def test_colours_survive_the_encoding(
    filmed: tuple[Path, RenderedViews], episode: StoredEpisode, scene_renderer: SceneRenderer
) -> None:
    first = episode.arrays["packed_states"][0].tobytes()
    camera = cameras_for(episode.scene, ("head",), 96 / 64, task=episode.task)
    with scene_renderer.stage(episode.scene, camera, {"head": (96, 64)}, shadow_map_px=512) as stage:
        drawn = stage.show(first)["head"].astype(float)
    read = next(pictures(footage_path(filmed[0], "head"))).astype(float)
    assert np.abs(drawn - read).mean() < 4.0
