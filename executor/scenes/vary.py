"""One scene, many starts: the ranges that a scene declares, drawn from a seed.

A scene's `variation` block:

    {"robot":   {"dx_m": [low, high], "dy_m": [...], "dyaw_rad": [...]},
     "objects": {"table_0": {"places": [{"x_m": 0, "y_m": -1.25, "yaw_rad": 0}, ...], "dx_m": [...], ...},
                 "glass_0": {"on": "table_0", "edge": "+y", "along_m": [...], "inset_m": [...]}}}

An object with `places` starts from one of them, drawn evenly, others from where they are; `dx_m`, `dy_m` and
`dyaw_rad` shift it from there. What rests on an object or in it moves with it. An object with `on` is put on
its support, `inset_m` in from the named edge of the support's own frame and `along_m` along it from the
middle. Entries apply in their order.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

import bddl
from executor.geometry import Array, inverse, pose_vector, rotation_z, transform, transform_from_quaternion
from oag import Scene, SceneObject

LARGEST_SEED = 2**31 - 1
MOST_EPISODES = 1_000_000
"""Seeds that one command or one row of a benchmark goes through."""
_SHIFTS = ("dx_m", "dy_m", "dyaw_rad")
_POSE = ("x_m", "y_m", "yaw_rad")
# Far outside any scene [m or rad]; no sum or difference of such numbers overflows.
_LARGEST = 1e6
_EDGES = {"+x": (0, 1.0), "-x": (0, -1.0), "+y": (1, 1.0), "-y": (1, -1.0)}
_MOVED_BY = frozenset({"ontop", "inside"})


class VariationError(ValueError):
    """A scene's `variation` block does not say what can be drawn."""

    def __init__(self, scene: str, place: str, problem: str) -> None:
        super().__init__(f"scene {scene}, variation{place}: {problem}")


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
    variation: Mapping[str, Any] = scene.variation
    name_hash = int.from_bytes(hashlib.sha256(scene.name.encode()).digest()[:8], "little")
    draw = _Draw(scene.name, np.random.default_rng([seed, name_hash]))
    draw.known(variation, ("robot", "objects"), "", "ranges")
    start = scene.robot
    dx, dy, dyaw = draw.shifts(variation.get("robot", {}), ".robot")
    x, y, z = start.position
    robot = replace(start, position=(x + dx, y + dy, z), yaw_rad=start.yaw_rad + dyaw)
    objects = dict(scene.objects)
    for name, entry in draw.mapping(variation.get("objects", {}), ".objects", "ids and their ranges").items():
        place = f".objects.{name}"
        if name not in objects:
            raise VariationError(scene.name, place, f"no such object; the scene has {', '.join(objects)}")
        if "on" in draw.mapping(entry, place, "ranges"):
            T_after = _on_support(draw, objects, name, entry, place)
        else:
            T_after = _shifted(draw, objects[name], entry, place)
        T_move = T_after @ inverse(_pose(objects[name]))
        for moved in (name, *_resting_on(scene, name)):
            objects[moved] = _placed(objects[moved], T_move @ _pose(objects[moved]))
    return replace(scene, robot=robot, objects=objects)


class _Draw:
    """Draws from declared ranges, in a fixed order, and says clearly where a declaration is wrong."""

    def __init__(self, scene: str, rng: np.random.Generator) -> None:
        self.scene = scene
        self.rng = rng

    def mapping(self, value: Any, place: str, what: str) -> Mapping[str, Any]:
        """The value, when it is a JSON object; `what` says of what, for the message."""
        if not isinstance(value, Mapping):
            raise VariationError(self.scene, place, f"expected an object of {what}, got {_shown(value)}")
        return value

    def known(self, entry: Any, legal: Sequence[str], place: str, what: str) -> None:
        """Refuses what is no JSON object, or has other keys than the legal ones."""
        unknown = sorted(set(self.mapping(entry, place, what)) - set(legal), key=str)
        if unknown:
            problem = f"unknown key {unknown[0]!r}; expected {', '.join(legal)}"
            raise VariationError(self.scene, place, problem)

    def uniform(self, entry: Mapping[str, Any], key: str, place: str) -> float:
        """One number from the entry's range; 0 without one."""
        limits = entry.get(key, (0.0, 0.0))
        pair = isinstance(limits, list | tuple) and len(limits) == 2
        if not pair or not all(_is_number(value) for value in limits) or limits[0] > limits[1]:
            problem = f"{_shown(limits)} is not [low, high], two numbers, the lower one first"
            raise VariationError(self.scene, f"{place}.{key}", problem)
        return float(self.rng.uniform(limits[0], limits[1]))

    def pose(self, entry: Any, place: str) -> tuple[float, float, float]:
        """A place as it is declared: x and y in metres, yaw in rad, which may be absent."""
        self.known(entry, _POSE, place, "x_m, y_m and yaw_rad")
        for key in _POSE:
            if key not in entry and key != "yaw_rad":
                raise VariationError(self.scene, place, f"the field {key!r} is missing; expected x_m, y_m and yaw_rad")
            if key in entry and not _is_number(entry[key]):
                raise VariationError(self.scene, f"{place}.{key}", f"expected a number, got {_shown(entry[key])}")
        return float(entry["x_m"]), float(entry["y_m"]), float(entry.get("yaw_rad", 0.0))

    def shifts(self, entry: Any, place: str) -> tuple[float, float, float]:
        """A shift (x, y in metres, yaw in rad) from an entry that has ranges only."""
        self.known(entry, _SHIFTS, place, "ranges")
        dx, dy, dyaw = (self.uniform(entry, key, place) for key in _SHIFTS)
        return dx, dy, dyaw


