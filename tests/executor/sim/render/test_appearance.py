"""Drawn light, cameras and surfaces: within their ranges, the same for a seed, and without a say in each other."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from executor.assets.build import TEXTURE_M
from executor.assets.footprint import Footprint
from executor.assets.library import LIBRARY, asset_for, sample
from executor.geometry import inverse
from executor.scenes import library
from executor.scenes.generators.families import pair_of
from executor.scenes.vary import vary
from executor.sim.render.appearance import Material, pattern, perturb_cameras, sample_lights, surface_key
from executor.sim.render.cameras import VIEWS, cameras_for, is_lens_clear
from executor.sim.render.home import home_of, styles
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
    found, other = (home_of(scene, _rng(4)).surfaces for scene in (SCENE, library.load("kitchen_t2")))
    assert other.floor == found.floor and other.roles == found.roles
    shared = found.finishes.keys() & other.finishes.keys()
    assert shared and all(found.finishes[key] == other.finishes[key] for key in shared)
    assert found.to_json() == home_of(SCENE, _rng(4)).surfaces.to_json()
    assert found.roles != home_of(SCENE, _rng(5)).surfaces.roles


def test_a_home_has_the_style_of_its_name_and_all_its_fronts_match() -> None:
    assert home_of(SCENE).surfaces.roles == home_of(vary(SCENE, 3)).surfaces.roles
    kitchen = pair_of("T1", 12000, None).scene
    for style in styles():
        surfaces = home_of(kitchen, style=style).surfaces
        fronts = {key.split("/")[0] for key, finish in surfaces.finishes.items() if finish == surfaces.roles["front"]}
        assert "bottom_cabinet" in fronts
        assert {part.role for wall in surfaces.walls for part in wall.parts} <= surfaces.roles.keys()


def test_every_colour_of_the_librarys_furniture_has_a_role_or_is_kept_on_purpose() -> None:
    scene = replace(SCENE, objects={model: sample(model, 1, model) for model in sorted(LIBRARY)}, facts=())
    painted = home_of(scene).surfaces.finishes
    colors = {
        surface_key(thing.category, shape).split("/")[1]
        for thing in scene.objects.values()
        if thing.kind is not Kind.ITEM
        for shape in (shape for link in asset_for(thing).links for shape in link.shapes if shape.visible)
    }
    kept = colors - {key.split("/")[1] for key in painted}
    # Black glass and plinths, what is inside of cold and hot things, displays, knobs, lamps and the plates of a hob.
    assert len(kept) <= 14, sorted(kept)


@pytest.mark.parametrize("seed", [12000, 12001, 12004])
def test_a_room_is_around_all_that_stands_in_it_and_its_windows_are_free(seed: int) -> None:
    scene = pair_of("T1", seed, None).scene
    *walls, ceiling = home_of(scene).surfaces.walls
    assert len(walls) == 4 and ceiling.yaw_rad is None
    for wall in walls:
        T_wall_world = inverse(wall.T_world_wall)
        for thing in scene.objects.values():
            if thing.category == "wall":
                continue
            corners = np.c_[Footprint.of(thing).corners_m, np.zeros((4, 1)), np.ones((4, 1))] @ T_wall_world.T
            assert corners[:, 0].min() > -0.02, (thing.id, wall)
            top = thing.position[2] + thing.extent_m[2] / 2
            for pane in (part for part in wall.parts if part.role == "view"):
                covers = corners[:, 1].max() > pane.low_m[1] and corners[:, 1].min() < pane.high_m[1]
                assert not (covers and corners[:, 0].min() < 0.12 and top > pane.low_m[2]), thing.id


@pytest.mark.parametrize(
    "material", ["paint", "wood", "planks", "herringbone", "steel", "tiles", "metro", "stone", "fabric"]
)
def test_patterns_differ_by_number_and_meet_at_their_edges(material: Material) -> None:
    first, second = pattern(material, 0), pattern(material, 1)
    assert not np.array_equal(first, second)
    assert 0.4 < first.mean() <= 1.0
    inside = np.abs(np.diff(first, axis=1)).mean()
    assert np.abs(first[:, 0] - first[:, -1]).mean() < 3.0 * inside + 0.1
    assert TEXTURE_M > 1.0
