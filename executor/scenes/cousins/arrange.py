"""Things where a reconstruction has them: on the floor or on each other, free of overlaps, and a place for the robot.

Heights come from what a thing stands on, since the models are not the meshes. Where models overlap, the later one gives
way by centimetres, as Digital Cousins itself does with its meshes.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from executor.assets.footprint import Footprint, deepest_m, region_frame, solid_parts
from executor.assets.library import asset_for
from executor.geometry import rotation_z
from executor.scenes.cousins.likeness import Upright
from executor.scenes.rooms.furniture import robot_has_room
from executor.scenes.rooms.room import NoRoom
from executor.scenes.rooms.tops import EDGE_M
from oag import RobotPose, SceneObject

MOST_MOVED_M = 0.30
"""How far a thing gives way before it is refused."""

_RING_M, _DIRECTIONS = 0.02, 16
_TOUCH_M = 5e-4
_ROBOT_RING_M, _ROBOT_RINGS = 0.10, 60  # Up to 6 m from the camera.


class Arrangement:
    """What stands where so far.

    Attributes:
        objects: id -> object, in the order in which they were put.
        relations: (relation, thing, support) of everything that stands on or in another thing.
        notes: What was moved, in sentences.
    """

    def __init__(self) -> None:
        self.objects: dict[str, SceneObject] = {}
        self.relations: list[tuple[str, str, str]] = []
        self.notes: list[str] = []
        self._parts: dict[str, list[Footprint]] = {}

    def put(self, obj: SceneObject, at: Upright, low_m: float, *, held_by: str | None = None) -> None:
        """Puts a thing where the reconstruction has it, or up to 30 cm beside that.

        Args:
            obj: The thing, not yet placed.
            at: Where it is.
            low_m: Height of its bottom: of the floor, or where it hangs.
            held_by: Id of what it stands on or in.

        Raises:
            NoRoom: Something is in its way everywhere.
        """
        at_m, yaw_rad = at.centre_m[:2], at.yaw_rad
        quaternion = (math.cos(yaw_rad / 2), 0.0, 0.0, math.sin(yaw_rad / 2))
        placed = replace(obj, position=(*at_m, low_m + obj.extent_m[2] / 2), orientation=quaternion)
        parts = solid_parts(placed)
        blocker = ""
        for x, y in _around(at_m, _RING_M, round(MOST_MOVED_M / _RING_M)):
            dx, dy = x - at_m[0], y - at_m[1]
            moved = [replace(part, x_m=part.x_m + dx, y_m=part.y_m + dy) for part in parts]
            if held_by is not None and not self._carried(held_by, x, y):
                continue
            found = self._blocker(moved, held_by)
            if found is None:
                self.objects[obj.id] = replace(placed, position=(x, y, placed.position[2]))
                self._parts[obj.id] = moved
                if blocker:
                    self.notes.append(f"{obj.id} was moved by {100 * math.hypot(dx, dy):.0f} cm, out of {blocker}")
                return
            blocker = blocker or found
        raise NoRoom(obj.id, f"overlaps {blocker}, with no free place within {MOST_MOVED_M:.1f} m")

    def place(self, obj: SceneObject, at: Upright, support: str) -> None:
        """Puts a thing on or in another one: on the top or board that is nearest to its height, within its edges.

        Raises:
            NoRoom: There is no such place, or something is in its way; `put` does so too.
        """
        carrier = self.objects[support]
        bottom_m = at.centre_m[2] - at.size_m[2] / 2
        places = [
            (region, *region_frame(carrier, region))
            for region in asset_for(carrier).regions
            if region.joint is None and (region.name == "top" or region.height_m >= obj.extent_m[2])
        ]
        if not places:
            raise NoRoom(obj.id, f"stands on {support}, which has no open place for it")
        region, T, half = min(places, key=lambda place: abs(float(place[1][2, 3]) - bottom_m))
        turn = rotation_z(at.yaw_rad)[:2, :2].T @ T[:2, :2]
        reach = np.abs(turn.T) @ [obj.extent_m[0] / 2, obj.extent_m[1] / 2]
        free = np.maximum(half - reach - EDGE_M, 0.0)
        local = T[:2, :2].T @ (np.asarray(at.centre_m[:2]) - T[:2, 3])
        inside = np.clip(local, -free, free)
        x, y = T[:2, :2] @ inside + T[:2, 3]
        shifted_m = float(np.linalg.norm(inside - local))
        if shifted_m > MOST_MOVED_M:
            raise NoRoom(obj.id, f"stands on {support}, but {shifted_m:.2f} m from where it could")
        self.relations.append(("inside" if region.kind == "interior" else "ontop", obj.id, support))
        self.put(obj, replace(at, centre_m=(float(x), float(y), bottom_m)), float(T[2, 3]), held_by=support)
        if shifted_m > _RING_M:
            self.notes.append(f"{obj.id} was moved by {100 * shifted_m:.0f} cm to be on {support}")

    def robot(self, camera_m: tuple[float, float]) -> RobotPose:
        """Returns a pose of the robot on the free floor that is nearest to the camera, facing the things.

        Raises:
            NoRoom: There is none within 6 m.
        """
        middle = np.mean([obj.position[:2] for obj in self.objects.values()], axis=0)
        taken = {name: Footprint.of(obj) for name, obj in self.objects.items()}
        for x, y in _around(camera_m, _ROBOT_RING_M, _ROBOT_RINGS):
            yaw = math.atan2(middle[1] - y, middle[0] - x)
            if robot_has_room(x, y, yaw, taken):
                return RobotPose((x, y, 0.0), yaw)
        raise NoRoom(
            "robot", f"there is no free floor for it within {_ROBOT_RING_M * _ROBOT_RINGS:.0f} m of the camera"
        )

    def _carried(self, support: str, x_m: float, y_m: float) -> bool:
        """Whether a thing whose middle is there would stand on its support."""
        return Footprint(x_m, y_m, 0.0, 0.0, 0.0).gap_m(Footprint.of(self.objects[support])) <= -EDGE_M

    def _blocker(self, parts: list[Footprint], held_by: str | None) -> str | None:
        for other, theirs in self._parts.items():
            if other != held_by and deepest_m(parts, theirs) > _TOUCH_M:
                return other
        return None


def _around(middle_m: tuple[float, float], ring_m: float, rings: int) -> Iterator[tuple[float, float]]:
    """Yields a point, then points on growing rings around it."""
    x, y = float(middle_m[0]), float(middle_m[1])
    yield x, y
    for ring in range(1, rings + 1):
        for turn in range(_DIRECTIONS):
            angle = 2.0 * math.pi * turn / _DIRECTIONS
            yield x + ring * ring_m * math.cos(angle), y + ring * ring_m * math.sin(angle)
