"""A room in the making: what stands where, what rests on what, and the scene that comes of it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from itertools import count

import numpy as np

import bddl
from executor.assets import library
from executor.scenes.rooms.footprint import Footprint
from oag import RobotPose, Scene, SceneObject
from oag.table.library import OPEN_FRACTION

CLOSED = frozenset({"ontop", "inside", "open"})
_TOUCH_M = 1e-4
# What things of a category are called; the others go by the last word of their category.
_CALLED = {"desk_with_drawers": "desk", "medicine_bottle": "medicine"}


class NoRoom(ValueError):
    """A thing does not fit where it was meant to be.

    Attributes:
        object_id: The thing.
    """

    def __init__(self, object_id: str, problem: str) -> None:
        super().__init__(f"{object_id}: {problem}")
        self.object_id = object_id


class Room:
    """A rectangle of floor around the origin, and what is in it so far.

    Args:
        name: Name of the scene.
        kind: Name of the room, such as "kitchen", which facts of `inroom` give to everything in it.
        rng: Where everything that is left to chance is drawn from.
        depth_m: Length along x.
        width_m: Length along y.

    Attributes:
        objects: id -> object, in the order in which they were placed.
        robot: Where the robot starts.
        solid_walls: Walls to build: those that furniture was stood against, also where it was taken away again.
    """

    def __init__(self, name: str, kind: str, rng: np.random.Generator, depth_m: float, width_m: float) -> None:
        self.name, self.kind, self.rng = name, kind, rng
        self.depth_m, self.width_m = depth_m, width_m
        self.objects: dict[str, SceneObject] = {}
        self.robot = RobotPose()
        self.solid_walls: set[str] = set()
        self._relations: list[bddl.Atom] = []
        self._issued: set[str] = set()

    def draw(
        self,
        model: str,
        object_id: str | None = None,
        *,
        extent_m: Mapping[str, float] | None = None,
        parameters: Mapping[str, object] | None = None,
    ) -> SceneObject:
        """Returns a variation of a model of the library, not yet placed.

        Args:
            model: Name in the library.
            object_id: Its id; by default what it is, numbered in the order of drawing (`cabinet_0`, `cabinet_1`).
            extent_m: Lengths along some of its own axes, such as {"z": 0.6}, instead of drawn ones.
            parameters: Parameters with these values, instead of drawn ones.

        Raises:
            ModelNotFound: When the library has no such model.
        """
        sampled = library.sample(model, int(self.rng.integers(2**31)))
        stem = _CALLED.get(sampled.category, sampled.category.rsplit("_", 1)[-1])
        if object_id is None:
            object_id = next(
                name for number in count() if (name := f"{stem}_{number}") not in {*self._issued, *self.objects}
            )
        self._issued.add(object_id)
        length, width, height = sampled.bbox_extent
        given = extent_m or {}
        extent = (given.get("x", length), given.get("y", width), given.get("z", height))
        return replace(
            sampled,
            id=object_id,
            bbox_extent=extent,
            position=(0.0, 0.0, extent[2] / 2),
            parameters={**sampled.parameters, **(parameters or {})},
        )

    def put(self, obj: SceneObject, x_m: float, y_m: float, z_m: float, yaw_rad: float) -> SceneObject:
        """Adds an object upright at a place and returns it as it stands.

        Args:
            obj: The object, not yet placed.
            x_m, y_m: Middle of its box.
            z_m: Height of its bottom.
            yaw_rad: Heading of its own x axis.

        Raises:
            NoRoom: Its box overlaps another thing's, or its id is taken.
        """
        if obj.id in self.objects:
            raise NoRoom(obj.id, "the room has a thing of this id already")
        half_turn = yaw_rad / 2
        placed = replace(
            obj,
            position=(float(x_m), float(y_m), float(z_m + obj.extent_m[2] / 2)),
            orientation=(math.cos(half_turn), 0.0, 0.0, math.sin(half_turn)),
        )
        self.check_free(placed)
        self.objects[obj.id] = placed
        return placed

    def check_free(self, obj: SceneObject, gap_m: float = 0.0) -> None:
        """Returns when no box of another thing is nearer than a gap to the object's.

        What it stands on or in is above or below it, or holds it; see `relate`.

        Raises:
            NoRoom: One is; the message names it.
        """
        mine = Footprint.of(obj)
        for other in self.objects.values():
            if other.id == obj.id or other.id in self.holders(obj.id):
                continue
            theirs = Footprint.of(other)
            found_m = mine.gap_m(theirs)
            if found_m < gap_m - _TOUCH_M and mine.beside(theirs):
                problem = f"overlaps {other.id}" if found_m < -_TOUCH_M else f"is only {found_m:.3f} m from {other.id}"
                raise NoRoom(obj.id, problem)

    def relate(self, relation: str, object_id: str, support: str) -> None:
        """Notes that a thing is `ontop` of another or `inside` it."""
        self._relations.append(bddl.Atom(relation, (object_id, support)))

    def forget(self, object_id: str) -> None:
        """Drops what was noted of a thing that found no place; its id may be given to another one."""
        self._issued.discard(object_id)
        self._relations = [atom for atom in self._relations if object_id not in atom.args]

    def holders(self, object_id: str) -> frozenset[str]:
        """Returns the ids of what a thing stands on or in, of what that stands on or in, and so on."""
        found: set[str] = set()
        waiting = [object_id]
        while waiting:
            above = waiting.pop()
            below = {atom.args[1] for atom in self._relations if atom.args[0] == above} - found
            found |= below
            waiting += sorted(below)
        return frozenset(found)

    def scene(self) -> Scene:
        """Returns the scene: its facts say what rests on and in what, what is open, and the room of everything."""
        facts: list[bddl.Formula] = [*self._relations]
        for obj in self.objects.values():
            if obj.kind.name == "ARTICULATED":
                state = bddl.Atom("open", (obj.id,))
                facts.append(state if _open_fraction(obj) > OPEN_FRACTION else bddl.Not(state))
        facts += [bddl.Atom("inroom", (object_id, self.kind)) for object_id in self.objects]
        return Scene(self.name, self.robot, dict(self.objects), tuple(facts), CLOSED)


def _open_fraction(obj: SceneObject) -> float:
    value = obj.parameters.get("open_fraction", 0.0)
    return float(value) if isinstance(value, int | float) else 0.0
