"""Scenes and objects that several tests of the executor need."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from executor.assets.library import asset_for
from executor.geometry import Array, transform
from executor.scenes import library
from executor.sim.world import World
from oag import Scene, SceneObject

MakeWorld = Callable[..., World]
PAPER_SCALES = {
    "kitchen_t1": {"glass_0": 0.71},
    "kitchen_t2": {"apple_0": 0.62},
    "kitchen_t3": {"apple_0": 0.62},
    "kitchen_t4": {"glass_0": 0.71},
}
SIZES: dict[str, tuple[float, float, float]] = {
    "apple": (0.08, 0.08, 0.08),
    "bowl": (0.18, 0.18, 0.055),
    "cabinet": (0.55, 1.1, 0.6),
    "refrigerator": (0.68, 0.6, 1.2),
    "table": (0.9, 0.5, 0.6),
    "water_glass": (0.07, 0.07, 0.12),
}


def scene_at_paper_size(name: str) -> Scene:
    """Return a scene of the package with the paper's size adjustment."""
    return library.load(name).with_scales(PAPER_SCALES[name])


def scene_object(category: str, extent: tuple[float, float, float] | None = None, **parameters: object) -> SceneObject:
    """Return an object of a category at the origin, by default at its family's usual size."""
    return SceneObject(
        id=f"{category}_0",
        category=category,
        model="test",
        position=(0.0, 0.0, 0.0),
        orientation=(1.0, 0.0, 0.0, 0.0),
        bbox_extent=extent or SIZES[category],
        scale=(1.0, 1.0, 1.0),
        parameters=parameters,
    )


BOARD = "board_shelf_2"


def on_a_shelf(height_m: float) -> Scene:
    """Return a shelf of five boards, 21 cm apart, with a can of some height on the third, and a table."""
    shelf = {"category": "shelf", "model": "shelf_open", "position": [1.1, 0.0, 0.6], "bbox_extent": [0.35, 0.9, 1.2]}
    shelf |= {"orientation": [1, 0, 0, 0], "parameters": {"boards": 4}}
    board = next(r for r in asset_for(scene_of({"shelf_0": shelf})["shelf_0"]).regions if r.name == BOARD)
    can = {"category": "can", "model": "can", "bbox_extent": [0.05, 0.05, height_m], "orientation": [1, 0, 0, 0]}
    can["position"] = [1.04, 0.1, 0.6 + board.floor_m[2] + height_m / 2 + 0.0005]
    table = {"category": "table", "model": "table", "position": [0.9, -1.6, 0.3], "bbox_extent": [0.6, 0.9, 0.6]}
    facts = ["(ontop can_0 shelf_0)"]
    return scene_of({"shelf_0": shelf, "can_0": can, "table_0": table | {"orientation": [1, 0, 0, 0]}}, facts)


def scene_of(objects: dict[str, dict[str, object]], facts: list[str] | None = None) -> Scene:
    """Return a scene of some objects, of which the facts say everything."""
    closed = ["ontop", "inside", "open"]
    return Scene.from_json({"name": "made", "objects": objects, "facts": facts or [], "closed": closed})


def settle(world: World, seconds: float = 0.5) -> None:
    """Let the world run."""
    for _ in range(round(seconds / world.timestep_s)):
        world.step()


def at(x_m: float, y_m: float, z_m: float, rotation: Array | None = None) -> Array:
    """Return the pose of something at a place in the world, upright by default."""
    return transform(np.eye(3) if rotation is None else rotation, (x_m, y_m, z_m))
