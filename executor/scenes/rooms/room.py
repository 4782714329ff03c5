"""A room in the making: what stands where, what rests on what, and the scene that comes of it."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from itertools import count
from typing import Self

import networkx as nx
import numpy as np

import bddl
from executor.assets import library
from executor.assets.footprint import Footprint, gaps_m, open_fraction
from executor.geometry import pose_vector, rotation_z, transform_from_quaternion
from oag import RobotPose, Scene, SceneObject
from oag.model.categories import Kind
from oag.table.library import OPEN_FRACTION

CABINETS = ("cabinet_one_door", "cabinet_two_doors", "cabinet_drawers", "cabinet_drawers_doors")
UNITS = (*CABINETS, "counter_plain")
COOKERS = ("oven_bottom_hinge", "dishwasher_bottom_hinge")
COOKER_LEAST_M = 0.80
"""The library's ovens and dishwashers are no lower."""

CLOSED = frozenset({"ontop", "inside", "open"})
_TOUCH_M = 1e-4  # Rounding: things may touch.
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
        stray: Draws how a target differs from what is drawn for it; by default none does.

    Attributes:
        objects: id -> object, in the order in which they were placed.
        strays: Target's id -> how it differs.
        robot: Where the robot starts.
        solid_walls: Walls to build: those that furniture was stood against, also where it was taken away again.
    """

    def __init__(
        self,
        name: str,
        kind: str,
        rng: np.random.Generator,
        depth_m: float,
        width_m: float,
        stray: Callable[[SceneObject], Stray] | None = None,
    ) -> None:
        self.name, self.kind, self.rng = name, kind, rng
        self.depth_m, self.width_m = depth_m, width_m
        self.objects: dict[str, SceneObject] = {}
        self.robot = RobotPose()
        self.strays: dict[str, Stray] = {}
        self.solid_walls: set[str] = set()
        self._stray = stray
        self._relations: list[bddl.Atom] = []
        self._issued: set[str] = set()

    def draw(
        self,
        model: str,
        object_id: str | None = None,
        *,
        extent_m: Mapping[str, float] | None = None,
        parameters: Mapping[str, object] | None = None,
        target: bool = False,
    ) -> SceneObject:
        """Returns a variation of a model of the library, not yet placed.

        Args:
            model: Name in the library.
            object_id: Its id; by default what it is, numbered in the order of drawing (`cabinet_0`, `cabinet_1`).
            extent_m: Lengths along some of its own axes, such as {"z": 0.6}, instead of drawn ones.
            parameters: Parameters with these values, instead of drawn ones.
            target: Whether a task is about it: its size then strays where that is asked for, and whoever stands it
                somewhere turns it by `turn_rad`.

        Raises:
            ModelNotFound: When the library has no such model.
        """
        given = extent_m or {}
        drawn = library.sample(model, int(self.rng.integers(2**31)))
        x, y, z = (given.get(axis, length) for axis, length in zip("xyz", drawn.bbox_extent, strict=True))
        drawn = replace(drawn, bbox_extent=(x, y, z), position=(0.0, 0.0, z / 2))
        if object_id is None:
            stem = _CALLED.get(drawn.category, drawn.category.rsplit("_", 1)[-1])
            taken = {*self._issued, *self.objects}
            object_id = next(name for number in count() if (name := f"{stem}_{number}") not in taken)
        self._issued.add(object_id)
        drawn = replace(drawn, id=object_id, parameters={**drawn.parameters, **(parameters or {})})
        if self._stray is None or not target:
            return drawn
        self.strays[object_id] = self._stray(drawn)
        return self.strays[object_id].sized(drawn)

    def turn_rad(self, object_id: str) -> float:
        """Returns by how much a thing stands askew: a target that strays, not others."""
        return self.strays[object_id].turned_rad if object_id in self.strays else 0.0

    def put(self, obj: SceneObject, x_m: float, y_m: float, z_m: float, yaw_rad: float) -> None:
        """Adds an object upright at a place.

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
        blocker = self.blocker(obj.id, Footprint.of(placed), -_TOUCH_M)
        if blocker is not None:
            raise NoRoom(obj.id, f"overlaps {blocker}")
        self.objects[obj.id] = placed

    def blocker(self, object_id: str, mine: Footprint, clear_m: float) -> str | None:
        """Returns the id of another thing that is nearer to a thing's box than a clearance, None where none is.

        What the thing stands on or in is above or below it, or holds it, and is never in its way; see `relate`.
        """
        own = {object_id, *self.holders(object_id)}
        others = {name: Footprint.of(other) for name, other in self.objects.items() if name not in own}
        return next((name for name, gap_m in gaps_m(mine, others) if gap_m < clear_m), None)

    def has_inside(self, footprint: Footprint, tolerance_m: float = 0.0) -> bool:
        """Decides whether a box reaches beyond none of the room's sides."""
        half = np.array([self.depth_m, self.width_m]) / 2 + tolerance_m
        return bool((np.abs(footprint.corners_m) <= half).all())

    def relate(self, relation: str, object_id: str, support: str) -> None:
        """Notes that a thing is `ontop` of another or `inside` it."""
        self._relations.append(bddl.Atom(relation, (object_id, support)))

    def forget(self, object_id: str) -> None:
        """Drops what was noted of a thing that found no place; its id may be given to another one."""
        self._issued.discard(object_id)
        self._relations = [atom for atom in self._relations if object_id not in atom.args]

    def holders(self, object_id: str) -> frozenset[str]:
        """Returns the ids of what a thing stands on or in, of what that stands on or in, and so on."""
        below = nx.DiGraph(atom.args for atom in self._relations)
        below.add_node(object_id)
        return frozenset(nx.descendants(below, object_id))

    def scene(self) -> Scene:
        """Returns the scene: its facts say what rests on and in what, what is open, and the room of everything."""
        facts: list[bddl.Formula] = [*self._relations]
        for obj in self.objects.values():
            if obj.kind.name == "ARTICULATED":
                state = bddl.Atom("open", (obj.id,))
                facts.append(state if open_fraction(obj) > OPEN_FRACTION else bddl.Not(state))
        facts += [bddl.Atom("inroom", (object_id, self.kind)) for object_id in self.objects]
        return Scene(self.name, self.robot, dict(self.objects), tuple(facts), CLOSED)


