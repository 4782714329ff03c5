"""Lay out a room: furniture along walls and free on the floor, things on and in it, walls, and the robot.

    rng = np.random.default_rng(7)
    room = Room("my_kitchen", "kitchen", rng, depth_m=3.4, width_m=3.6)
    fridge = room.draw("fridge_one_door", parameters={"hinge": "right"})          # a SceneObject, not yet placed
    left, right = room.draw("cabinet_drawers"), room.draw("counter_plain")
    row(room, "east", [left, fridge, right], along_m=0.2, gaps_m=[0.0, 0.03])     # fronts look into the room
    table = stand(room, room.draw("table_four_legs"), -0.6, -0.9, yaw_rad=0.0)    # free-standing; returns its id
    place(room, room.draw("tumbler"), table, at=AtEdge("+y", (0.08, 0.16)))       # on its top, near an edge
    place(room, room.draw("can"), fridge.id, region="door_shelf_1")               # inside, on a shelf
    scatter(room, ["can", "carton", "book_lying"], table, count=3)                # clutter, without overlap
    place(room, room.draw("microwave_side_hinge"), right.id, at=(0.0, 0.0), yaw_rad=0.0)  # on the counter
    build_walls(room)                                                             # solid; only those in use
    stand_robot(room)                                                             # free floor, faces the room
    scene = room.scene()                                                          # facts and `closed` included

`executor.scenes.room` has `Room` and `Units`; `Units` draws cabinets, counters and cookers of one height and depth, so
that a row has one worktop.

Everything is drawn from the room's generator: equal generators and equal calls give equal scenes. A thing that does not
fit raises `NoRoom`, which names the thing and the obstacle. `executor.scenes.validation.settle` then runs physics.

Frames: walls are "east" (+x), "north" (+y), "west" and "south" of a rectangle around the origin. A position along a
wall is measured from the wall's middle, positive to the left as seen by somebody who faces the wall.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np

from executor.assets.footprint import EDGES, Footprint, gaps_m, region_frame, yaw_of
from executor.assets.library import asset_for
from executor.assets.model import Region
from executor.geometry import Array, rotation_z
from executor.scenes.room import NoRoom, Room
from oag import RobotPose, SceneObject

WALLS: Mapping[str, float] = MappingProxyType(
    {"east": 0.0, "north": math.pi / 2, "west": math.pi, "south": -math.pi / 2}
)
"""The walls, and the heading of somebody who faces each; furniture against one has this yaw."""

BEHIND_M = 0.01
WALL_M = 0.08
WALL_HEIGHTS_M: Mapping[str, float] = MappingProxyType({"east": 2.0, "north": 2.0, "west": 1.0, "south": 1.0})
"""Two walls are breast-high: the sun of the pictures stands there, and cameras look in over them."""

WALKWAY_M = 0.10
"""Least distance from the robot, arm at home, to its surroundings."""

# The robot from above with its arm at home: the base reaches 0.24 m behind and beside its axis, the hand 0.45 m ahead.
_BEHIND_M, _AHEAD_M, _BESIDE_M = 0.26, 0.46, 0.26
_TOP_M = 1.5  # Objects that begin higher are above the robot.
_ROBOT_TRIES = 400
_TOLERANCE_M = 1e-6  # Rounding.


def against(
    room: Room, wall: str, obj: SceneObject, along_m: float, *, behind_m: float = BEHIND_M, turn_rad: float = 0.0
) -> str:
    """Place a piece of furniture with its back to a wall and return its id.

    A perturbed target is turned further; it stands so far from the wall that its corner has the gap.

    Args:
        room: The room.
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
        room: The room.
        wall: As for `against`.
        pieces: The pieces, not yet placed.
        along_m: Position of the row's middle.
        gaps_m: Gaps between neighbours, one fewer than pieces; empty for a flush row.

    Raises:
        NoRoom: A piece does not fit.
        ValueError: The number of gaps is not one fewer than that of the pieces.
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


