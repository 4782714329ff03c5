"""Vary a scene: draw start poses and door forces from the ranges that the scene declares.

A scene's `variation` block:

    {"robot":   {"dx_m": [low, high], "dy_m": [...], "dyaw_rad": [...]},
     "objects": {"table_0": {"places": [{"x_m": 0, "y_m": -1.25, "yaw_rad": 0}, ...], "dx_m": [...], ...},
                 "glass_0": {"on": "table_0", "edge": "+y", "along_m": [...], "inset_m": [...]}}}

An object with `places` starts at one of them, drawn uniformly; other objects start at their own pose. `dx_m`, `dy_m`
and `dyaw_rad` shift that start. Everything that rests on or in an object moves with it. An object with `on` is put on
its support, `inset_m` in from the named edge of the support's own frame and `along_m` along it from the middle. Entries
apply in their order. `handle_force_n` and `gasket_force_n` are ranges, too: the resistance of the doors and drawers of
an object without `on` (`executor.assets.library`).
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import replace
from operator import index
from typing import Annotated, Any, Literal

import networkx as nx
import numpy as np
from pydantic import BeforeValidator, Field

import bddl
from bddl.errors import Scene2DemoError
from executor.assets.footprint import EDGES
from executor.assets.resistance import GASKET_FORCE, HANDLE_FORCE
from executor.geometry import Array, inverse, pose_vector, rotation_z, transform, transform_from_quaternion
from oag import Scene, SceneObject
from oag.model.codec import Document, expected
from oag.model.diagnostics import InputError
from oag.model.forms import Form, numbers, unfit, within
from oag.task_definition import required_scene

LARGEST_SEED = 2**31 - 1
MOST_EPISODES = 1_000_000
"""Most seeds of one command or of one row of a benchmark."""

_FORCES = (HANDLE_FORCE.name, GASKET_FORCE.name)
_LARGEST = 1e6
"""Far outside any scene [m or rad]; no sum or difference of such numbers overflows."""


class VariationError(InputError, ValueError):
    """A scene's `variation` block cannot be drawn from."""

    what = "scene"


class SeedError(Scene2DemoError, ValueError):
    """A seed outside of the allowed range."""


def check_seed(seed: int) -> int:
    """Return a seed, if it is valid.

    Raises:
        SeedError: It is no whole number, is negative or is too large.
    """
    try:
        number = index(seed)
    except TypeError:
        number = -1
    if not 0 <= number <= LARGEST_SEED:
        raise SeedError(f"the seed {seed!r} is not possible: expected a whole number from 0 to {LARGEST_SEED}")
    return number


def vary(scene: Scene, seed: int) -> Scene:
    """Return the scene of a seed; equal scenes and seeds give equal results.

    Apply it after `Scene.with_scales`, so that a smaller object stands on its support as the larger one did.

    Args:
        scene: A scene; without a `variation` block it is returned unchanged.
        seed: Any integer from 0 to `LARGEST_SEED`.

    Raises:
        SeedError: It is another number.
        VariationError: The block names unknown objects or keys, or a value has the wrong form, such as a range that is
            no pair of numbers.
    """
    seed = check_seed(seed)
    if not required_scene(scene).variation:
        return scene
    name_hash = int.from_bytes(hashlib.sha256(scene.name.encode()).digest()[:8], "little")
    rng = np.random.default_rng([seed, name_hash])
    document = Document({"variation": scene.variation}, scene.name, VariationError)
    form = document.read(_Variation, "variation")
    dx, dy, dyaw = _shift(rng, form.robot)
    start = scene.robot
    x, y, z = start.position
    robot = replace(start, position=(x + dx, y + dy, z), yaw_rad=start.yaw_rad + dyaw)
    objects = dict(scene.objects)
    for name, given in form.objects.items():
        place = ("variation", "objects", name)
        if name not in objects:
            raise document.fail(place, f"no such object; the scene has {', '.join(objects)}")
        forces: dict[str, float] = {}
        if isinstance(given, Mapping) and "on" in given:
            entry = document.read(_OnSupport, *place)
            if entry.on not in objects:
                problem = f"no such object {entry.on!r}; the scene has {', '.join(objects)}"
                raise document.fail((*place, "on"), problem)
            T = _on_support(rng, objects[entry.on], objects[name], entry)
        else:
            shifted = document.read(_Shifted, *place)
            T = _moved(rng, objects[name], shifted)
            ranges = {key: getattr(shifted, key) for key in _FORCES if key in shifted.model_fields_set}
            forces = {key: round(rng.uniform(*limits), 3) for key, limits in ranges.items()}
        T_move = T @ inverse(_pose(objects[name]))
        for moved in (name, *resting_on(scene, name)):
            objects[moved] = _placed(objects[moved], T_move @ _pose(objects[moved]))
        objects[name] = replace(objects[name], parameters={**objects[name].parameters, **forces})
    return replace(scene, robot=robot, objects=objects)


