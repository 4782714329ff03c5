"""Lay out a room: furniture along walls and free on the floor, walls, and the resulting scene.

    rng = np.random.default_rng(7)
    room = Room("my_kitchen", "kitchen", rng, depth_m=3.4, width_m=3.6)
    fridge = room.draw("fridge_one_door", parameters={"hinge": "right"})          # a SceneObject, not yet placed
    left, right = room.draw("cabinet_drawers"), room.draw("counter_plain")
    row(room, "east", [left, fridge, right], along_m=0.2, gaps_m=[0.0, 0.03])     # fronts look into the room
    table = stand(room, room.draw("table_four_legs"), -0.6, -0.9, yaw_rad=0.0)    # free-standing; returns its id
    build_walls(room)                                                             # solid; only those in use
    scene = room.scene()                                                          # facts and `closed` included

`executor.scenes.placement` puts things on and in the furniture and finds a place for the robot. `Units` draws cabinets,
counters and cookers of one height and depth, so that a row has one worktop.

Everything is drawn from the room's generator: equal generators and equal calls give equal scenes. A thing that does not
fit raises `NoRoom`, which names the thing and the obstacle. `executor.scenes.validation.settle` then runs physics.

Frames: walls are "east" (+x), "north" (+y), "west" and "south" of a rectangle around the origin. A position along a
wall is measured from the wall's middle, positive to the left as seen by somebody who faces the wall.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import count
from types import MappingProxyType
from typing import Self

import networkx as nx
import numpy as np

import bddl
from executor.assets import library
from executor.assets.footprint import Footprint, gaps_m
from executor.geometry import pose_vector, rotation_z, transform_from_quaternion
from executor.scenes.support_relations import door_states
from oag import Scene, SceneObject
from oag.model.scene import RobotPose
from oag.model.symbols import Kind

WALLS: Mapping[str, float] = MappingProxyType(
    {"east": 0.0, "north": math.pi / 2, "west": math.pi, "south": -math.pi / 2}
)
"""The walls, and the heading of somebody who faces each; furniture against one has this yaw."""

BEHIND_M = 0.01
WALL_M = 0.08
WALL_HEIGHTS_M: Mapping[str, float] = MappingProxyType({"east": 2.0, "north": 2.0, "west": 1.0, "south": 1.0})
"""Two walls are breast-high: the sun of the pictures stands there, and cameras look in over them."""

CABINETS = ("cabinet_one_door", "cabinet_two_doors", "cabinet_drawers", "cabinet_drawers_doors")
UNITS = (*CABINETS, "counter_plain")
COOKERS = ("oven_bottom_hinge", "dishwasher_bottom_hinge")
COOKER_LEAST_M = 0.80
"""Least height of the library's ovens and dishwashers."""

CLOSED = frozenset({"ontop", "inside", "open"})
_TOUCH_M = 1e-4  # Rounding: things may touch.
_TOLERANCE_M = 1e-6  # Rounding.
# Short names of categories; the default is the last word of the category.
_CALLED = {"desk_with_drawers": "desk", "medicine_bottle": "medicine"}


class NoRoom(ValueError):
    """A thing does not fit in its intended place."""

    def __init__(self, object_id: str, problem: str) -> None:
        super().__init__(f"{object_id}: {problem}")
        self.object_id = object_id


