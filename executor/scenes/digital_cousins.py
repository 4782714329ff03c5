"""Convert a scene that Digital Cousins reconstructed from a photograph into a scene of library models.

    found = from_cousins("step_3_output/scene_0/scene_0_info.json")
    found.scene   # an `oag.Scene`: parametric models at the sizes and places of the file
    found.notes   # sentences: which things were turned, moved or left out

The file's form is that of https://github.com/cremebrule/digital-cousins (step 3): objects with a category of BEHAVIOR,
a bounding box, a pose relative to the camera, and their mounting. Its meshes are not needed. Objects without a matching
model are refused, all of them in one message.

Things keep their place on the floor or on each other, without overlaps, and the robot gets free floor. Heights come
from the supports, since the models differ from the meshes. Where models overlap, the later one is moved by centimetres,
as Digital Cousins does with its meshes.
"""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

import bddl
from executor.assets.footprint import Footprint, overlap_depth_m, region_frame, solid_parts
from executor.assets.library import asset_for
from executor.assets.parameters import AssetError
from executor.geometry import Array, rotation_z
from executor.scenes.layout import EDGE_M, robot_has_room
from executor.scenes.reconstruction import (
    FLAT,
    Cousin,
    NoMatchingModel,
    Reconstruction,
    UprightPose,
    category_of,
    implausible_size,
    model_for,
    models_of,
    read,
    shaped,
    stand_upright,
    written_category,
)
from executor.scenes.room import CLOSED, NoRoom
from oag import Kind, RobotPose, Scene, SceneError, SceneObject, kind_of
from oag.model.scene import FLOOR, id_problem

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
        notes: Displacements, in sentences.
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
            at: Its reconstructed pose.
            low_m: Height of its bottom: of the floor, or where it hangs.
            held_by: Id of its support.

        Raises:
            NoRoom: It is blocked everywhere.
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

    def spot_on(self, obj: SceneObject, at: UprightPose, support: str) -> SupportSpot:
        """Return the top or board of another thing that is nearest to a thing's height.

        Raises:
            NoRoom: None fits.
        """
        spots = list(self._spots(obj, at, support))
        if not spots:
            raise NoRoom(obj.id, f"stands on {support}, which has no open place for it")
        return min(spots, key=lambda spot: abs(spot.height_m - at.bottom_m))

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

    def robot(self, camera_m: tuple[float, float]) -> RobotPose:
        """Return a robot pose on the free floor nearest to the camera, facing the objects.

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
        """Whether a thing with its centre there would stand on its support."""
        return Footprint(x_m, y_m, 0.0, 0.0, 0.0).gap_m(Footprint.of(self.objects[support])) <= -EDGE_M

    def _blocker(self, parts: list[Footprint], held_by: str | None) -> str | None:
        for other, theirs in self._parts.items():
            if other != held_by and overlap_depth_m(parts, theirs) > _TOUCH_M:
                return other
        return None


def _around(middle_m: tuple[float, float], ring_m: float, rings: int) -> Iterator[tuple[float, float]]:
    """Yield a point, then points on growing rings around it."""
    x, y = float(middle_m[0]), float(middle_m[1])
    yield x, y
    for ring in range(1, rings + 1):
        for turn in range(_DIRECTIONS):
            angle = 2.0 * math.pi * turn / _DIRECTIONS
            yield x + ring * ring_m * math.cos(angle), y + ring * ring_m * math.sin(angle)


_MANY = 3  # Number of things leaning one way that indicates a tilted camera.
_LEAN_DEG = 3.0  # Reconstructions are not exact.
_ONE_WAY = 0.05
_UPRIGHT = 0.99

_NO_NAME = re.compile(r"[^A-Za-z0-9_.-]+")


@dataclass(frozen=True, slots=True)
class SceneWithNotes:
    """A scene, and notes on its differences from the file, in sentences."""

    scene: Scene
    notes: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class _Draft:
    """A reconstructed object with its model, not yet placed."""

    cousin: Cousin
    obj: SceneObject
    at: UprightPose


def from_cousins(path: str | Path) -> SceneWithNotes:
    """Return the scene of a `scene_k_info.json`, with the most similar models of the library.

    Category and size choose the model; the size stays, except for models of fixed proportions. The scene graph
    (`scene_k_graph.json` beside the file) gives the supports, or positions do without it. The robot starts on the free
    floor nearest to the camera.

    Raises:
        SceneError: The file is malformed, or some of its objects cannot be converted; the message lists them all.
    """
    found = read(Path(path))
    drafts, notes, problems = _drafts(found)
    room = Arrangement()
    if not problems:
        problems = _arrange(room, drafts, found)
    if problems:
        listed = "".join(f"\n  - {problem}" for problem in problems)
        count = f"{len(problems)} of {len(found.cousins)} objects cannot be taken over"
        hint = _camera_hint(found)
        raise SceneError(f"{count}{hint}; without them in its `objects` it can be read:{listed}", source=str(path))
    try:
        robot = room.robot((float(found.camera_m[0]), float(found.camera_m[1])))
    except NoRoom as problem:
        raise SceneError(str(problem), source=str(path)) from problem
    facts: list[bddl.Formula] = [bddl.Atom(name, (thing, support)) for name, thing, support in room.relations]
    facts += [bddl.Not(bddl.Atom("open", (key,))) for key, obj in room.objects.items() if obj.kind is Kind.ARTICULATED]
    in_order = {draft.obj.id: room.objects[draft.obj.id] for draft in drafts.values()}
    return SceneWithNotes(Scene(found.name, robot, in_order, tuple(facts), CLOSED), (*found.notes, *notes, *room.notes))


def _drafts(found: Reconstruction) -> tuple[dict[str, _Draft], list[str], list[str]]:
    """Drafts by the ids of the file, notes, and objects without a model."""
    drafts: dict[str, _Draft] = {}
    notes, problems = [], []
    for cousin in found.cousins:
        if cousin.category.lower() in FLAT:
            notes.append(f"{cousin.id} was left out: nothing meets a {cousin.category}")
            continue
        try:
            draft = _draft(cousin, found)
        except NoMatchingModel as problem:
            problems.append(f"{cousin.id}: {problem}")
            continue
        except AssetError as problem:
            problems.append(str(problem))
            continue
        if message := id_problem(draft.obj.id, draft.obj.category):
            problems.append(f"{cousin.id}: {message}")
            continue
        if draft.obj.id in {other.obj.id for other in drafts.values()}:
            problems.append(f"{cousin.id}: another object is called {draft.obj.id} too")
            continue
        drafts[cousin.id] = draft
        if draft.obj.id != cousin.id:
            notes.append(f"{cousin.id!r} is called {draft.obj.id} here: ids have letters, digits, '_', '.' and '-'")
        if draft.at.turned:
            notes.append(f"{cousin.id} has its front at -y, where the camera was")
    return drafts, [*notes, *_leans(drafts.values())], problems


def _leans(drafts: Collection[_Draft]) -> Iterator[str]:
    """Yield former leans of objects that were set upright: one sentence if all leaned one way."""
    leans = np.array([draft.at.lean for draft in drafts]).reshape(-1, 2)
    middle = leans.mean(axis=0) if len(leans) else np.zeros(2)
    tilt_deg = math.degrees(math.asin(min(1.0, float(np.linalg.norm(middle)))))
    if len(leans) >= _MANY and tilt_deg > _LEAN_DEG and np.linalg.norm(leans - middle, axis=1).max() < _ONE_WAY:
        axis = int(np.argmax(np.abs(middle)))
        towards = f"{'+' if middle[axis] > 0.0 else '-'}{'xy'[axis]}"
        message = f"everything leans by {tilt_deg:.0f} degrees towards {towards}"
        yield f"{message}: it was set upright; the camera's pose in the file may be tilted"
        return
    for draft in drafts:
        if draft.at.lean_deg > _LEAN_DEG:
            yield f"{draft.obj.id} leans by {draft.at.lean_deg:.0f} degrees: it was set upright"


def _camera_hint(found: Reconstruction) -> str:
    """Return a hint if reading the camera's quaternion as w x y z would make everything upright."""
    R_camera = found.T_camera[:3, :3]
    w, x, y, z = Rotation.from_matrix(R_camera).as_quat()
    R_swapped = Rotation.from_quat([x, y, z, w]).as_matrix()
    # How upright each one's own z axis is.
    now = [cousin.T_world[2, 2] for cousin in found.cousins]
    then = [(R_swapped @ R_camera.T @ cousin.T_world[:3, :3])[2, 2] for cousin in found.cousins]
    if len(now) < _MANY or min(then) < _UPRIGHT or max(now) > _UPRIGHT:
        return ""
    return " (cam_pose[1] looks like w x y z: everything would be upright then; expected x y z w)"


