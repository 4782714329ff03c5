"""One scene, many starts: the ranges that a scene declares, drawn from a seed.

A scene's `variation` block:

    {"robot":   {"dx_m": [low, high], "dy_m": [...], "dyaw_rad": [...]},
     "objects": {"table_0": {"places": [{"x_m": 0, "y_m": -1.25, "yaw_rad": 0}, ...], "dx_m": [...], ...},
                 "glass_0": {"on": "table_0", "edge": "+y", "along_m": [...], "inset_m": [...]}}}

An object with `places` starts from one of them, drawn evenly, others from where they are; `dx_m`, `dy_m` and
`dyaw_rad` shift it from there. What rests on an object or in it moves with it. An object with `on` is put on
its support, `inset_m` in from the named edge of the support's own frame and `along_m` along it from the
middle. Entries apply in their order. `handle_force_n` and `gasket_force_n`, ranges as well, say what the doors and
drawers of an object without `on` ask of the hand (`executor.assets.resistance`).
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
from executor.assets.footprint import EDGES
from executor.assets.resistance import GASKET_FORCE, HANDLE_FORCE
from executor.geometry import Array, inverse, pose_vector, rotation_z, transform, transform_from_quaternion
from oag import Scene, SceneObject
from oag.model.errors import InputError
from oag.model.forms import Form, numbers, unfit, within
from oag.model.jsonfile import Document, expected
from oag.task.task import required_scene

LARGEST_SEED = 2**31 - 1
MOST_EPISODES = 1_000_000
"""Seeds that one command or one row of a benchmark goes through."""

_FORCES = (HANDLE_FORCE.name, GASKET_FORCE.name)
_LARGEST = 1e6
"""Far outside any scene [m or rad]; no sum or difference of such numbers overflows."""


class VariationError(InputError, ValueError):
    """A scene's `variation` block does not say what can be drawn."""

    what = "scene"


class SeedError(ValueError):
    """A seed from which nothing can be drawn."""


def check_seed(seed: int) -> int:
    """Returns a seed from which can be drawn.

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
    """Returns the scene that a seed stands for; equal scenes and seeds give equal results.

    Apply it after `Scene.with_scales`, so that a smaller object stands on its support as the larger one did.

    Args:
        scene: A scene; without a `variation` block it comes back as it is.
        seed: Any integer from 0 to `LARGEST_SEED`.

    Raises:
        SeedError: It is another number.
        VariationError: When the block names unknown objects or keys, or a value is not of its form, such as a
            range that is no pair of numbers.
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
        for moved in (name, *_resting_on(scene, name)):
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
    """Pose of an object at one of its places, or where it is, shifted there."""
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
    """A shift (x, y in metres, yaw in rad) from an entry's ranges."""
    return rng.uniform(*entry.dx_m), rng.uniform(*entry.dy_m), rng.uniform(*entry.dyaw_rad)


def _resting_on(scene: Scene, support: str) -> set[str]:
    """Everything that the facts put on or in an object, directly or through something else."""
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
