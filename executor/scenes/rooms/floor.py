"""What stands free on the floor: tables, and the robot at its start."""

from __future__ import annotations

import math
from dataclasses import replace

from executor.scenes.rooms.footprint import Footprint
from executor.scenes.rooms.room import NoRoom, Room
from oag import RobotPose, SceneObject

WALKWAY_M = 0.10
"""From the robot, its arm at home, to whatever stands around it."""

# The robot from above with its arm at home: the base reaches 0.24 m behind and beside its axis, the hand 0.45 m ahead.
_BEHIND_M, _AHEAD_M, _BESIDE_M = 0.26, 0.46, 0.26
_TRIES = 400


def stand(room: Room, obj: SceneObject, x_m: float, y_m: float, *, yaw_rad: float = 0.0) -> str:
    """Stands a piece of furniture free on the floor and returns its id.

    Raises:
        NoRoom: Something is in its way, or it reaches beyond the walls.
    """
    placed = replace(obj, position=(x_m, y_m, obj.extent_m[2] / 2))
    half = room.depth_m / 2, room.width_m / 2
    turned = replace(Footprint.of(placed), yaw_rad=yaw_rad)
    if (abs(turned.corners_m) > [half[0] + 1e-6, half[1] + 1e-6]).any():
        raise NoRoom(obj.id, "reaches beyond the walls")
    room.put(obj, x_m, y_m, 0.0, yaw_rad)
    return obj.id


def stand_robot(
    room: Room,
    *,
    near_m: tuple[float, float] | None = None,
    radius_m: float = 0.6,
    facing_m: tuple[float, float] | None = None,
    spread_rad: float = 0.8,
) -> None:
    """Stands the robot somewhere on free floor, arm at home, facing the room.

    Args:
        room: The room, furnished.
        near_m: (x, y) around which it starts; anywhere by default.
        radius_m: How far from there at most.
        facing_m: (x, y) that it looks towards; the middle of the room by default.
        spread_rad: How far its heading may differ from that, to either side.

    Raises:
        NoRoom: There is no free floor that large.
    """
    rng, half_x, half_y = room.rng, room.depth_m / 2 - _BEHIND_M, room.width_m / 2 - _BESIDE_M
    taken = [Footprint.of(obj) for obj in room.objects.values()]
    look_x, look_y = facing_m or (0.0, 0.0)
    for _ in range(_TRIES):
        if near_m is None:
            x, y = rng.uniform(-half_x, half_x), rng.uniform(-half_y, half_y)
        else:
            angle, distance = rng.uniform(0.0, 2 * math.pi), radius_m * math.sqrt(rng.uniform())
            x, y = near_m[0] + distance * math.cos(angle), near_m[1] + distance * math.sin(angle)
        away = math.hypot(look_x - x, look_y - y)
        heading = math.atan2(look_y - y, look_x - x) if away > 0.3 else rng.uniform(-math.pi, math.pi)
        yaw = heading + rng.uniform(-spread_rad, spread_rad)
        body = robot_footprint(float(x), float(y), float(yaw))
        inside = (abs(body.corners_m) <= [room.depth_m / 2, room.width_m / 2]).all()
        if inside and all(body.gap_m(other) >= WALKWAY_M for other in taken):
            room.robot = RobotPose((float(x), float(y), 0.0), math.remainder(float(yaw), 2 * math.pi))
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
    )