def _draft(cousin: Cousin, found: Reconstruction) -> _Draft:
    category = category_of(cousin.category)
    front = kind_of(category, min(cousin.extent_m[:2])) is Kind.ARTICULATED
    at = stand_upright(cousin, found.camera_m, front=front)
    entry = model_for(category, at.size_m)
    obj = SceneObject(
        id=_NO_NAME.sub("_", cousin.id).lstrip(".-"),
        category=written_category(cousin.category, entry),
        model=entry.model,
        position=(0.0, 0.0, 0.0),
        orientation=(1.0, 0.0, 0.0, 0.0),
        bbox_extent=shaped(entry, at.size_m),
    )
    asset_for(obj)  # Refuses a size that its parts do not fit in.
    if (message := implausible_size(at.size_m, models_of(category))) is not None:
        raise NoMatchingModel(message)
    return _Draft(cousin, obj, at)


def _arrange(room: Arrangement, drafts: Mapping[str, _Draft], found: Reconstruction) -> list[str]:
    """Place everything, supports and lower objects first, and return the problems."""
    beneath = {cousin.id: cousin.beneath for cousin in found.cousins}
    support_of = {key: _stated_support(key, drafts, beneath) for key in drafts}
    waiting = sorted(drafts, key=lambda key: drafts[key].at.bottom_m)
    problems: list[str] = []
    there: set[str | None] = {None, FLOOR}
    while (key := next((key for key in waiting if support_of[key] in there), None)) is not None:
        waiting.remove(key)
        draft = drafts[key]
        try:
            if draft.cousin.on_floor:
                room.place(draft.obj, draft.at, _spot(room, draft, support_of[key], drafts))
            else:
                room.put(draft.obj, draft.at, draft.at.centre_m[2] - draft.obj.extent_m[2] / 2)
            there.add(key)
        except NoRoom as problem:
            problems.append(str(problem))
    return [*problems, *(f"{key}: stands on what stands on it, or on what has no place" for key in waiting)]


