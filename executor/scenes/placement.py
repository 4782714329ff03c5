"""Find free places: for things on and in furniture, for things near a given pose, and for the robot on the floor.

    place(room, room.draw("tumbler"), PlaceSpec(table, at=AtEdge("+y", (0.08, 0.16))))   # on its top, near an edge
    place(room, room.draw("can"), PlaceSpec(fridge.id, region="door_shelf_1"))           # inside, on a shelf
    scatter(room, ["can", "carton", "book_lying"], PlaceSpec(table), count=3)            # clutter, without overlap
    place(room, microwave, PlaceSpec(right.id, at=(0.0, 0.0), yaw_rad=0.0))              # on the counter
    stand_robot(room)                                                                    # free floor, faces the room

Every search examines candidates in turn, by `first_free`; random ones are drawn from the room's generator.
`executor.planning.placements` searches release spots for the hand instead: a fixed grid of spots with their headings,
ranked for the arm, of which the planner tries many.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from executor.assets.footprint import EDGES, Footprint, gaps_m, overlap_depth_m, region_frame, solid_parts, yaw_of
from executor.assets.library import asset_for
from executor.assets.model import Region
from executor.geometry import Array, rotation_z
from executor.scenes.room import NoRoom, Room
from oag import SceneObject
from oag.model.scene import RobotPose
from oag.model.symbols import Kind

_Candidate = TypeVar("_Candidate")


def first_free(
    object_id: str, candidates: Iterable[_Candidate], objection: Callable[[_Candidate], str | None]
) -> _Candidate:
    """Return the first candidate without an objection.

    Candidates are taken one at a time: a search draws no more random numbers than it examines places.

    Raises:
        NoRoom: There is none; the message has the last objection.
    """
    problem: str | None = "found no free place"
    for candidate in candidates:
        problem = objection(candidate)
        if problem is None:
            return candidate
    raise NoRoom(object_id, problem or "")


WALKWAY_M = 0.10
"""Least distance from the robot, arm at home, to its surroundings."""

# The robot from above with its arm at home: the base reaches 0.24 m behind and beside its axis, the hand 0.45 m ahead.
_BEHIND_M, _AHEAD_M, _LATERAL_M = 0.26, 0.46, 0.26
_TOP_M = 1.5  # Objects that begin higher are above the robot.
_ROBOT_TRIES = 400


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


@dataclass(frozen=True, slots=True)
class PlaceSpec:
    """What is asked of a place on or in another thing.

    Attributes:
        support: Id of the object to put a thing on or in.
        region: Name of the support's region; by default its top, else the first one that is high enough.
        at: The thing's centre in the region, from the region's middle, along the support's own x and y; or a place
            along an edge; anywhere by default.
        next_to: Its neighbour.
        yaw_rad: Its turn in the support's own frame; any by default.
        clear: Least distances to edges and to everything else.
    """

    support: str
    region: str | None = None
    at: tuple[float, float] | AtEdge | None = None
    next_to: NextTo | None = None
    yaw_rad: float | None = None
    clear: Clearance = AMPLE


@dataclass(frozen=True, slots=True)
class _Spot:
    """A candidate: the thing's centre in the region, half its sides and those free for its centre, its footprint."""

    local: Array
    reach: Array
    free: Array
    footprint: Footprint