class Room:
    """A rectangle of floor around the origin, and the objects placed in it.

    Args:
        kind: Kind of the room, such as "kitchen", for the `inroom` facts of everything in it.
        rng: Source of all random draws.
        depth_m: Length along x.
        width_m: Length along y.
        draw_perturbation: Draws the perturbation of a target; None for no perturbation.

    Attributes:
        objects: id -> object, in the order of placement.
        perturbations: Target's id -> its perturbation.
        robot: Start pose of the robot.
        solid_walls: Walls to build: those with furniture against them, even if it was removed again.
    """

    def __init__(
        self,
        name: str,
        kind: str,
        rng: np.random.Generator,
        depth_m: float,
        width_m: float,
        draw_perturbation: Callable[[SceneObject], Perturbation] | None = None,
    ) -> None:
        self.name, self.kind, self.rng = name, kind, rng
        self.depth_m, self.width_m = depth_m, width_m
        self.objects: dict[str, SceneObject] = {}
        self.robot = RobotPose()
        self.perturbations: dict[str, Perturbation] = {}
        self.solid_walls: set[str] = set()
        self._draw_perturbation = draw_perturbation
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
        """Draw a variation of a model of the library, not yet placed.

        Args:
            object_id: Its id; by default its short name, numbered in the order of drawing (`cabinet_0`, `cabinet_1`).
            extent_m: Lengths along some of its own axes, such as {"z": 0.6}, instead of drawn ones.
            parameters: Parameters with these values, instead of drawn ones.
            target: Whether a task is about it. Its size is then perturbed if requested, and placement turns it by
                `turn_rad`.
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
        if self._draw_perturbation is None or not target:
            return drawn
        self.perturbations[object_id] = self._draw_perturbation(drawn)
        return self.perturbations[object_id].sized(drawn)

    def turn_rad(self, object_id: str) -> float:
        """Return the yaw perturbation of an object: 0 but for perturbed targets."""
        return self.perturbations[object_id].turned_rad if object_id in self.perturbations else 0.0

    def put(self, obj: SceneObject, x_m: float, y_m: float, z_m: float, yaw_rad: float) -> None:
        """Add an object upright at a place.

        Args:
            obj: The object, not yet placed.
            x_m, y_m: Centre of its box.
            z_m: Height of its bottom.
            yaw_rad: Heading of its own x axis.

        Raises:
            NoRoom: Its box overlaps another object's, or its id is taken.
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
        """Return the id of another object nearer to a box than a clearance, or None.

        Direct and indirect supports of an object never block it; see `relate`.
        """
        own = {object_id, *self.holders(object_id)}
        others = {name: Footprint.of(other) for name, other in self.objects.items() if name not in own}
        return next((name for name, gap_m in gaps_m(mine, others) if gap_m < clear_m), None)

    def has_inside(self, footprint: Footprint, tolerance_m: float = 0.0) -> bool:
        """Return whether a box stays within all sides of the room."""
        half = np.array([self.depth_m, self.width_m]) / 2 + tolerance_m
        return bool((np.abs(footprint.corners_m) <= half).all())

    def relate(self, relation: str, object_id: str, support: str) -> None:
        """Record that a thing is `ontop` of another or `inside` it."""
        self._relations.append(bddl.Atom(relation, (object_id, support)))

    def forget(self, object_id: str) -> None:
        """Drop the relations of a thing that found no place; its id may be reused."""
        self._issued.discard(object_id)
        self._relations = [atom for atom in self._relations if object_id not in atom.args]

    def holders(self, object_id: str) -> frozenset[str]:
        """Return the ids of an object's direct and indirect supports."""
        below = nx.DiGraph(atom.args for atom in self._relations)
        below.add_node(object_id)
        return frozenset(nx.descendants(below, object_id))

    def scene(self) -> Scene:
        """Return the scene, with facts on support relations, door states, and the room of everything."""
        in_room = (bddl.Atom("inroom", (object_id, self.kind)) for object_id in self.objects)
        facts: tuple[bddl.Formula, ...] = (*self._relations, *door_states(self.objects.values()), *in_room)
        return Scene(self.name, self.robot, dict(self.objects), facts, CLOSED)


@dataclass(frozen=True, slots=True)
class Units:
    """Kitchen units under one worktop: cabinets, counters and appliances of one height and depth.

    Attributes:
        height_m: Height of their tops above the floor.
        depth_m: Length from their backs to the front of their handles.
    """

    height_m: float
    depth_m: float

    @classmethod
    def drawn(cls, room: Room, height_m: tuple[float, float] = (0.72, 0.86)) -> Units:
        """Return the units of a kitchen, their height drawn from a range."""
        height, depth = room.rng.uniform(*height_m), room.rng.uniform(0.60, 0.65)
        return cls(round(float(height), 3), round(float(depth), 3))

    @property
    def models(self) -> tuple[str, ...]:
        """The models that can be of this height."""
        return (*UNITS, *COOKERS) if self.height_m >= COOKER_LEAST_M else UNITS

    def draw(self, room: Room, model: str, object_id: str | None = None) -> SceneObject:
        """Return a unit of one of the `models`, not yet placed; for the id see `Room.draw`."""
        return room.draw(model, object_id, extent_m={"x": self.depth_m, "z": self.height_m})


