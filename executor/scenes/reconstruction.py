"""Scenes reconstructed by Digital Cousins: the file `scene_k_info.json`, and the library's model for each object.

The file has a camera, and objects posed relative to it. Its quaternions are x y z w; all others in this project are
w x y z. The world has z up and the floor at 0. Other fields of the file (models, scales, resolution) are ignored, since
the bounding box includes the scale.

Category and size choose the model. The object is set upright, and its front is determined.
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import BeforeValidator

from bddl import near_names
from executor.assets.library import LIBRARY
from executor.assets.parameters import ModelEntry, Range
from executor.geometry import Array, rotation_z, transform_from_quaternion, wrap_angle
from executor.scenes.library import is_collection
from oag import SceneError, kind_of
from oag.model.codec import load
from oag.model.forms import Extent, OpenForm, numbers, unfit
from oag.model.scene import FLOOR, LARGEST_M

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
        cousins: The objects.
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


Size = tuple[float, float, float]
_CATEGORIES = tomllib.loads((resources.files(__package__) / "data" / "categories.toml").read_text("utf-8"))
FLAT = frozenset(_CATEGORIES["flat"])
"""Categories that are left out."""

MOST_TILTED_RAD = math.radians(20.0)

ABSURD = 3.0
"""A size so many times larger than the largest of its kind, or smaller than the smallest, is implausible."""

_UNITS_M = {"centimetres": 0.01, "millimetres": 0.001, "inches": 0.0254}


class NoMatchingModel(ValueError):
    """The library has no matching model, or the object is tilted; the message is half a sentence."""


def category_of(theirs: str) -> str:
    """Return the library's category for a category or a synset of BEHAVIOR.

    A `bottle_of_water` is a bottle, a `breakfast_table` a table: words after "of" are dropped, then the longest known
    ending decides.

    Raises:
        NoMatchingModel: There is none; the message suggests near ones.
    """
    exact = next((entry.category for entry in LIBRARY.values() if entry.synset == theirs), None)
    if exact is not None:
        return exact
    known = {entry.category: entry.category for entry in LIBRARY.values()} | dict(_CATEGORIES["alike"])
    words = theirs.lower().split(".", 1)[0].replace("__", "_").replace("-", "_").split("_")
    words = words[: words.index("of")] if "of" in words[1:] and theirs not in known else words
    for start in range(len(words)):
        name = "_".join(words[start:])
        if name in known:
            return known[name]
    near = near_names(words[-1], sorted(known))
    hint = f"; near it: {', '.join(near)}" if near else ""
    raise NoMatchingModel(f"the library has nothing of the category {theirs!r}{hint}")


def model_for(category: str, size_m: Size) -> ModelEntry:
    """Return the model of a category whose ranges are nearest to a size; the first one among equals."""
    return min(models_of(category), key=lambda entry: _misfit(entry, size_m))


def written_category(theirs: str, entry: ModelEntry) -> str:
    """Return the category for the scene: the original where it is more exact, else the model's."""
    own = theirs.endswith(f"_{entry.category}") and kind_of(theirs, 0.0) is kind_of(entry.category, 0.0)
    return theirs if own else entry.category


def shaped(entry: ModelEntry, size_m: Size) -> Size:
    """Return a size with the model's fixed proportions: a glass is round, an apple is a ball.

    Lengths without a fixed ratio stay, in or out of the range that the model is drawn from.
    """
    length, width, height = size_m
    if entry.length.of_width:
        width = (length + width) / 2 if entry.length.low == entry.length.high else min(length, width)
        length = _within(max(size_m[:2]), entry.length, width)
    return (length, width, _within(height, entry.height, width) if entry.height.of_width else height)


def _within(value: float, span: Range, width_m: float) -> float:
    return min(max(value, span.low * width_m), span.high * width_m)


def _misfit(entry: ModelEntry, size_m: Size) -> float:
    """Distance of a size from a model's ranges: the sum over the axes of the logarithm of the ratio."""
    total = 0.0
    for value, span in zip(size_m, (entry.length, entry.width, entry.height), strict=True):
        unit = size_m[1] if span.of_width else 1.0
        total += abs(math.log(value / _within(value, span, unit)))
    return total


def implausible_size(size_m: Size, entries: Collection[ModelEntry]) -> str | None:
    """Describe a size far larger or smaller than that of all given models; return None for a plausible size.

    It catches slips of a decimal point or of a unit; a unit that makes the size usual is named.
    """
    low, high = _smallest_and_largest_m(entries)

    def is_like(unit_m: float) -> bool:
        sides = zip(size_m, low, high, strict=True)
        return all(least / ABSURD <= value * unit_m <= ABSURD * most for value, least, most in sides)

    if is_like(1.0):
        return None
    own, least, most = (" x ".join(f"{value:.3g}" for value in size) for size in (size_m, low, high))
    unit = next((f"; {name}?" for name, unit_m in _UNITS_M.items() if is_like(unit_m)), "")
    return f"is {own} m; its like are {least} to {most} m{unit}"


def _smallest_and_largest_m(entries: Collection[ModelEntry]) -> tuple[list[float], list[float]]:
    """Return the least and the largest x, y and z of models' ranges; x and y are treated alike, as sides."""
    low: list[list[float]] = []
    high: list[list[float]] = []
    for entry in entries:
        spans = (entry.length, entry.width, entry.height)
        low.append([span.low * (entry.width.low if span.of_width else 1.0) for span in spans])
        high.append([span.high * (entry.width.high if span.of_width else 1.0) for span in spans])
    least, most = [min(axis) for axis in zip(*low, strict=True)], [max(axis) for axis in zip(*high, strict=True)]
    return [min(least[:2])] * 2 + least[2:], [max(most[:2])] * 2 + most[2:]


def models_of(category: str) -> tuple[ModelEntry, ...]:
    """Return the library's models of one of its categories."""
    return tuple(entry for entry in LIBRARY.values() if entry.category == category)


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


def stand_upright(cousin: Cousin, camera_m: Array, *, front: bool) -> UprightPose:
    """Return an object's upright pose.

    The front of a cousin is at its own +x, or at -y for assets that were made so; the file does not record which. A
    photograph shows fronts, so it is +x unless that faces away from the camera and -y faces it.

    Args:
        cousin: The object.
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