def place(room: Room, obj: SceneObject, asked: PlaceSpec) -> str:
    """Put a thing, not yet placed, on or in another, at a place drawn from the constraints, and return its id.

    Raises:
        NoRoom: No free place was found; the message names the support.
    """
    if obj.id in room.objects:
        raise NoRoom(obj.id, "the room has a thing of this id already")
    support, space = room.objects[asked.support], _region(room, obj, asked)
    T_region, half = region_frame(support, space)
    where = f"{support.id} ({space.name})"
    room.relate("inside" if space.kind == "interior" else "ontop", obj.id, support.id)

    def drawn() -> Iterator[_Spot]:
        for _ in range(1 if isinstance(asked.at, tuple) and asked.yaw_rad is not None else _PLACE_TRIES):
            yaw = float(room.rng.uniform(-math.pi, math.pi)) if asked.yaw_rad is None else asked.yaw_rad
            yaw += room.turn_rad(obj.id)
            reach = np.abs(rotation_z(yaw)[:2, :2]) @ [obj.extent_m[0] / 2, obj.extent_m[1] / 2]
            free = half - reach - asked.clear.edge_m
            local = np.array(asked.at if isinstance(asked.at, tuple) else _somewhere(room, half, free, asked.at))
            yield _Spot(local, reach, free, _standing(obj, T_region, local, yaw_of(support) + yaw))

    def objection(spot: _Spot) -> str | None:
        if (np.abs(spot.local) > spot.free + 1e-9).any():
            if (half < spot.reach).any():
                return f"is too large for {where}: {_cm(2 * spot.reach)} on {_cm(2 * half)}"
            over_m = float((np.abs(spot.local) - spot.free).max())
            return f"would be {100 * over_m:.1f} cm too near to the edge of {where}, or over it"
        blocker = room.blocker(obj.id, spot.footprint, asked.clear.other_m)
        if blocker is not None:
            return f"found no free place on {where}; {blocker} is in the way"
        if asked.next_to is not None:
            low, high = asked.next_to.gap_m
            neighbour = Footprint.of(room.objects[asked.next_to.object_id])
            if not low <= spot.footprint.gap_m(neighbour) <= high:
                return f"found no free place on {where} {low:.2f} to {high:.2f} m from {asked.next_to.object_id}"
        return None

    try:
        mine = first_free(obj.id, drawn(), objection).footprint
    except NoRoom:
        room.forget(obj.id)
        raise
    room.put(obj, mine.x_m, mine.y_m, mine.low_m, mine.yaw_rad)
    return obj.id


def scatter(room: Room, models: Sequence[str], asked: PlaceSpec, count: int) -> tuple[str, ...]:
    """Put up to `count` different things of the given models at places, and return their ids.

    Things without a free place are left out, since clutter needs none in particular.
    """
    chosen = [str(model) for model in room.rng.permutation(list(models))[:count]]
    found = []
    for model in chosen:
        obj = room.draw(model)
        try:
            found.append(place(room, obj, asked))
        except NoRoom:
            continue
    return tuple(found)


def _region(room: Room, obj: SceneObject, asked: PlaceSpec) -> Region:
    support, regions = asked.support, asset_for(room.objects[asked.support]).regions
    if asked.region is not None:
        named = [space for space in regions if space.name == asked.region]
        if not named:
            known = ", ".join(space.name for space in regions) or "none"
            raise NoRoom(obj.id, f"{support} has no place {asked.region!r}; it has {known}")
        return named[0]
    high = [space for space in regions if space.height_m >= obj.extent_m[2] + HEADROOM_M]
    tops = [space for space in high if space.kind == "surface" and space.name == "top"]
    if not high:
        raise NoRoom(obj.id, f"no place of {support} is high enough for {obj.extent_m[2]:.2f} m")
    return (tops or high)[0]


def _cm(sides_m: Array) -> str:
    return " x ".join(f"{100 * side:.0f}" for side in sides_m) + " cm"


def _somewhere(room: Room, half: Array, free: Array, edge: AtEdge | None) -> tuple[float, float]:
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
    x, y, _, _ = T_region @ [local[0], local[1], 0.0, 1.0]
    length, width, height = obj.extent_m
    low = float(T_region[2, 3])
    return Footprint(float(x), float(y), yaw_rad, length / 2, width / 2, low, low + height)


