"""What stands on the floor: furniture along walls, its front into the room, or free; the walls; and the robot."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType

from executor.assets.footprint import Footprint, gaps_m
from executor.geometry import rotation_z
from executor.scenes.rooms.room import NoRoom, Room
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
"""From the robot, its arm at home, to whatever stands around it."""

# The robot from above with its arm at home: the base reaches 0.24 m behind and beside its axis, the hand 0.45 m ahead.
_BEHIND_M, _AHEAD_M, _BESIDE_M = 0.26, 0.46, 0.26
_TOP_M = 1.5  # What begins higher is above the robot.
_TRIES = 400
_TOLERANCE_M = 1e-6  # Rounding.


def against(
    room: Room, wall: str, obj: SceneObject, along_m: float, *, behind_m: float = BEHIND_M, turn_rad: float = 0.0
) -> str:
    """Stands a piece of furniture with its back to a wall and returns its id.

    A target that strays is turned further; it stands so far from the wall that its corner has the gap.

    Args:
        room: The room.
        wall: "east", "north", "west" or "south".
        obj: The piece, not yet placed.
        along_m: Where its middle is along the wall, from the wall's middle, positive to the left of who faces it.
        behind_m: Gap between its back and the wall.
        turn_rad: How far it stands askew.

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
    """Stands pieces side by side along a wall, from the left of who faces it, and returns their ids.

    A target that strays takes up what it needs turned, so that its neighbours stand apart from it.

    Args:
        room: The room.
        wall: As for `against`.
        pieces: The pieces, not yet placed.
        along_m: Where the middle of the whole row is.
        gaps_m: Gaps between neighbours, one fewer than pieces; none of them given means that all stand flush.

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
    """Returns how long a row of pieces is, each turned as it will stand in the room."""
    return sum(2 * _half_sides_m(piece, room.turn_rad(piece.id))[1] for piece in pieces) + sum(gaps_m)


def _half_sides_m(obj: SceneObject, turn_rad: float) -> tuple[float, float]:
    """Half of what a piece takes up away from the wall and along it, standing askew."""
    half_x, half_y = obj.extent_m[0] / 2, obj.extent_m[1] / 2
    s, c = abs(math.sin(turn_rad)), abs(math.cos(turn_rad))
    return s * half_y + c * half_x, s * half_x + c * half_y


def wall_length_m(room: Room, wall: str) -> float:
    """Returns a wall's length."""
    return room.width_m if wall in ("east", "west") else room.depth_m


def wall_distance_m(room: Room, wall: str) -> float:
    """Returns a wall's distance from the middle of the room."""
    return (room.depth_m if wall in ("east", "west") else room.width_m) / 2


def build_walls(room: Room) -> tuple[str, ...]:
    """Builds the room's solid walls, those that furniture was stood against, and returns their ids.

    The others stay open, so that a camera outside sees into the room. Call it last but for the robot.
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
    """Stands a piece of furniture free on the floor and returns its id.

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
    """Stands the robot somewhere on free floor, arm at home, facing the room.

    Args:
        room: The room, furnished.
        facing_m: (x, y) that it looks towards; the middle of the room by default.
        spread_rad: How far its heading may differ from that, to either side.

    Raises:
        NoRoom: There is no free floor that large.
    """
    taken = {name: Footprint.of(obj) for name, obj in room.objects.items()}
    rng, half_x, half_y = room.rng, room.depth_m / 2 - _BEHIND_M, room.width_m / 2 - _BESIDE_M
    look_x, look_y = facing_m
    for _ in range(_TRIES):
        x, y = float(rng.uniform(-half_x, half_x)), float(rng.uniform(-half_y, half_y))
        away = math.hypot(look_x - x, look_y - y)
        heading = math.atan2(look_y - y, look_x - x) if away > 0.3 else rng.uniform(-math.pi, math.pi)
        yaw = float(heading + rng.uniform(-spread_rad, spread_rad))
        if room.has_inside(robot_footprint(x, y, yaw)) and robot_has_room(x, y, yaw, taken):
            room.robot = RobotPose((x, y, 0.0), math.remainder(yaw, 2 * math.pi))
            return
    raise NoRoom("robot", f"there is no free floor for it in {room.name}")


def robot_footprint(x_m: float, y_m: float, yaw_rad: float) -> Footprint:
    """Returns the rectangle that the robot takes up with its arm at home."""
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
    """Decides whether the robot can stand somewhere, its arm at home, with a walkway between it and everything else."""
    return all(gap_m >= WALKWAY_M for _, gap_m in gaps_m(robot_footprint(x_m, y_m, yaw_rad), others))