Draws = Callable[[str], np.random.Generator]
"""Name of a quantity -> its random generator."""

_SCALE, _YAW_RAD = 0.10, math.pi / 12  # The paper's.


@dataclass(frozen=True, slots=True)
class Perturbation:
    """How a target differs from its layout.

    Attributes:
        wider, deeper, higher: Factors of its sides along its own x, y and z. An item's first two are equal, so that
            round items stay round.
        turned_rad: Turn about the vertical where it stands.
    """

    wider: float
    deeper: float
    higher: float
    turned_rad: float

    @classmethod
    def drawn(cls, thing: SceneObject, draws: Draws, attempt: int = 0) -> Self:
        """Draw the perturbation of a target.

        Args:
            draws: Returns the generator for a target's name.
            attempt: Number of the layout that it is drawn for, if several are tried.
        """
        rng = draws(f"target {thing.id} {attempt}" if attempt else f"target {thing.id}")
        item = thing.kind is Kind.ITEM
        wider, *others = (round(float(value), 4) for value in rng.uniform(1 - _SCALE, 1 + _SCALE, 2 if item else 3))
        deeper, higher = (wider, *others) if item else others
        return cls(wider, deeper, higher, round(float(rng.uniform(-_YAW_RAD, _YAW_RAD)), 4))

    def sized(self, thing: SceneObject) -> SceneObject:
        """Return a target with its perturbed size, the centre of its box kept."""
        a, b, c = thing.scale
        return replace(thing, scale=(a * self.wider, b * self.deeper, c * self.higher))

    def standing(self, thing: SceneObject) -> SceneObject:
        """Return a target with its perturbed size and turn, the height of its bottom kept."""
        T = transform_from_quaternion(thing.position, thing.orientation)
        T[:3, 3] += T[:3, 2] * (self.higher - 1.0) * thing.extent_m[2] / 2
        T[:3, :3] = rotation_z(self.turned_rad)[:3, :3] @ T[:3, :3]
        x, y, z, w, i, j, k = (float(value) for value in pose_vector(T))
        return replace(self.sized(thing), position=(x, y, z), orientation=(w, i, j, k))


def against(
    room: Room, wall: str, obj: SceneObject, along_m: float, *, behind_m: float = BEHIND_M, turn_rad: float = 0.0
) -> str:
    """Place a piece of furniture with its back to a wall and return its id.

    A perturbed target is turned further; it stands so far from the wall that its corner has the gap.

    Args:
        wall: "east", "north", "west" or "south".
        obj: The piece, not yet placed.
        along_m: Position of its middle along the wall, from the wall's middle, positive to the left of who faces it.
        behind_m: Gap between its back and the wall.
        turn_rad: Its turn relative to the wall.

    Raises:
        NoRoom: It reaches beyond the wall's ends, or something is in its way.
    """
    yaw = WALLS[wall]
    length_m, distance_m = wall_length_m(room, wall), wall_distance_m(room, wall)
    turn_rad += room.turn_rad(obj.id)
    half_deep, half_long = _half_sides_m(obj, turn_rad)
    if abs(along_m) + half_long > length_m / 2 + _TOLERANCE_M:
        raise NoRoom(obj.id, f"reaches beyond the {wall} wall, which is {length_m:.2f} m long")
    x, y = rotation_z(yaw)[:2, :2] @ [distance_m - behind_m - half_deep, along_m]
    room.put(obj, float(x), float(y), 0.0, yaw + turn_rad)
    room.solid_walls.add(wall)
    return obj.id


