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
from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import BeforeValidator

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
    Arrangement,
    UprightPose,
    robot_near,
)
from executor.scenes.room import CLOSED, NoRoom
from oag import Scene, SceneError, SceneObject
from oag.model.codec import load
from oag.model.forms import Extent, OpenForm, numbers, unfit
from oag.model.robots import DEFAULT_ROBOT
from oag.model.scene import LARGEST_M, id_problem
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
    """

    id: str
    category: str
    extent_m: tuple[float, float, float]
    T_world: Array
    on_floor: bool


@dataclass(frozen=True, slots=True)
class Reconstruction:
    """A file's content.

    Attributes:
        name: Of the scene.
        T_camera: (4, 4) pose of the camera in the world.
    """

    name: str
    T_camera: Array
    cousins: tuple[Cousin, ...]

    @property
    def camera_m(self) -> Array:
        """(3,) position of the camera."""
        position_m: Array = self.T_camera[:3, 3]
        return position_m


def read(path: Path) -> Reconstruction:
    """Return a file's content.

    Raises:
        SceneError: The file is malformed, with the place, or holds several scenes.
    """
    document = load(path, SceneError)
    if isinstance(document.data, dict) and is_collection(document.data):
        hint = "name the file of one of them, such as scene_0/scene_0_info.json"
        raise document.fail((), f"holds the scenes {', '.join(document.data)}", hint)
    form = document.read(_Info)
    if not form.objects:
        raise document.fail(("objects",), "has no object", "expected one or more, by their names")
    T_camera = form.cam_pose
    cousins = tuple(
        Cousin(
            id=key,
            category=one.category,
            extent_m=one.bbox_extent,
            T_world=T_camera @ one.tf_from_cam,
            on_floor=one.mount is None or one.mount.floor is not False,
        )
        for key, one in form.objects.items()
    )
    return Reconstruction(path.stem.removesuffix("_info"), T_camera, cousins)


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


_LEAN_DEG = 3.0  # Reconstructions are not exact.

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

    Category and size choose the model; the size stays, except for models of fixed proportions. Positions tell what
    stands on what. The robot starts on the free floor nearest to the camera.

    Raises:
        SceneError: The file is malformed, or some of its objects cannot be converted; the message lists them all.
    """
    found = read(Path(path))
    drafts, notes, problems = _drafts(found)
    room = Arrangement()
    if not problems:
        problems = _arrange(room, drafts.values())
    if problems:
        listed = "".join(f"\n  - {problem}" for problem in problems)
        count = f"{len(problems)} of {len(found.cousins)} objects cannot be taken over"
        raise SceneError(f"{count}; without them in its `objects` it can be read:{listed}", source=str(path))
    try:
        robot = robot_near(room.objects, (float(found.camera_m[0]), float(found.camera_m[1])))
    except NoRoom as problem:
        raise SceneError(str(problem), source=str(path)) from problem
    facts: list[bddl.Formula] = [bddl.Atom(name, (thing, support)) for name, thing, support in room.relations]
    facts += [bddl.Not(bddl.Atom("open", (key,))) for key, obj in room.objects.items() if obj.kind is Kind.ARTICULATED]
    in_order = {draft.obj.id: room.objects[draft.obj.id] for draft in drafts.values()}
    scene = Scene(found.name, robot, in_order, tuple(facts), CLOSED).with_robot(DEFAULT_ROBOT.name)
    return SceneWithNotes(scene, (*notes, *room.notes))


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
        if draft.at.lean_deg > _LEAN_DEG:
            notes.append(f"{draft.obj.id} leans by {draft.at.lean_deg:.0f} degrees: it was set upright")
    return drafts, notes, problems


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


def _arrange(room: Arrangement, drafts: Collection[_Draft]) -> list[str]:
    """Place everything, lower objects first, and return the problems."""
    problems: list[str] = []
    for draft in sorted(drafts, key=lambda draft: draft.at.bottom_m):
        try:
            if draft.cousin.on_floor:
                room.place(draft.obj, draft.at, room.spot_below(draft.obj, draft.at))
            else:
                room.put(draft.obj, draft.at, draft.at.centre_m[2] - draft.obj.extent_m[2] / 2)
        except NoRoom as problem:
            problems.append(str(problem))
    return problems
