"""Convert a scene that Digital Cousins reconstructed from a photograph into a scene of library models.

    found = from_cousins("step_3_output/scene_0/scene_0_info.json")
    found.scene   # an `oag.Scene`: parametric models at the sizes and places of the file
    found.notes   # sentences: which things were turned, moved or left out

The file `scene_k_info.json` has a camera, and objects posed relative to it, in the form of
https://github.com/cremebrule/digital-cousins (step 3): a category of BEHAVIOR, a bounding box, a pose and the mounting.
Its quaternions are x y z w; all others in this project are w x y z. The world has z up and the floor at 0. Other fields
(models, scales, resolution) are ignored, since the bounding box includes the scale; meshes are not needed. Objects
without a matching model are refused, all of them in one message.

Things are set upright, and their fronts are determined. They keep their place on the floor or on each other, without
overlaps, and the robot gets free floor. Heights come from the supports, since the models differ from the meshes. Where
models overlap, the later one is moved by centimetres, as Digital Cousins does with its meshes.
"""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import BeforeValidator
from scipy.spatial.transform import Rotation

import bddl
from executor.assets.library import asset_for
from executor.assets.parameters import AssetError
from executor.geometry import Array, rotation_z, transform_from_quaternion, wrap_angle
from executor.scenes.library import is_collection
from executor.scenes.models import (
    FLAT,
    NoMatchingModel,
    category_of,
    implausible_size,
    model_for,
    models_of,
    shaped,
    written_category,
)
from executor.scenes.placement import (
    FLOOR_SPOT,
    MOST_MOVED_M,
    STANDS_M,
    Arrangement,
    SupportSpot,
    UprightPose,
    robot_near,
)
from executor.scenes.room import CLOSED, NoRoom
from oag import Scene, SceneError, SceneObject
from oag.model.codec import load
from oag.model.forms import Extent, OpenForm, numbers, unfit
from oag.model.robots import DEFAULT_ROBOT
from oag.model.scene import FLOOR, LARGEST_M, id_problem
from oag.model.symbols import Kind, kind_of

_POSE_DIGITS = 1e-3  # Tolerance for rounding in a file.


@dataclass(frozen=True, slots=True)
class Cousin:
    """One object of the file.

    Attributes:
        id: Its name there.
        category: A category of BEHAVIOR, such as "bottom_cabinet".
        extent_m: Sides of its box along its own axes, scale applied.
        T_world: (4, 4) pose in the world of its root frame, taken as the centre of its box.
        on_floor: Whether it stands on something; False for an object mounted on a wall only.
        beneath: Id of its support by the scene graph, "floor", or None without such an entry.
    """

    id: str
    category: str
    extent_m: tuple[float, float, float]
    T_world: Array
    on_floor: bool
    beneath: str | None = None


@dataclass(frozen=True, slots=True)
class Reconstruction:
    """A file's content.

    Attributes:
        name: Of the scene.
        T_camera: (4, 4) pose of the camera in the world.
        notes: Implausible entries of the scene graph, in sentences.
    """

    name: str
    T_camera: Array
    cousins: tuple[Cousin, ...]
    notes: tuple[str, ...] = ()

    @property
    def camera_m(self) -> Array:
        """(3,) position of the camera."""
        position_m: Array = self.T_camera[:3, 3]
        return position_m


def read(path: Path) -> Reconstruction:
    """Return a file's content; the scene graph is read from the file beside it that has the usual name.

    Raises:
        SceneError: The file is malformed, with the place, or holds several scenes.
    """
    document = load(path, SceneError)
    if isinstance(document.data, dict) and is_collection(document.data):
        hint = "name the file of one of them, such as scene_0/scene_0_info.json"
        raise document.fail((), f"holds the scenes {', '.join(document.data)}", hint)
    form = document.read(_Info)
    T_camera = form.cam_pose
    beneath, notes = _known(_beneath(path), form.objects)
    cousins = tuple(
        Cousin(
            id=key,
            category=one.category,
            extent_m=one.bbox_extent,
            T_world=T_camera @ one.tf_from_cam,
            on_floor=one.mount is None or one.mount.floor is not False,
            beneath=beneath.get(key),
        )
        for key, one in form.objects.items()
    )
    return Reconstruction(path.stem.removesuffix("_info"), T_camera, cousins, notes)


def _beneath(path: Path) -> dict[str, str]:
    """Return each object's support by the scene graph; empty without a graph.

    The file names the graph by its path on the machine that made it; here it is looked for beside the file.
    """
    graph = path.with_name(f"{path.stem.removesuffix('_info')}_graph.json")
    if not graph.is_file():
        return {}
    entries = load(graph, SceneError).read(dict[str, _GraphEntry])
    return {key: entry.objBeneath for key, entry in entries.items() if entry.objBeneath is not None}


def _known(beneath: Mapping[str, str], objects: Collection[str]) -> tuple[dict[str, str], tuple[str, ...]]:
    """Return the scene graph's entries about the file's objects, and notes on the rest."""
    strangers = [key for key in beneath if key not in objects and key != FLOOR]
    notes = [f"the scene graph places {key}, which is not in the file" for key in strangers]
    known = {}
    for key, below in beneath.items():
        if key in strangers or key == FLOOR:
            continue
        if below == FLOOR or (below in objects and below != key):
            known[key] = below
            continue
        why = "itself" if below == key else f"{below}, which is not in the file"
        notes.append(f"the scene graph has {key} on {why}; its height tells what it stands on")
    return known, tuple(notes)