def stand_robot(room: Room, *, facing_m: tuple[float, float] = (0.0, 0.0), spread_rad: float = 0.8) -> None:
    """Place the robot on free floor, arm at home, facing the room.

    Args:
        facing_m: (x, y) that it faces; the middle of the room by default.
        spread_rad: Largest deviation of its heading from that, to either side.

    Raises:
        NoRoom: There is no free floor that large.
    """
    taken = {name: Footprint.of(obj) for name, obj in room.objects.items()}
    rng, half_x, half_y = room.rng, room.depth_m / 2 - _BEHIND_M, room.width_m / 2 - _LATERAL_M
    look_x, look_y = facing_m

    def drawn() -> Iterator[tuple[float, float, float]]:
        for _ in range(_ROBOT_TRIES):
            x, y = float(rng.uniform(-half_x, half_x)), float(rng.uniform(-half_y, half_y))
            away = math.hypot(look_x - x, look_y - y)
            heading = math.atan2(look_y - y, look_x - x) if away > 0.3 else rng.uniform(-math.pi, math.pi)
            yield x, y, float(heading + rng.uniform(-spread_rad, spread_rad))

    def objection(pose: tuple[float, float, float]) -> str | None:
        free = room.has_inside(robot_footprint(*pose)) and robot_has_room(*pose, taken)
        return None if free else f"there is no free floor for it in {room.name}"

    x, y, yaw = first_free("robot", drawn(), objection)
    room.robot = RobotPose((x, y, 0.0), math.remainder(yaw, 2 * math.pi))


def robot_footprint(x_m: float, y_m: float, yaw_rad: float) -> Footprint:
    """Return the robot's footprint with its arm at home."""
    ahead = (_AHEAD_M - _BEHIND_M) / 2
    return Footprint(
        x_m + ahead * math.cos(yaw_rad),
        y_m + ahead * math.sin(yaw_rad),
        yaw_rad,
        (_AHEAD_M + _BEHIND_M) / 2,
        _LATERAL_M,
        high_m=_TOP_M,
    )


def robot_has_room(x_m: float, y_m: float, yaw_rad: float, others: Mapping[str, Footprint]) -> bool:
    """Return whether the robot can stand at a pose, arm at home, with a walkway between it and everything else."""
    return all(gap_m >= WALKWAY_M for _, gap_m in gaps_m(robot_footprint(x_m, y_m, yaw_rad), others))


@dataclass(frozen=True, slots=True)
class UprightPose:
    """Pose of an object that was set upright.

    Attributes:
        centre_m: Centre of its box in the world.
        yaw_rad: Heading of the own x axis of the library's model for it, whose front is at -x.
        size_m: Sides along the model's own x, y and z.
        turned: Whether its front is taken to be the side at its own -y.
        lean: x and y of its former vertical unit vector.
    """

    centre_m: tuple[float, float, float]
    yaw_rad: float
    size_m: tuple[float, float, float]
    turned: bool
    lean: tuple[float, float] = (0.0, 0.0)

    @property
    def bottom_m(self) -> float:
        """Height of its bottom."""
        return self.centre_m[2] - self.size_m[2] / 2

    @property
    def lean_deg(self) -> float:
        """Former lean of the object."""
        return math.degrees(math.asin(min(1.0, math.hypot(*self.lean))))


MOST_MOVED_M = 0.30
"""Largest displacement of a thing, sideways or vertically, before it is refused."""

STANDS_M = 0.10
"""By position, a thing stands on a top within this distance."""

NOTED_M = 0.03
"""Height change from which on a note is written; reconstructed heights are off by centimetres."""

_RING_M, _DIRECTIONS = 0.02, 16
_TOUCH_M = 5e-4
_ROBOT_RING_M, _ROBOT_RINGS = 0.10, 60  # Up to 6 m from the camera.


