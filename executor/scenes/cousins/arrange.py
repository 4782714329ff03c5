"""Things where a reconstruction has them: on the floor or on each other, free of overlaps, and a place for the robot.

Heights come from what a thing stands on, since the models are not the meshes. Where models overlap, the later one gives
way by centimetres, as Digital Cousins itself does with its meshes.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from executor.assets.footprint import Footprint, deepest_m, region_frame, solid_parts
from executor.assets.library import asset_for
from executor.geometry import Array, rotation_z
from executor.scenes.cousins.likeness import Upright
from executor.scenes.rooms.furniture import robot_has_room
from executor.scenes.rooms.room import NoRoom
from executor.scenes.rooms.tops import EDGE_M
from oag import Kind, RobotPose, SceneObject

MOST_MOVED_M = 0.30
"""How far a thing gives way, comes down or is lifted before it is refused."""

STANDS_M = 0.10
"""By position, what is no farther than this from a top stands on it."""

NOTED_M = 0.03
"""Reconstructed heights are off by centimetres; a note names what is moved up or down by more."""

_RING_M, _DIRECTIONS = 0.02, 16
_TOUCH_M = 5e-4
_ROBOT_RING_M, _ROBOT_RINGS = 0.10, 60  # Up to 6 m from the camera.


@dataclass(frozen=True, slots=True)
class Spot:
    """Something to stand on.

    Attributes:
        support: Id of what has it; None for the floor.
        height_m: Of the ground there.
        ground: Its outline, within which things are put.
        around: The outline of the whole support, or of the hollow of a small thing: what is over it stands on it.
        is_hollow: Whether things there are inside the support.
    """

    support: str | None
    height_m: float
    ground: Footprint
    around: Footprint
    is_hollow: bool = False

    @property
    def name(self) -> str:
        """What it is called in sentences."""
        return self.support or "the floor"


_EVERYWHERE = Footprint(0.0, 0.0, 0.0, math.inf, math.inf)
FLOOR_SPOT = Spot(None, 0.0, _EVERYWHERE, _EVERYWHERE)


def _reach(obj: SceneObject, turn_rad: float) -> Array:
    """Half the sides (2,) of the box around an object along the axes of what it stands on."""
    half = np.asarray(obj.extent_m[:2]) / 2
    around: Array = np.abs(rotation_z(turn_rad)[:2, :2]) @ half
    return around


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

    def place(self, obj: SceneObject, at: Upright, spot: Spot) -> None:
        """Puts a thing on or in another one, or on the floor, within the edges of that.

        Raises:
            NoRoom: There is no such place, or something is in its way; `put` does so too.
        """
        raised_m = spot.height_m - at.bottom_m
        if abs(raised_m) > MOST_MOVED_M:
            side = "above" if raised_m < 0.0 else "below"
            raise NoRoom(obj.id, f"is {abs(raised_m):.2f} m {side} {spot.name}, the nearest that it could stand on")
        if spot.support is None:
            self.put(obj, at, spot.height_m)
        else:
            half = np.asarray((spot.ground.half_x_m, spot.ground.half_y_m))
            R = rotation_z(spot.ground.yaw_rad)[:2, :2]
            middle = np.asarray((spot.ground.x_m, spot.ground.y_m))
            reach = _reach(obj, at.yaw_rad - spot.ground.yaw_rad)
            free = np.maximum(half - reach - EDGE_M, 0.0)
            local = R.T @ (np.asarray(at.centre_m[:2]) - middle)
            inside = np.clip(local, -free, free)
            x, y = R @ inside + middle
            shifted_m = float(np.linalg.norm(inside - local))
            if shifted_m > MOST_MOVED_M:
                raise NoRoom(obj.id, f"stands on {spot.support}, but {shifted_m:.2f} m from where it could")
            self.put(
                obj, replace(at, centre_m=(float(x), float(y), at.centre_m[2])), spot.height_m, held_by=spot.support
            )
            self.relations.append(("inside" if spot.is_hollow else "ontop", obj.id, spot.support))
            if shifted_m > _RING_M:
                self.notes.append(f"{obj.id} was moved by {100 * shifted_m:.0f} cm to be on {spot.support}")
        if abs(raised_m) > NOTED_M:
            how = "lifted" if raised_m > 0.0 else "let down"
            self.notes.append(f"{obj.id} was {how} by {100 * abs(raised_m):.0f} cm onto {spot.name}")

    def spot_on(self, obj: SceneObject, at: Upright, support: str) -> Spot:
        """Returns the top or board of another thing that is nearest to a thing's height.

        Raises:
            NoRoom: There is none that it fits on.
        """
        spots = list(self._spots(obj, at, support))
        if not spots:
            raise NoRoom(obj.id, f"stands on {support}, which has no open place for it")
        return min(spots, key=lambda spot: abs(spot.height_m - at.bottom_m))

    def spot_below(self, obj: SceneObject, at: Upright) -> Spot:
        """Returns what a thing stands on by its position: the nearest top, board, hollow or floor under its extent.

        What has the thing's middle over it comes before what merely touches its extent, and small things, such as a
        plate, before the furniture that they stand on.

        Raises:
            NoRoom: It is in another thing's box, and on no board of that.
        """
        mine = Footprint(*at.centre_m[:2], at.yaw_rad, at.size_m[0] / 2, at.size_m[1] / 2)
        middle = Footprint(*at.centre_m[:2], 0.0, 0.0, 0.0)
        under = [FLOOR_SPOT]
        for other in self.objects.values():
            if obj.kind is Kind.ITEM or other.kind is not Kind.ITEM:
                under += [spot for spot in self._spots(obj, at, other.id) if mine.gap_m(spot.around) < 0.0]

        def distance_m(spot: Spot) -> float:
            return abs(spot.height_m - at.bottom_m)

        def rank(spot: Spot) -> tuple[bool, bool, float]:
            over = spot.support is not None and middle.gap_m(spot.around) <= 0.0
            on_item = over and self.objects[spot.support or ""].kind is Kind.ITEM
            return not over, not on_item, distance_m(spot)

        near = [spot for spot in under if distance_m(spot) < STANDS_M]
        if near:
            return min(near, key=rank)
        # What floats comes down, what is sunk in a top comes up; what is wholly below a top is not on it.
        top_m = at.bottom_m + at.size_m[2]
        found = min((spot for spot in under if spot.height_m < top_m), key=distance_m, default=FLOOR_SPOT)
        for other in self.objects.values():
            box = Footprint.of(other)
            within = middle.gap_m(box) <= 0.0 and box.low_m < at.centre_m[2] < box.high_m
            if within and found.support != other.id and other.kind is not Kind.ITEM:
                where = f"{distance_m(found):.2f} m from {found.name}"
                raise NoRoom(obj.id, f"is in the box of {other.id} and stands on nothing there; it is {where}")
        return found

    def _spots(self, obj: SceneObject, at: Upright, support: str) -> Iterator[Spot]:
        """Yields the open places of another thing that a thing fits in."""
        carrier = self.objects[support]
        for region in asset_for(carrier).regions:
            # What is in a bowl may stand out of it.
            fits = region.name == "top" or carrier.kind is Kind.ITEM or region.height_m >= obj.extent_m[2]
            if region.joint is not None or not fits:
                continue
            T, half = region_frame(carrier, region)
            yaw_rad = math.atan2(T[1, 0], T[0, 0])
            if carrier.kind is Kind.ITEM and (_reach(obj, at.yaw_rad - yaw_rad) > half).any():
                continue
            x, y, z = (float(value) for value in T[:3, 3])
            ground = Footprint(x, y, yaw_rad, float(half[0]), float(half[1]))
            around = ground if carrier.kind is Kind.ITEM else Footprint.of(carrier)
            yield Spot(support, z, ground, around, is_hollow=region.kind == "interior")

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
