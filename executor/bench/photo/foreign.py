"""Things of shapes that the library has no model for, in the place of a room's items."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from executor.assets.footprint import yaw_of
from executor.assets.imports.importer import import_asset
from executor.assets.imports.stored import ASSETS_VARIABLE, PREFIX, Imported
from executor.machine.extras import require
from oag import Kind, Scene, SceneObject
from oag.model.scenefile import about_z

CATEGORY = "ornament"
"""What they are called; nothing in the library is."""

_LARGEST_M = 0.1
_VASE = ((0.0, 0.0), (0.6, 0.0), (1.0, 0.9), (0.9, 1.5), (0.4, 2.0), (0.5, 2.4), (0.0, 2.4))
_STEPS = ((0, 0), (3, 0), (3, 1), (2, 1), (2, 2), (1, 2), (1, 3), (0, 3))
# Of trimesh's own primitives: the function, and what it is told.
_PRIMITIVES: Mapping[str, tuple[str, Mapping[str, Any]]] = MappingProxyType(
    {
        "cone": ("cone", {"radius": 1.0, "height": 2.2}),
        "capsule": ("capsule", {"radius": 1.0, "height": 2.0}),
        "ring": ("torus", {"major_radius": 2.0, "minor_radius": 0.7}),
        "pipe": ("annulus", {"r_min": 0.6, "r_max": 1.0, "height": 2.0}),
        "vase": ("revolve", {"linestring": _VASE}),
        "stairs": ("extrude_polygon", {"polygon": _STEPS, "height": 2.0}),
    }
)
_TURNED_ROUND = ("cone", "capsule", "ring", "pipe", "vase")
ROUND = frozenset(f"{PREFIX}{name}" for name in _TURNED_ROUND)
"""Models that look the same from all sides."""


@contextmanager
def foreign_models(folder: Path) -> Iterator[tuple[Imported, ...]]:
    """Gives the foreign models; scenes find them as long as it is open.

    Args:
        folder: Where their files are written.

    Raises:
        MissingExtra: trimesh, or what splits meshes into convex pieces, is not installed.
    """
    before = os.environ.get(ASSETS_VARIABLE)
    os.environ[ASSETS_VARIABLE] = str(folder)
    try:
        yield tuple(_imported(folder, name) for name in _PRIMITIVES)
    finally:
        if before is None:
            del os.environ[ASSETS_VARIABLE]
        else:
            os.environ[ASSETS_VARIABLE] = before


def with_foreign_items(scene: Scene, models: Sequence[Imported], rng: np.random.Generator) -> Scene:
    """Returns a scene in which something foreign stands in the place of every item, at most as large as that was."""
    objects = dict(scene.objects)
    for name, item in scene.objects.items():
        if item.kind is Kind.ITEM:
            model = models[int(rng.integers(len(models)))]
            objects[name] = _in_place_of(item, model)
    return replace(scene, objects=objects)


def _in_place_of(item: SceneObject, model: Imported) -> SceneObject:
    own = np.asarray(model.stored.asset.extent_m)
    length, width, height = (float(side) for side in own * float(np.min(np.asarray(item.extent_m) / own)))
    x, y, z = item.position
    bottom_m = z - item.extent_m[2] / 2
    return replace(
        model.as_object(item.id),
        position=(x, y, bottom_m + height / 2),
        orientation=about_z(yaw_of(item)),
        bbox_extent=(length, width, height),
    )


def _imported(folder: Path, name: str) -> Imported:
    function, told = _PRIMITIVES[name]
    known = dict(told)
    if "polygon" in known:
        known["polygon"] = require("shapely.geometry", "photo").Polygon(known["polygon"])
    mesh = getattr(require("trimesh.creation", "sim"), function)(**known)
    # Larger things would be taken for furniture.
    mesh.apply_scale(_LARGEST_M / float(mesh.extents.max()))
    folder.mkdir(parents=True, exist_ok=True)
    file = folder / f"{name}.stl"
    mesh.export(file)
    return import_asset(file, name, category=CATEGORY)