@dataclass(frozen=True, slots=True)
class SupportSpot:
    """A place to stand on.

    Attributes:
        support: Id of its object; None for the floor.
        height_m: Height of the ground there.
        ground: Outline of the ground, within which things are put.
        around: Outline of the whole support, or of the hollow of a small thing: things over it stand on it.
        is_hollow: Whether things there are inside the support.
    """

    support: str | None
    height_m: float
    ground: Footprint
    around: Footprint
    is_hollow: bool = False

    @property
    def name(self) -> str:
        """Its name in sentences."""
        return self.support or "the floor"


_EVERYWHERE = Footprint(0.0, 0.0, 0.0, math.inf, math.inf)
FLOOR_SPOT = SupportSpot(None, 0.0, _EVERYWHERE, _EVERYWHERE)


def _reach(obj: SceneObject, turn_rad: float) -> Array:
    """Half sides (2,) of the box around an object along the axes of its support."""
    half = np.asarray(obj.extent_m[:2]) / 2
    around: Array = np.abs(rotation_z(turn_rad)[:2, :2]) @ half
    return around


class Arrangement:
    """Objects placed so far.

    Attributes:
        objects: id -> object, in the order of placement.
        relations: (relation, thing, support) of everything that stands on or in another thing.
    """

    def __init__(self) -> None:
        self.objects: dict[str, SceneObject] = {}
        self.relations: list[tuple[str, str, str]] = []
        self.notes: list[str] = []
        self._parts: dict[str, list[Footprint]] = {}

    def put(self, obj: SceneObject, at: UprightPose, low_m: float, *, held_by: str | None = None) -> None:
        """Put a thing at its reconstructed place, or up to 30 cm beside that.

        Args:
            obj: The thing, not yet placed.
            low_m: Height of its bottom: of the floor, or where it hangs.
            held_by: Id of its support.

        Raises:
            NoRoom: It is blocked everywhere.
        """
        at_m, yaw_rad = at.centre_m[:2], at.yaw_rad
        quaternion = (math.cos(yaw_rad / 2), 0.0, 0.0, math.sin(yaw_rad / 2))
        placed = replace(obj, position=(*at_m, low_m + obj.extent_m[2] / 2), orientation=quaternion)
        parts = solid_parts(placed)

        def moved(place_m: tuple[float, float]) -> list[Footprint]:
            dx, dy = place_m[0] - at_m[0], place_m[1] - at_m[1]
            return [replace(part, x_m=part.x_m + dx, y_m=part.y_m + dy) for part in parts]

        places = _around(at_m, _RING_M, round(MOST_MOVED_M / _RING_M))
        on_support = (place_m for place_m in places if held_by is None or self._carried(held_by, *place_m))
        blockers: list[str] = []

        def objection(place_m: tuple[float, float]) -> str | None:
            blocker = self._blocker(moved(place_m), held_by)
            if blocker is not None:
                blockers.append(blocker)
            return blocker

        try:
            free_m = first_free(obj.id, on_support, objection)
        except NoRoom:
            blocker = next(iter(blockers), "")
            raise NoRoom(obj.id, f"overlaps {blocker}, with no free place within {MOST_MOVED_M:.1f} m") from None
        self.objects[obj.id] = replace(placed, position=(*free_m, placed.position[2]))
        self._parts[obj.id] = moved(free_m)
        if blockers:
            by_m = math.hypot(free_m[0] - at_m[0], free_m[1] - at_m[1])
            self.notes.append(f"{obj.id} was moved by {100 * by_m:.0f} cm, out of {blockers[0]}")

    def place(self, obj: SceneObject, at: UprightPose, spot: SupportSpot) -> None:
        """Put a thing on or in another one, or on the floor, within the edges of that.

        Raises:
            NoRoom: There is no such place, or it is blocked, as in `put`.
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

    def spot_below(self, obj: SceneObject, at: UprightPose) -> SupportSpot:
        """Return a thing's support by its position: the nearest top, board, hollow or floor under its extent.

        Places under the thing's centre come before those that merely touch its extent, and small things, such as a
        plate, before the furniture under them.

        Raises:
            NoRoom: It is in another thing's box, and on no board of that.
        """
        mine = Footprint(*at.centre_m[:2], at.yaw_rad, at.size_m[0] / 2, at.size_m[1] / 2)
        middle = Footprint(*at.centre_m[:2], 0.0, 0.0, 0.0)
        under = [FLOOR_SPOT]
        for other in self.objects.values():
            if obj.kind is Kind.ITEM or other.kind is not Kind.ITEM:
                under += [spot for spot in self._spots(obj, at, other.id) if mine.gap_m(spot.around) < 0.0]

        def distance_m(spot: SupportSpot) -> float:
            return abs(spot.height_m - at.bottom_m)

        def rank(spot: SupportSpot) -> tuple[bool, bool, float]:
            over = spot.support is not None and middle.gap_m(spot.around) <= 0.0
            on_item = over and self.objects[spot.support or ""].kind is Kind.ITEM
            return not over, not on_item, distance_m(spot)

        near = [spot for spot in under if distance_m(spot) < STANDS_M]
        if near:
            return min(near, key=rank)
        # Floating things come down and sunk ones come up; a thing wholly below a top is not on it.
        top_m = at.bottom_m + at.size_m[2]
        found = min((spot for spot in under if spot.height_m < top_m), key=distance_m, default=FLOOR_SPOT)
        for other in self.objects.values():
            box = Footprint.of(other)
            within = middle.gap_m(box) <= 0.0 and box.low_m < at.centre_m[2] < box.high_m
            if within and found.support != other.id and other.kind is not Kind.ITEM:
                where = f"{distance_m(found):.2f} m from {found.name}"
                raise NoRoom(obj.id, f"is in the box of {other.id} and stands on nothing there; it is {where}")
        return found

    def _spots(self, obj: SceneObject, at: UprightPose, support: str) -> Iterator[SupportSpot]:
        """Yield the open places of another thing that a thing fits in."""
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
            yield SupportSpot(support, z, ground, around, is_hollow=region.kind == "interior")

    def _carried(self, support: str, x_m: float, y_m: float) -> bool:
        """Whether a thing with its centre there would stand on its support."""
        return Footprint(x_m, y_m, 0.0, 0.0, 0.0).gap_m(Footprint.of(self.objects[support])) <= -EDGE_M

    def _blocker(self, parts: list[Footprint], held_by: str | None) -> str | None:
        for other, theirs in self._parts.items():
            if other != held_by and overlap_depth_m(parts, theirs) > _TOUCH_M:
                return other
        return None


def robot_near(objects: Mapping[str, SceneObject], start_m: tuple[float, float]) -> RobotPose:
    """Return a robot pose on the free floor nearest to a point, facing the objects.

    Raises:
        NoRoom: There is none within 6 m.
    """
    middle = np.mean([obj.position[:2] for obj in objects.values()], axis=0)
    taken = {name: Footprint.of(obj) for name, obj in objects.items()}
    poses = ((x, y, math.atan2(middle[1] - y, middle[0] - x)) for x, y in _around(start_m, _ROBOT_RING_M, _ROBOT_RINGS))
    problem = f"there is no free floor for it within {_ROBOT_RING_M * _ROBOT_RINGS:.0f} m of the camera"
    x, y, yaw = first_free("robot", poses, lambda pose: None if robot_has_room(*pose, taken) else problem)
    return RobotPose((x, y, 0.0), yaw)


def _around(middle_m: tuple[float, float], ring_m: float, rings: int) -> Iterator[tuple[float, float]]:
    """Yield a point, then points on growing rings around it."""
    x, y = float(middle_m[0]), float(middle_m[1])
    yield x, y
    for ring in range(1, rings + 1):
        for turn in range(_DIRECTIONS):
            angle = 2.0 * math.pi * turn / _DIRECTIONS
            yield x + ring * ring_m * math.cos(angle), y + ring * ring_m * math.sin(angle)
