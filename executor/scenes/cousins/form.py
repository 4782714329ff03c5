"""The form of `scene_k_info.json`: a camera, and objects posed relative to it.

Quaternions are x y z w here, and only here. The world is z up with the floor at 0. What a file says beyond the fields
that are read (models, scales, resolution) is passed over: the bounding box has the scale in it.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import BeforeValidator

from executor.geometry import Array, transform_from_quaternion
from executor.scenes.library import is_collection
from oag import SceneError
from oag.model.forms import OpenForm, numbers, unfit
from oag.model.jsonfile import load
from oag.model.scenefile import FLOOR, LARGEST_M
from oag.model.sceneform import Extent

_POSE_DIGITS = 1e-3  # What rounding in a file may change.


@dataclass(frozen=True, slots=True)
class Cousin:
    """One object of the file.

    Attributes:
        id: Its name there.
        category: A category of BEHAVIOR, such as "bottom_cabinet".
        extent_m: Sides of its box along its own axes, scale applied.
        T_world: (4, 4) pose in the world of its root frame, which is taken for the middle of its box.
        on_floor: Whether it stands on something; False for what hangs on a wall alone.
        beneath: Id of what it stands on by the scene graph, "floor", or None where no graph says it.
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
        notes: What of the scene graph cannot be meant, in sentences.
    """

    name: str
    T_camera: Array
    cousins: tuple[Cousin, ...]
    notes: tuple[str, ...] = ()

    @property
    def camera_m(self) -> Array:
        """(3,) where the camera was."""
        position_m: Array = self.T_camera[:3, 3]
        return position_m


def read(path: Path) -> Reconstruction:
    """Returns what a file says; the scene graph is taken from the file beside it that has the usual name.

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
    """What each object stands on, by the scene graph; empty where there is none.

    The file names the graph by its path on the machine that made it; here it is looked for beside the file.
    """
    graph = path.with_name(f"{path.stem.removesuffix('_info')}_graph.json")
    if not graph.is_file():
        return {}
    entries = load(graph, SceneError).read(dict[str, _GraphEntry])
    return {key: entry.objBeneath for key, entry in entries.items() if entry.objBeneath is not None}


def _known(beneath: Mapping[str, str], objects: Collection[str]) -> tuple[dict[str, str], tuple[str, ...]]:
    """Returns what of a scene graph is about the file's objects, and notes on the rest."""
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
    said = "a row of a 4 x 4 pose"
    T = np.array([numbers(row, 4, said, -LARGEST_M, LARGEST_M, at=(number,)) for number, row in enumerate(rows)])
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
