"""The form of `scene_k_info.json`: a camera, and objects posed relative to it.

Quaternions are x y z w here, and only here. The world is z up with the floor at 0. What a file says beyond the fields
that are read (models, scales, resolution) is passed over: the bounding box has the scale in it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from executor.geometry import Array, transform_from_quaternion
from executor.scenes.library import is_collection
from oag import SceneError
from oag.model.jsonfile import JsonNode, load
from oag.model.scenefile import LARGEST_M, read_extent

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
        beneath: Id of what it stands on by the scene graph, "floor", or None where there is no graph.
    """

    id: str
    category: str
    extent_m: tuple[float, float, float]
    T_world: Array
    on_floor: bool
    beneath: str | None = None


@dataclass(frozen=True, slots=True)
class Reconstruction:
    """A file's content: its name, where the camera was, and the objects."""

    name: str
    camera_m: Array
    cousins: tuple[Cousin, ...]


def read(path: Path) -> Reconstruction:
    """Returns what a file says; the scene graph is taken from the file beside it that has the usual name.

    Raises:
        SceneError: The file is malformed, with the place, or holds several scenes.
    """
    root = load(path, SceneError)
    if is_collection(root.mapping()):
        names = ", ".join(root.mapping())
        raise root.fail(f"holds the scenes {names}", "name the file of one of them, such as scene_0/scene_0_info.json")
    T_camera = _camera(root.require("cam_pose"))
    beneath = _beneath(path)
    cousins = tuple(_cousin(key, node, T_camera, beneath) for key, node in root.require("objects").items())
    return Reconstruction(path.stem.removesuffix("_info"), T_camera[:3, 3], cousins)


def _camera(node: JsonNode) -> Array:
    parts = node.elements()
    if len(parts) != 2:
        raise node.fail("expected a position x y z and a quaternion x y z w")
    position = parts[0].numbers(3, "x y z in metres", -LARGEST_M, LARGEST_M)
    x, y, z, w = parts[1].numbers(4, "quaternion x y z w")
    if abs(x * x + y * y + z * z + w * w - 1.0) > _POSE_DIGITS:
        raise parts[1].fail("expected a unit quaternion x y z w")
    return transform_from_quaternion(position, (w, x, y, z))


def _cousin(key: str, node: JsonNode, T_camera: Array, beneath: Mapping[str, str]) -> Cousin:
    rows = node.require("tf_from_cam")
    T = np.array([row.numbers(4, "a row of a 4 x 4 pose", -LARGEST_M, LARGEST_M) for row in rows.elements()])
    if T.shape != (4, 4) or not _is_rotation(T[:3, :3]):
        raise rows.fail("expected a rigid 4 x 4 pose")
    mount = node.get("mount")
    floor = mount.get("floor") if mount is not None else None
    return Cousin(
        id=key,
        category=node.require("category").string(),
        extent_m=read_extent(node.require("bbox_extent")),
        T_world=T_camera @ T,
        on_floor=floor is None or floor.value is not False,
        beneath=beneath.get(key),
    )


def _is_rotation(R: Array) -> bool:
    return bool(np.allclose(R @ R.T, np.eye(3), atol=_POSE_DIGITS) and np.linalg.det(R) > 0.0)


def _beneath(path: Path) -> dict[str, str]:
    """What each object stands on, by the scene graph; empty where there is none.

    The file names the graph by its path on the machine that made it; here it is looked for beside the file.
    """
    graph = path.with_name(f"{path.stem.removesuffix('_info')}_graph.json")
    if not graph.is_file():
        return {}
    entries = load(graph, SceneError).items()
    return {key: below for key, node in entries if (below := node.text("objBeneath")) is not None}