def _is_number(value: object) -> bool:
    """Decides whether a value is a number that a place or a range may have."""
    return isinstance(value, int | float) and not isinstance(value, bool) and -_LARGEST <= value <= _LARGEST


def _shown(value: object) -> str:
    """The value as a message repeats it, cut when it is long."""
    shown = repr(value)
    return shown if len(shown) <= 60 else f"{shown[:57]}..."


def _shifted(draw: _Draw, obj: SceneObject, entry: Mapping[str, Any], place: str) -> Array:
    """Pose of an object at one of its places, or where it is, shifted there."""
    T = _pose(obj)
    places = entry.get("places", ())
    if not isinstance(places, list | tuple):
        raise VariationError(draw.scene, f"{place}.places", f"expected a list of places, got {_shown(places)}")
    poses = [draw.pose(declared, f"{place}.places[{index}]") for index, declared in enumerate(places)]
    if poses:
        x, y, yaw = poses[int(draw.rng.integers(len(poses)))]
        T = transform(rotation_z(yaw), [x, y, obj.position[2]])
    ranges = {key: value for key, value in entry.items() if key != "places"}
    dx, dy, dyaw = draw.shifts(ranges, place)
    return transform(rotation_z(dyaw) @ T[:3, :3], T[:3, 3] + [dx, dy, 0.0])


def _on_support(
    draw: _Draw, objects: Mapping[str, SceneObject], name: str, entry: Mapping[str, Any], place: str
) -> Array:
    """Pose of an object on its support's top, near one edge of it."""
    draw.known(entry, ("on", "edge", "along_m", "inset_m", "dyaw_rad"), place, "ranges")
    support, edge = entry["on"], entry.get("edge")
    if not isinstance(support, str):
        raise VariationError(draw.scene, f"{place}.on", f"expected an object's id, got {_shown(support)}")
    if support not in objects:
        problem = f"no such object {support!r}; the scene has {', '.join(objects)}"
        raise VariationError(draw.scene, f"{place}.on", problem)
    if not isinstance(edge, str) or edge not in _EDGES:
        raise VariationError(draw.scene, f"{place}.edge", f"{_shown(edge)} is not one of {', '.join(_EDGES)}")
    axis, sign = _EDGES[edge]
    half = [extent / 2 for extent in objects[support].extent_m]
    local = [0.0, 0.0, half[2] + objects[name].extent_m[2] / 2]
    local[1 - axis] = draw.uniform(entry, "along_m", place)
    local[axis] = sign * (half[axis] - draw.uniform(entry, "inset_m", place))
    turn = rotation_z(draw.uniform(entry, "dyaw_rad", place))
    return _pose(objects[support]) @ transform(turn, local)


def _resting_on(scene: Scene, support: str) -> list[str]:
    """Everything that the facts put on or in an object, directly or through something else."""
    pairs = [
        literal.atom.args
        for fact in scene.facts
        for literal in bddl.literals(fact) or ()
        if literal.value and literal.atom.predicate in _MOVED_BY
    ]
    found: list[str] = []
    waiting = [support]
    while waiting:
        below = waiting.pop()
        above = [a for a, b in pairs if b == below and a in scene.objects and a != support and a not in found]
        found += above
        waiting += above
    return found


def _pose(obj: SceneObject) -> Array:
    return transform_from_quaternion(obj.position, obj.orientation)


def _placed(obj: SceneObject, T: Array) -> SceneObject:
    x, y, z, w, i, j, k = (float(value) for value in pose_vector(T))
    return replace(obj, position=(x, y, z), orientation=(w, i, j, k))