def _lower_first(value: object) -> tuple[float, ...]:
    low, high = numbers(value, 2, "low, high", -_LARGEST, _LARGEST)
    if low > high:
        raise unfit(expected("[low, high], the lower one first", value))
    return low, high


_Range = Annotated[tuple[float, float], BeforeValidator(_lower_first)]
_Coordinate = Annotated[float, within(-_LARGEST, _LARGEST)]
_NOTHING: _Range = (0.0, 0.0)


class _Shift(Form):
    dx_m: _Range = _NOTHING
    dy_m: _Range = _NOTHING
    dyaw_rad: _Range = _NOTHING


class _Place(Form):
    x_m: _Coordinate
    y_m: _Coordinate
    yaw_rad: _Coordinate = 0.0


class _Shifted(_Shift):
    places: tuple[_Place, ...] = ()
    handle_force_n: _Range = _NOTHING
    gasket_force_n: _Range = _NOTHING


class _OnSupport(Form):
    on: str
    edge: Literal["+x", "-x", "+y", "-y"]
    along_m: _Range = _NOTHING
    inset_m: _Range = _NOTHING
    dyaw_rad: _Range = _NOTHING


class _Variation(Form):
    robot: _Shift = _Shift()
    objects: dict[str, Any] = Field(default_factory=dict)


def _moved(rng: np.random.Generator, thing: SceneObject, entry: _Shifted) -> Array:
    """Return an object's pose at one of its places, or at its own, with the drawn shift."""
    T = _pose(thing)
    if entry.places:
        at = entry.places[int(rng.integers(len(entry.places)))]
        T = transform(rotation_z(at.yaw_rad), [at.x_m, at.y_m, thing.position[2]])
    dx, dy, dyaw = _shift(rng, entry)
    return transform(rotation_z(dyaw) @ T[:3, :3], T[:3, 3] + [dx, dy, 0.0])


def _on_support(rng: np.random.Generator, support: SceneObject, thing: SceneObject, entry: _OnSupport) -> Array:
    """Pose of an object on its support's top, near one edge of it."""
    axis, sign = EDGES[entry.edge]
    half = [extent / 2 for extent in support.extent_m]
    local = [0.0, 0.0, half[2] + thing.extent_m[2] / 2]
    local[1 - axis] = rng.uniform(*entry.along_m)
    local[axis] = sign * (half[axis] - rng.uniform(*entry.inset_m))
    return _pose(support) @ transform(rotation_z(rng.uniform(*entry.dyaw_rad)), local)


def _shift(rng: np.random.Generator, entry: _Shift) -> tuple[float, float, float]:
    return rng.uniform(*entry.dx_m), rng.uniform(*entry.dy_m), rng.uniform(*entry.dyaw_rad)


def resting_on(scene: Scene, support: str) -> set[str]:
    """Return everything that the facts put on or in an object, directly or indirectly."""
    above = nx.DiGraph()
    above.add_node(support)
    for literal in (literal for fact in scene.facts for literal in bddl.literals(fact) or ()):
        predicate, thing, *rest = literal.atom.label
        if literal.value and predicate in ("ontop", "inside") and thing in scene.objects:
            above.add_edge(rest[0], thing)
    return set(nx.descendants(above, support))


def _pose(obj: SceneObject) -> Array:
    return transform_from_quaternion(obj.position, obj.orientation)


def _placed(obj: SceneObject, T: Array) -> SceneObject:
    x, y, z, w, i, j, k = (float(value) for value in pose_vector(T))
    return replace(obj, position=(x, y, z), orientation=(w, i, j, k))
