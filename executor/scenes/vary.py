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

import networkx as nx
import numpy as np

import bddl
from executor.assets.footprint import EDGES
from executor.assets.resistance import GASKET_FORCE, HANDLE_FORCE
from executor.geometry import Array, inverse, pose_vector, rotation_z, transform, transform_from_quaternion
from oag import Scene, SceneObject
from oag.model.errors import InputError
from oag.model.jsonfile import JsonNode, shown

LARGEST_SEED = 2**31 - 1
MOST_EPISODES = 1_000_000
"""Seeds that one command or one row of a benchmark goes through."""

_SHIFTS = ("dx_m", "dy_m", "dyaw_rad")
_FORCES = (HANDLE_FORCE.name, GASKET_FORCE.name)
_LARGEST = 1e6
"""Far outside any scene [m or rad]; no sum or difference of such numbers overflows."""


class VariationError(InputError, ValueError):
    """A scene's `variation` block does not say what can be drawn."""

    what = "scene"


def vary(scene: Scene, seed: int) -> Scene:
    """Returns the scene that a seed stands for; equal scenes and seeds give equal results.

    Apply it after `Scene.with_scales`, so that a smaller object stands on its support as the larger one did.

    Args:
        scene: A scene; without a `variation` block it comes back as it is.
        seed: Any integer from 0.

    Raises:
        VariationError: When the block names unknown objects or keys, or a value is not of its form, such as a
            range that is no pair of numbers.
    """
    if not scene.variation:
        return scene
    name_hash = int.from_bytes(hashlib.sha256(scene.name.encode()).digest()[:8], "little")
    rng = np.random.default_rng([seed, name_hash])
    members = _members(JsonNode(scene.variation, "variation", scene.name, VariationError), "robot", "objects")
    dx, dy, dyaw = _shift(rng, _members(members["robot"], *_SHIFTS) if "robot" in members else {})
    start = scene.robot
    x, y, z = start.position
    robot = replace(start, position=(x + dx, y + dy, z), yaw_rad=start.yaw_rad + dyaw)
    objects = dict(scene.objects)
    for name, entry in members["objects"].items() if "objects" in members else ():
        if name not in objects:
            raise entry.fail(f"no such object; the scene has {', '.join(objects)}")
        placed = _on_support if "on" in entry.mapping() else _shifted
        T_move = placed(rng, objects, name, entry) @ inverse(_pose(objects[name]))
        for moved in (name, *_resting_on(scene, name)):
            objects[moved] = _placed(objects[moved], T_move @ _pose(objects[moved]))
        ranges = dict(entry.items())
        forces = {key: round(_uniform(rng, ranges[key]), 3) for key in _FORCES if key in ranges}
        objects[name] = replace(objects[name], parameters={**objects[name].parameters, **forces})
    return replace(scene, robot=robot, objects=objects)


def _shifted(rng: np.random.Generator, objects: Mapping[str, SceneObject], name: str, entry: JsonNode) -> Array:
    """Pose of an object at one of its places, or where it is, shifted there."""
    T, members = _pose(objects[name]), _members(entry, "places", *_SHIFTS, *_FORCES)
    poses = [_declared(place) for place in members["places"].elements()] if "places" in members else []
    if poses:
        x, y, yaw = poses[int(rng.integers(len(poses)))]
        T = transform(rotation_z(yaw), [x, y, objects[name].position[2]])
    dx, dy, dyaw = _shift(rng, members)
    return transform(rotation_z(dyaw) @ T[:3, :3], T[:3, 3] + [dx, dy, 0.0])


def _on_support(rng: np.random.Generator, objects: Mapping[str, SceneObject], name: str, entry: JsonNode) -> Array:
    """Pose of an object on its support's top, near one edge of it."""
    members = _members(entry, "on", "edge", "along_m", "inset_m", "dyaw_rad")
    support, edge = members["on"].string(), entry.require("edge").string()
    if support not in objects:
        raise members["on"].fail(f"no such object {support!r}; the scene has {', '.join(objects)}")
    if edge not in EDGES:
        raise members["edge"].fail(f"{shown(edge)} is not one of {', '.join(EDGES)}")
    axis, sign = EDGES[edge]
    half = [extent / 2 for extent in objects[support].extent_m]
    local = [0.0, 0.0, half[2] + objects[name].extent_m[2] / 2]
    local[1 - axis] = _uniform(rng, members.get("along_m"))
    local[axis] = sign * (half[axis] - _uniform(rng, members.get("inset_m")))
    turn = rotation_z(_uniform(rng, members.get("dyaw_rad")))
    return _pose(objects[support]) @ transform(turn, local)


def _shift(rng: np.random.Generator, members: Mapping[str, JsonNode]) -> tuple[float, float, float]:
    """A shift (x, y in metres, yaw in rad) from an entry's ranges."""
    dx, dy, dyaw = (_uniform(rng, members.get(key)) for key in _SHIFTS)
    return dx, dy, dyaw


def _uniform(rng: np.random.Generator, limits: JsonNode | None) -> float:
    """One number from a range; 0 without one."""
    low, high = (0.0, 0.0) if limits is None else limits.numbers(2, "low, high", -_LARGEST, _LARGEST)
    if limits is not None and low > high:
        raise limits.fail(f"expected [low, high], the lower one first, got {shown(limits.value)}")
    return float(rng.uniform(low, high))


def _declared(place: JsonNode) -> tuple[float, float, float]:
    """A place as it is declared: x and y in metres, yaw in rad, which may be absent."""
    members = _members(place, "x_m", "y_m", "yaw_rad")
    x, y = (place.require(key).within(-_LARGEST, _LARGEST) for key in ("x_m", "y_m"))
    return x, y, members["yaw_rad"].within(-_LARGEST, _LARGEST) if "yaw_rad" in members else 0.0


def _members(entry: JsonNode, *known: str) -> dict[str, JsonNode]:
    """The members of an object that has no other ones than those known."""
    entry.only(*known)
    return dict(entry.items())


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