def row(
    room: Room,
    wall: str,
    pieces: Sequence[SceneObject],
    along_m: float = 0.0,
    *,
    gaps_m: Sequence[float] = (),
) -> tuple[str, ...]:
    """Place pieces side by side along a wall, from the left of who faces it, and return their ids.

    A perturbed target takes up its turned length, so that its neighbours keep their distance.

    Args:
        wall: As for `against`.
        pieces: The pieces, not yet placed.
        gaps_m: Gaps between neighbours, one fewer than pieces; empty for a flush row.
    """
    between = list(gaps_m) or [0.0] * max(len(pieces) - 1, 0)
    if len(between) != max(len(pieces) - 1, 0):
        raise ValueError(f"{len(pieces)} pieces have {len(pieces) - 1} gaps between them, got {len(between)}")
    edge_m = along_m + row_length_m(room, pieces, between) / 2
    for piece, gap_m in zip(pieces, [*between, 0.0], strict=True):
        long_m = row_length_m(room, [piece])
        against(room, wall, piece, edge_m - long_m / 2)
        edge_m -= long_m + gap_m
    return tuple(piece.id for piece in pieces)


def row_length_m(room: Room, pieces: Sequence[SceneObject], gaps_m: Sequence[float] = ()) -> float:
    """Return the length of a row of pieces, each turned as it will stand in the room."""
    return sum(2 * _half_sides_m(piece, room.turn_rad(piece.id))[1] for piece in pieces) + sum(gaps_m)


def _half_sides_m(obj: SceneObject, turn_rad: float) -> tuple[float, float]:
    """Half lengths of a turned piece away from the wall and along it."""
    half_x, half_y = obj.extent_m[0] / 2, obj.extent_m[1] / 2
    s, c = abs(math.sin(turn_rad)), abs(math.cos(turn_rad))
    return s * half_y + c * half_x, s * half_x + c * half_y


def wall_length_m(room: Room, wall: str) -> float:
    """Return a wall's length."""
    return room.width_m if wall in ("east", "west") else room.depth_m


def wall_distance_m(room: Room, wall: str) -> float:
    """Return a wall's distance from the middle of the room."""
    return (room.depth_m if wall in ("east", "west") else room.width_m) / 2


def build_walls(room: Room) -> tuple[str, ...]:
    """Build the room's solid walls, those with furniture against them, and return their ids.

    The others stay open, so that an outside camera sees into the room. Call it last but for the robot.
    """
    built = []
    for wall, yaw in WALLS.items():
        if wall in room.solid_walls:
            # Walls meet in the corners: those along x are as long as the room and both walls at its ends.
            length_m = wall_length_m(room, wall) + (2 * WALL_M if wall in ("north", "south") else 0.0)
            x, y = rotation_z(yaw)[:2, :2] @ [wall_distance_m(room, wall) + WALL_M / 2, 0.0]
            slab = SceneObject(
                id=f"wall_{wall}",
                category="wall",
                model="wall",
                position=(0.0, 0.0, WALL_HEIGHTS_M[wall] / 2),
                orientation=(1.0, 0.0, 0.0, 0.0),
                bbox_extent=(WALL_M, length_m, WALL_HEIGHTS_M[wall]),
            )
            room.put(slab, float(x), float(y), 0.0, yaw)
            built.append(slab.id)
    return tuple(built)


def stand(room: Room, obj: SceneObject, x_m: float, y_m: float, *, yaw_rad: float = 0.0) -> str:
    """Place a free-standing piece of furniture on the floor and return its id.

    Raises:
        NoRoom: Something is in its way, or it reaches beyond the walls.
    """
    yaw_rad += room.turn_rad(obj.id)
    placed = replace(obj, position=(x_m, y_m, obj.extent_m[2] / 2))
    if not room.has_inside(replace(Footprint.of(placed), yaw_rad=yaw_rad), _TOLERANCE_M):
        raise NoRoom(obj.id, "reaches beyond the walls")
    room.put(obj, x_m, y_m, 0.0, yaw_rad)
    return obj.id