@dataclass(frozen=True, slots=True)
class Units:
    """Kitchen units under one worktop: cabinets, counters and appliances of one height and depth.

    Attributes:
        height_m: Of their tops above the floor.
        depth_m: From their backs to the front of their handles.
    """

    height_m: float
    depth_m: float

    @classmethod
    def drawn(cls, room: Room, height_m: tuple[float, float] = (0.72, 0.86)) -> Units:
        """Returns the units of a kitchen, their height drawn from a range."""
        height, depth = room.rng.uniform(*height_m), room.rng.uniform(0.60, 0.65)
        return cls(round(float(height), 3), round(float(depth), 3))

    @property
    def models(self) -> tuple[str, ...]:
        """The models that can be of this height."""
        return (*UNITS, *COOKERS) if self.height_m >= COOKER_LEAST_M else UNITS

    def draw(self, room: Room, model: str, object_id: str | None = None) -> SceneObject:
        """Returns a unit of one of the `models`, not yet placed; for the id see `Room.draw`."""
        return room.draw(model, object_id, extent_m={"x": self.depth_m, "z": self.height_m})


Draws = Callable[[str], np.random.Generator]
"""Name of what is drawn -> what draws it."""

_SCALE, _YAW_RAD = 0.10, math.pi / 12  # The paper's.


@dataclass(frozen=True, slots=True)
class Stray:
    """How a target differs from what it was laid out as.

    Attributes:
        wider, deeper, higher: Factors of its sides along its own x, y and z; an item's first two are one number, since
            round things stay round.
        turned_rad: By how much it is turned where it stands.
    """

    wider: float
    deeper: float
    higher: float
    turned_rad: float

    @classmethod
    def drawn(cls, thing: SceneObject, draws: Draws, attempt: int = 0) -> Self:
        """Returns what is drawn for a target.

        Args:
            thing: The target.
            draws: Draws it, by the target's name.
            attempt: Number of the layout that it is drawn for, where several are tried.
        """
        rng = draws(f"target {thing.id} {attempt}" if attempt else f"target {thing.id}")
        item = thing.kind is Kind.ITEM
        wider, *others = (round(float(value), 4) for value in rng.uniform(1 - _SCALE, 1 + _SCALE, 2 if item else 3))
        deeper, higher = (wider, *others) if item else others
        return cls(wider, deeper, higher, round(float(rng.uniform(-_YAW_RAD, _YAW_RAD)), 4))

    def sized(self, thing: SceneObject) -> SceneObject:
        """Returns a target in its other size, the middle of its box where it was."""
        a, b, c = thing.scale
        return replace(thing, scale=(a * self.wider, b * self.deeper, c * self.higher))

    def standing(self, thing: SceneObject) -> SceneObject:
        """Returns a target in its other size and turned, its bottom where it was."""
        T = transform_from_quaternion(thing.position, thing.orientation)
        T[:3, 3] += T[:3, 2] * (self.higher - 1.0) * thing.extent_m[2] / 2
        T[:3, :3] = rotation_z(self.turned_rad)[:3, :3] @ T[:3, :3]
        x, y, z, w, i, j, k = (float(value) for value in pose_vector(T))
        return replace(self.sized(thing), position=(x, y, z), orientation=(w, i, j, k))