def _camera(value: object) -> Array:
    if not isinstance(value, list) or len(value) != 2:
        raise unfit("expected a position x y z and a quaternion x y z w")
    position = numbers(value[0], 3, "x y z in metres", -LARGEST_M, LARGEST_M, at=(0,))
    x, y, z, w = numbers(value[1], 4, "quaternion x y z w", at=(1,))
    if abs(x * x + y * y + z * z + w * w - 1.0) > _POSE_DIGITS:
        raise unfit("expected a unit quaternion x y z w", "", 1)
    return transform_from_quaternion(position, (w, x, y, z))


def _rigid(value: object) -> Array:
    rows = value if isinstance(value, list) else [value]
    what = "a row of a 4 x 4 pose"
    T = np.array([numbers(row, 4, what, -LARGEST_M, LARGEST_M, at=(number,)) for number, row in enumerate(rows)])
    R = T[:3, :3]
    if T.shape != (4, 4) or not np.allclose(R @ R.T, np.eye(3), atol=_POSE_DIGITS) or np.linalg.det(R) <= 0.0:
        raise unfit("expected a rigid 4 x 4 pose")
    return T


class _Mount(OpenForm):
    floor: Any = None


class _Thing(OpenForm):
    category: str
    tf_from_cam: Annotated[Any, BeforeValidator(_rigid)]
    bbox_extent: Extent
    mount: _Mount | None = None


class _Info(OpenForm):
    cam_pose: Annotated[Any, BeforeValidator(_camera)]
    objects: dict[str, _Thing]


class _GraphEntry(OpenForm):
    objBeneath: str | None = None


MOST_TILTED_RAD = math.radians(20.0)


def stand_upright(cousin: Cousin, camera_m: Array, *, front: bool) -> UprightPose:
    """Return an object's upright pose.

    The front of a cousin is at its own +x, or at -y for assets that were made so; the file does not record which. A
    photograph shows fronts, so it is +x unless that faces away from the camera and -y faces it.

    Args:
        camera_m: Position of the camera in the world.
        front: Whether it has a front, such as a cabinet.

    Raises:
        NoMatchingModel: It leans by more than 20 degrees; the message has the angle.
    """
    R = cousin.T_world[:3, :3]
    yaw = _yaw(R)
    stood = rotation_z(yaw).T @ R
    tilt = float(np.arccos(min(1.0, float(np.abs(stood[2]).max()))))
    if tilt > MOST_TILTED_RAD:
        raise NoMatchingModel(f"leans by {math.degrees(tilt):.0f} degrees")
    vertical = int(np.argmax(np.abs(R[2])))
    lean_x, lean_y = (float(value) for value in R[:2, vertical] * np.sign(R[2, vertical]))
    # Each own axis counts for the one of the upright frame that it is nearest to, so that a lean adds no length.
    nearest = np.abs(stood).argmax(axis=0)
    size = np.zeros(3)
    np.maximum.at(size, nearest, cousin.extent_m)
    if not size.all():
        raise NoMatchingModel("leans sideways")
    x, y, z = (float(value) for value in cousin.T_world[:3, 3])
    length, width, height = (float(value) for value in size)
    towards = np.asarray(camera_m)[:2] - (x, y)
    ahead, right = rotation_z(yaw)[:2, 0], -rotation_z(yaw)[:2, 1]
    turned = front and bool(ahead @ towards < 0.0 < right @ towards)
    if turned:
        return UprightPose((x, y, z), wrap_angle(yaw + math.pi / 2), (width, length, height), turned, (lean_x, lean_y))
    return UprightPose((x, y, z), wrap_angle(yaw + math.pi), (length, width, height), turned, (lean_x, lean_y))


def _yaw(R: Array) -> float:
    """Return the last turn about the vertical; that of the own y axis if x is vertical."""
    if math.hypot(R[0, 0], R[1, 0]) > math.sin(MOST_TILTED_RAD):
        return math.atan2(R[1, 0], R[0, 0])
    return math.atan2(-R[0, 1], R[1, 1])


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
        robot = robot_near(room.objects, (float(found.camera_m[0]), float(found.camera_m[1])))
    except NoRoom as problem:
        raise SceneError(str(problem), source=str(path)) from problem
    facts: list[bddl.Formula] = [bddl.Atom(name, (thing, support)) for name, thing, support in room.relations]
    facts += [bddl.Not(bddl.Atom("open", (key,))) for key, obj in room.objects.items() if obj.kind is Kind.ARTICULATED]
    in_order = {draft.obj.id: room.objects[draft.obj.id] for draft in drafts.values()}
    scene = Scene(found.name, robot, in_order, tuple(facts), CLOSED).with_robot(DEFAULT_ROBOT.name)
    return SceneWithNotes(scene, (*found.notes, *notes, *room.notes))


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