def stand_robot(room: Room, *, facing_m: tuple[float, float] = (0.0, 0.0), spread_rad: float = 0.8) -> None:
    """Place the robot on free floor, arm at home, facing the room.

    Args:
        room: The room, furnished.
        facing_m: (x, y) that it faces; the middle of the room by default.
        spread_rad: Largest deviation of its heading from that, to either side.

    Raises:
        NoRoom: There is no free floor that large.
    """
    taken = {name: Footprint.of(obj) for name, obj in room.objects.items()}
    rng, half_x, half_y = room.rng, room.depth_m / 2 - _BEHIND_M, room.width_m / 2 - _BESIDE_M
    look_x, look_y = facing_m
    for _ in range(_ROBOT_TRIES):
        x, y = float(rng.uniform(-half_x, half_x)), float(rng.uniform(-half_y, half_y))
        away = math.hypot(look_x - x, look_y - y)
        heading = math.atan2(look_y - y, look_x - x) if away > 0.3 else rng.uniform(-math.pi, math.pi)
        yaw = float(heading + rng.uniform(-spread_rad, spread_rad))
        if room.has_inside(robot_footprint(x, y, yaw)) and robot_has_room(x, y, yaw, taken):
            room.robot = RobotPose((x, y, 0.0), math.remainder(yaw, 2 * math.pi))
            return
    raise NoRoom("robot", f"there is no free floor for it in {room.name}")


def robot_footprint(x_m: float, y_m: float, yaw_rad: float) -> Footprint:
    """Return the robot's footprint with its arm at home."""
    ahead = (_AHEAD_M - _BEHIND_M) / 2
    return Footprint(
        x_m + ahead * math.cos(yaw_rad),
        y_m + ahead * math.sin(yaw_rad),
        yaw_rad,
        (_AHEAD_M + _BEHIND_M) / 2,
        _BESIDE_M,
        high_m=_TOP_M,
    )


def robot_has_room(x_m: float, y_m: float, yaw_rad: float, others: Mapping[str, Footprint]) -> bool:
    """Return whether the robot can stand at a pose, arm at home, with a walkway between it and everything else."""
    return all(gap_m >= WALKWAY_M for _, gap_m in gaps_m(robot_footprint(x_m, y_m, yaw_rad), others))


Range = tuple[float, float]
EDGE_M = 0.02
CLEAR_M = 0.03
HEADROOM_M = 0.02
_PLACE_TRIES = 300


@dataclass(frozen=True, slots=True)
class AtEdge:
    """A place along an edge of a top or a shelf.

    Attributes:
        side: "-x" (the front), "+x", "+y" or "-y", in the support's own frame.
        inset_m: Range of the distance from that edge to the thing's centre.
        along_m: Range along that edge from its middle; the whole edge by default.
    """

    side: str
    inset_m: Range = (0.08, 0.16)
    along_m: Range | None = None


@dataclass(frozen=True, slots=True)
class NextTo:
    """A place next to another thing, with a gap from a range."""

    object_id: str
    gap_m: Range = (0.05, 0.15)


@dataclass(frozen=True, slots=True)
class Clearance:
    """Least distances of a placed thing: to the edges of the region, and to everything else."""

    edge_m: float = EDGE_M
    other_m: float = CLEAR_M


AMPLE = Clearance()