def _stated_support(key: str, drafts: Mapping[str, _Draft], beneath: Mapping[str, str | None]) -> str | None:
    """Return a thing's support by the scene graph: an id of the file or "floor"; None if its height has to decide."""
    if not drafts[key].cousin.on_floor:
        return None
    passed = {key}
    below = beneath.get(key)
    # Flat things were left out; their loads stand on the support below.
    while below is not None and below not in drafts and below != FLOOR:
        if below in passed:
            return None
        passed.add(below)
        below = beneath.get(below)
    return below


def _spot(room: Arrangement, draft: _Draft, stated: str | None, drafts: Mapping[str, _Draft]) -> SupportSpot:
    """Return the place of a thing: by the scene graph, unless the thing is far from that.

    Raises:
        NoRoom: There is nothing.
    """
    if stated is None:
        return room.spot_below(draft.obj, draft.at)
    if stated == FLOOR:
        spot, most_m = FLOOR_SPOT, STANDS_M
    else:
        spot, most_m = room.spot_on(draft.obj, draft.at, drafts[stated].obj.id), MOST_MOVED_M
    away_m = draft.at.bottom_m - spot.height_m
    if abs(away_m) <= most_m:
        return spot
    by_height = room.spot_below(draft.obj, draft.at)
    if by_height != spot:
        side = "above" if away_m > 0.0 else "below"
        message = f"the scene graph has {draft.obj.id} on {spot.name}, and it is {100 * abs(away_m):.0f} cm {side} that"
        room.notes.append(f"{message}; by its height it is on {by_height.name}")
    return by_height
