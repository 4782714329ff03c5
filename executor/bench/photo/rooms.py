"""Rooms of the photo benchmark: households and kitchens drawn from a seed, and items of shapes without a model.

Every room has a query. Foreign items have shapes for which the library has no model; they replace a room's items.
"""

from __future__ import annotations

import itertools
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any, Protocol, TypeVar

import numpy as np

from executor.assets.footprint import yaw_of
from executor.assets.importers.importer import import_asset
from executor.assets.importers.store import ASSETS_VARIABLE, PREFIX, Imported
from executor.scenes.generators import household
from executor.scenes.generators.families import LONG_HORIZON, pair_of
from executor.scenes.pair import ScenePair
from executor.system.extras import require
from executor.system.files import read_json, write_json
from oag import Kind, Scene, SceneObject
from oag.model.scene import about_z

MOST_ROOMS = 10_000
HOUSEHOLD = "household"
_STREAM = 180  # Keeps these draws apart from those of the rooms.


@dataclass(frozen=True)
class DrawnRoom:
    """One pair of a scene and a query; equal ones are equal pairs.

    Attributes:
        family: "T1" to "T4", or "household" for T5 and T6.
        seed: Of the pair.
        index: Of household pairs, which of the seed's.
    """

    family: str
    seed: int
    index: int | None

    @property
    def name(self) -> str:
        """Fit for files."""
        return f"{self.family}-{self.seed}" + ("" if self.index is None else f"-{self.index:03d}")

    @property
    def entropy(self) -> tuple[int, int]:
        """Seeds of noise and detector errors."""
        kitchen = household.COUNT + (LONG_HORIZON.index(self.family) if self.family in LONG_HORIZON else 0)
        return self.seed, kitchen if self.index is None else self.index

    @property
    def camera_seed(self) -> int:
        """Seed of the camera's place."""
        return self.seed + (self.index or 0)

    def pair(self) -> ScenePair:
        """Return the scene and the query.

        Raises:
            NotDrawn: No room could be made of this seed.
        """
        return pair_of(self.family, self.seed, self.index)


def households(seed: int, count: int) -> list[DrawnRoom]:
    """Return so many household pairs: the first of a fixed shuffle of a seed's, then of the next seed's."""
    found = []
    for number in range(count):
        beyond, place = divmod(number, household.COUNT)
        order = np.random.default_rng([seed + beyond, _STREAM]).permutation(household.COUNT)
        found.append(DrawnRoom(HOUSEHOLD, seed + beyond, int(order[place])))
    return found


def kitchens(seed: int, count: int) -> list[DrawnRoom]:
    """Return so many kitchens, by turns of T1 to T4, each of a seed of its own."""
    return [DrawnRoom(LONG_HORIZON[number % len(LONG_HORIZON)], seed + number, None) for number in range(count)]


def drawn(seed: int, rooms: int, of_kitchens: int) -> list[DrawnRoom]:
    """Return household pairs and kitchens alternately, so that a part of a measurement has some of both."""
    both = itertools.zip_longest(households(seed, rooms), kitchens(seed, of_kitchens))
    return [room for turn in both for room in turn if room is not None]


class NamedRoom(Protocol):
    """Something that is measured once: a drawn room or a real picture."""

    @property
    def name(self) -> str:
        """Fit for files."""


_Subject = TypeVar("_Subject", bound=NamedRoom)


def each_once(
    folder: Path,
    kind: str,
    rooms: Sequence[_Subject],
    measured: Callable[[_Subject], dict[str, Any]],
    on_progress: Callable[[Mapping[str, Any]], None],
) -> Iterator[dict[str, Any]]:
    """Yield the result of every room, measured if it has no file yet, so that an interrupted run resumes.

    Args:
        folder: Folder of the files, one a room.
        kind: Prefix of the files' names.
        rooms: The rooms, or pictures.
        measured: Measures one.
        on_progress: Called with every result.
    """
    for room in rooms:
        path = folder / f"{kind}-{room.name}.json"
        result = read_json(path) if path.is_file() else measured(room)
        if not path.is_file():
            write_json(path, result)
        on_progress(result)
        yield result


CATEGORY = "ornament"
"""Their category, which the library does not have."""

_LARGEST_M = 0.1
_VASE = ((0.0, 0.0), (0.6, 0.0), (1.0, 0.9), (0.9, 1.5), (0.4, 2.0), (0.5, 2.4), (0.0, 2.4))
_STEPS = ((0, 0), (3, 0), (3, 1), (2, 1), (2, 2), (1, 2), (1, 3), (0, 3))
# trimesh's primitives: the function and its arguments.
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
"""Rotationally symmetric models."""


@contextmanager
def foreign_models(folder: Path) -> Iterator[tuple[Imported, ...]]:
    """Give the foreign models; scenes find them as long as the context is open.

    Args:
        folder: Folder of their files.

    Raises:
        MissingExtra: trimesh, or the library that splits meshes into convex pieces, is not installed.
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
    """Replace every item of a scene by a foreign one, at most as large as the item was."""
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
    function, arguments = _PRIMITIVES[name]
    known = dict(arguments)
    if "polygon" in known:
        known["polygon"] = require("shapely.geometry", "photo").Polygon(known["polygon"])
    mesh = getattr(require("trimesh.creation", "sim"), function)(**known)
    # Larger things would be taken for furniture.
    mesh.apply_scale(_LARGEST_M / float(mesh.extents.max()))
    folder.mkdir(parents=True, exist_ok=True)
    file = folder / f"{name}.stl"
    mesh.export(file)
    return import_asset(file, name, category=CATEGORY)
