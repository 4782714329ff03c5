"""Drawn light, cameras and surfaces: within their ranges, the same for a seed, and without a say in each other."""

from __future__ import annotations

import numpy as np
import pytest

from executor.assets.build import TEXTURE_M
from executor.assets.library import asset_for
from executor.scenes import library
from executor.sim.render.appearance import pattern, perturb_cameras, sample_lights, sample_surfaces, surface_key
from executor.sim.render.cameras import VIEWS, cameras_for, is_lens_clear
from oag.model.symbols import Kind

SCENE = library.load("kitchen_t1")


def _rng(seed: int) -> np.random.Generator:
    return np.random.default_rng(seed)


def test_light_comes_from_above_and_is_never_too_little() -> None:
    for seed in range(200):
        lights = sample_lights(_rng(seed))
        assert lights.sun_direction[2] < -0.7
        assert lights.fill_direction[2] < 0.0
        assert min(lights.ambient) > 0.2
        assert min(lights.sun_color) > 0.7
    assert sample_lights(_rng(1)) == sample_lights(_rng(1)) != sample_lights(_rng(2))


def test_cameras_stray_within_their_mounts_and_never_into_anything() -> None:
    usual = cameras_for(SCENE, VIEWS)
    for seed in range(20):
        for before, after in zip(usual, perturb_cameras(_rng(seed), usual, SCENE), strict=True):
            moved_m = np.linalg.norm(after.T_mount_camera[:3, 3] - before.T_mount_camera[:3, 3])
            assert 0.0 < moved_m <= {"global": 0.35, "head": 0.035, "wrist": 0.009}[before.name]
            assert after.T_mount_camera[:3, :3] @ after.T_mount_camera[:3, :3].T == pytest.approx(np.eye(3), abs=1e-9)
            assert abs(after.fov_y_rad - before.fov_y_rad) < 0.08
            assert after.mount is not None or is_lens_clear(SCENE, after.T_mount_camera[:3, 3])


def test_a_camera_strays_alike_whichever_others_there_are() -> None:
    both, one = cameras_for(SCENE, ("head", "wrist")), cameras_for(SCENE, ("wrist",))
    assert np.array_equal(
        perturb_cameras(_rng(3), both, SCENE)[1].T_mount_camera, perturb_cameras(_rng(3), one, SCENE)[0].T_mount_camera
    )


def test_surfaces_of_a_kind_match_and_what_is_not_there_has_no_say() -> None:
    found = sample_surfaces(_rng(4), SCENE)
    other = sample_surfaces(_rng(4), library.load("kitchen_t3"))
    assert other.floor == found.floor
    shared = found.finishes.keys() & other.finishes.keys()
    assert shared and len(shared) < len(other.finishes)
    assert all(found.finishes[key] == other.finishes[key] for key in shared)
    assert found.to_json() == sample_surfaces(_rng(4), SCENE).to_json()
    assert found.floor != sample_surfaces(_rng(5), SCENE).floor


def test_things_keep_about_their_colour_and_glass_stays_glass() -> None:
    found = sample_surfaces(_rng(6), SCENE)
    for thing in SCENE.objects.values():
        for shape in (shape for link in asset_for(thing).links for shape in link.shapes if shape.visible):
            finish = found.finishes.get(surface_key(thing.category, shape))
            assert (finish is None) is (len(shape.color) > 3)
            if finish is not None and thing.kind is Kind.ITEM:
                assert np.abs(np.subtract(finish.color, shape.color)).max() < 0.13


@pytest.mark.parametrize("material", ["paint", "wood", "planks", "steel", "tiles"])
def test_patterns_differ_by_number_and_meet_at_their_edges(material: str) -> None:
    first, second = pattern(material, 0), pattern(material, 1)  # type: ignore[arg-type]
    assert not np.array_equal(first, second)
    assert 0.4 < first.mean() <= 1.0
    inside = np.abs(np.diff(first, axis=1)).mean()
    assert np.abs(first[:, 0] - first[:, -1]).mean() < 3.0 * inside + 0.1
    assert TEXTURE_M > 1.0