def place(
    room: Room,
    obj: SceneObject,
    support: str,
    *,
    region: str | None = None,
    at: tuple[float, float] | AtEdge | None = None,
    next_to: NextTo | None = None,
    yaw_rad: float | None = None,
    clear: Clearance = AMPLE,
) -> str:
    """Put a thing on or in another, at a place drawn from the given constraints, and return its id.

    Args:
        room: The room.
        obj: The thing, not yet placed.
        support: Id of the object to put it on or in.
        region: Name of the support's region; by default its top, else the first one that is high enough.
        at: Its centre in the region, from the region's middle, along the support's own x and y; or a place along an
            edge; anywhere by default.
        next_to: Its neighbour.
        yaw_rad: Its turn in the support's own frame; any by default.
        clear: Least distances to edges and to everything else.

    Raises:
        NoRoom: No free place was found; the message names the support.
    """
    if obj.id in room.objects:
        raise NoRoom(obj.id, "the room has a thing of this id already")
    space = _region(room, obj, support, region)
    T_region, half = region_frame(room.objects[support], space)
    room.relate("inside" if space.kind == "interior" else "ontop", obj.id, support)
    problem = "found no free place on {}"
    for _ in range(1 if isinstance(at, tuple) and yaw_rad is not None else _PLACE_TRIES):
        yaw = float(room.rng.uniform(-math.pi, math.pi)) if yaw_rad is None else yaw_rad
        yaw += room.turn_rad(obj.id)
        reach = np.abs(rotation_z(yaw)[:2, :2]) @ [obj.extent_m[0] / 2, obj.extent_m[1] / 2]
        free = half - reach - clear.edge_m
        local = np.array(at if isinstance(at, tuple) else _somewhere(room, half, free, at))
        if (np.abs(local) > free + 1e-9).any():
            over_m = float((np.abs(local) - free).max())
            if (half < reach).any():
                problem = f"is too large for {{}}: {_cm(2 * reach)} on {_cm(2 * half)}"
            else:
                problem = f"would be {100 * over_m:.1f} cm too near to the edge of {{}}, or over it"
            continue
        mine = _standing(obj, T_region, local, yaw_of(room.objects[support]) + yaw)
        blocker = room.blocker(obj.id, mine, clear.other_m)
        if blocker is not None:
            problem = f"found no free place on {{}}; {blocker} is in the way"
            continue
        if next_to is not None:
            low, high = next_to.gap_m
            if not low <= mine.gap_m(Footprint.of(room.objects[next_to.object_id])) <= high:
                problem = f"found no free place on {{}} {low:.2f} to {high:.2f} m from {next_to.object_id}"
                continue
        room.put(obj, mine.x_m, mine.y_m, mine.low_m, mine.yaw_rad)
        return obj.id
    room.forget(obj.id)
    raise NoRoom(obj.id, problem.format(f"{support} ({space.name})"))


def scatter(
    room: Room,
    models: Sequence[str],
    support: str,
    count: int,
    *,
    region: str | None = None,
    next_to: NextTo | None = None,
    clear: Clearance = AMPLE,
) -> tuple[str, ...]:
    """Put up to `count` different things on a support and return their ids.

    Things without a free place are left out, since clutter needs none in particular.

    Args:
        room: The room.
        models: Models to choose from; each is taken at most once.
        support: Id of the object to put them on or in.
        count: Largest number of things.
        region, next_to, clear: As for `place`.
    """
    chosen = [str(model) for model in room.rng.permutation(list(models))[:count]]
    found = []
    for model in chosen:
        obj = room.draw(model)
        try:
            found.append(place(room, obj, support, region=region, next_to=next_to, clear=clear))
        except NoRoom:
            continue
    return tuple(found)


def _region(room: Room, obj: SceneObject, support: str, name: str | None) -> Region:
    """Return the named region, or the default one for the thing."""
    regions = asset_for(room.objects[support]).regions
    if name is not None:
        named = [space for space in regions if space.name == name]
        if not named:
            known = ", ".join(space.name for space in regions) or "none"
            raise NoRoom(obj.id, f"{support} has no place {name!r}; it has {known}")
        return named[0]
    high = [space for space in regions if space.height_m >= obj.extent_m[2] + HEADROOM_M]
    tops = [space for space in high if space.kind == "surface" and space.name == "top"]
    if not high:
        raise NoRoom(obj.id, f"no place of {support} is high enough for {obj.extent_m[2]:.2f} m")
    return (tops or high)[0]


def _cm(sides_m: Array) -> str:
    return " x ".join(f"{100 * side:.0f}" for side in sides_m) + " cm"


def _somewhere(room: Room, half: Array, free: Array, edge: AtEdge | None) -> tuple[float, float]:
    """Draw a place in a region: anywhere, or near one of its edges."""
    rng = room.rng
    if edge is None:
        wide = np.maximum(free, 0.0)
        return float(rng.uniform(-wide[0], wide[0])), float(rng.uniform(-wide[1], wide[1]))
    axis, sign = EDGES[edge.side]
    span = max(float(free[1 - axis]), 0.0)
    low, high = edge.along_m or (-span, span)
    local = [0.0, 0.0]
    local[axis] = sign * float(half[axis] - rng.uniform(*edge.inset_m))
    local[1 - axis] = float(rng.uniform(low, high))
    return local[0], local[1]


def _standing(obj: SceneObject, T_region: Array, local: Array, yaw_rad: float) -> Footprint:
    """Return the thing's footprint at a place of a region."""
    x, y, _, _ = T_region @ [local[0], local[1], 0.0, 1.0]
    length, width, height = obj.extent_m
    low = float(T_region[2, 3])
    return Footprint(float(x), float(y), yaw_rad, length / 2, width / 2, low, low + height)
