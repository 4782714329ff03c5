"""What cameras see of bodies: one mesh a body, and on it every colour where it belongs."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from executor.assets.build import textured_box, textured_material
from executor.assets.model import Shape, Vector
from executor.geometry import inverse
from executor.scenes import library
from executor.sim.render.cameras import cameras_for
from executor.sim.render.home import home_of
from executor.sim.render.stage import ROOM, SceneRenderer
from executor.sim.world import World
from oag import SceneObject

pytestmark = [pytest.mark.physics, pytest.mark.render]

SCENE = library.load("kitchen_t1")
HANDLE_M = 0.05
"""Handles and their feet are boxes thinner than this in two directions; nothing else of the refrigerator is."""


class RedHandles:
    """Paints thin parts red and all others green, of one mesh each."""

    def paint(self) -> Callable[[SceneObject, Shape], Any]:
        def look(thing: SceneObject, shape: Shape) -> Any:
            thin = shape.kind == "box" and sorted(shape.size_m)[1] < HANDLE_M / 2
            return (0.9, 0.0, 0.0) if thin else (0.0, 0.5, 0.0)

        return look

    def slab(self, half_m: Vector) -> Any:
        return textured_box(half_m, textured_material(np.full((4, 4, 3), (0.0, 0.0, 0.6)), 0.9, 0.0))

    def sides(self) -> tuple[()]:
        return ()


def test_every_colour_is_where_it_belongs() -> None:
    scene_renderer = SceneRenderer()
    cameras = cameras_for(SCENE, ("global",), aspect=1.0)
    with scene_renderer.stage(SCENE, cameras, {"global": (256, 256)}, materials=RedHandles()) as stage:
        seen = stage.sense(None)["global"]
        legend = stage.legend()
    scene_renderer.close()
    assert seen.segmentation is not None
    owners = np.array([legend[k].owner if k in legend else "" for k in range(max(legend) + 1)])[seen.segmentation]
    # Light adds a little grey; which colour is strongest stays.
    strongest = np.argmax(seen.color, axis=-1)
    fridge = owners == "refrigerator_0"
    assert 0.002 < np.mean(strongest[fridge] == 0) < 0.1, "the handle"
    assert np.mean(strongest[fridge] == 1) > 0.9
    assert np.mean(strongest[owners == "ground"] == 2) > 0.99
    assert np.mean(strongest[owners == "table_0"] != 2) == 1.0


def test_a_home_is_closed_for_who_is_in_it_and_open_for_who_looks_in_and_moves_nothing() -> None:
    scene_renderer = SceneRenderer()
    home = home_of(SCENE)
    sizes = {"global": (96, 96), "head": (96, 96)}
    with scene_renderer.stage(
        SCENE, cameras_for(SCENE, tuple(sizes)), sizes, lights=home.lights, materials=home.surfaces
    ) as stage:
        images, legend = stage.sense(None), stage.legend()
        packed = stage._world.pack()
    scene_renderer.close()
    with World(SCENE) as bare:
        assert packed == bare.pack()
    walls = [number for number, body in legend.items() if body.owner == ROOM]
    for view, seen in images.items():
        assert seen.segmentation is not None and seen.depth_mm is not None
        assert (seen.depth_mm > 0).all(), view
        assert np.isin(seen.segmentation, walls).any(), view
    # The overview stands outside: a wall is between it and the table.
    eye = cameras_for(SCENE, ("global",))[0].T_mount_camera[:3, 3]
    assert any((inverse(wall.T_world_wall) @ [*eye, 1.0])[0] < 0.0 for wall in home.surfaces.walls)
    owners = {legend[int(number)].owner for number in np.unique(images["global"].segmentation)}
    assert set(SCENE.objects) <= owners


def test_a_link_is_one_mesh() -> None:
    with World(SCENE, visual=True) as world:
        shapes = {
            entity.name: component.render_shapes
            for entity in world.sapien_scene.entities
            for component in entity.components
            if type(component).__name__ == "RenderBodyComponent"
        }
    links = [name for name in shapes if name.startswith("panda_link")]
    assert len(links) == 8
    assert all(len(shapes[name]) == 1 and len(shapes[name][0].parts) == 1 for name in links)
    assert len(shapes["table_0"]) == 1
