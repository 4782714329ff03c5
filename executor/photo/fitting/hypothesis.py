"""Pose hypotheses of library models, and ray casting against their meshes.

Rays are transformed into the hypothesis's frame and scaled to the size at which its mesh was built. Another pose or
size so needs no new mesh. Scaling distorts details such as the thickness of panels: the mesh is rebuilt near the end of
a search.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache, lru_cache
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from executor.assets.asset_geometry import shape_mesh
from executor.assets.library import BUILT, asset_for
from executor.assets.model import Shape
from executor.assets.parameters import AssetError, ModelEntry
from executor.geometry import Array, rotation_z, transform_from_quaternion
from executor.photo.geometry.observation import Observation
from executor.sim.render.cameras import joints_at_start, link_frames
from executor.system.extras import require
from oag import SceneObject

Parameters = tuple[tuple[str, object], ...]
Size = tuple[float, float, float]
_DIGITS = 3  # Meshes are rebuilt for every millimetre.
_KEPT = 500
_AROUND_PX = 12  # Of a box's corners: feet and rims reach a little out of it.
_CORNERS = np.array(list(itertools.product((-0.5, 0.5), repeat=3)))
_UPRIGHT = (1.0, 0.0, 0.0, 0.0)
_NORMAL_STEPS = 1.4  # Faces of one direction have one shade; round objects so have a few.
_SHADES = 1000  # Distinguished steps of each colour channel.


@dataclass(frozen=True)
class PoseHypothesis:
    """Pose hypothesis of one object, upright in the level frame.

    Attributes:
        entry: Model of the library.
        x_m, y_m: Middle of its box.
        yaw_rad: Heading of its own x axis, from front to back.
        bottom_m: Height of its support.
        size_m: Length, width, height.
        parameters: Options of the model, such as its hinge side.
        fixed: Whether it hangs on a wall and is no furniture: it neither falls nor carries anything.
    """

    entry: ModelEntry
    x_m: float
    y_m: float
    yaw_rad: float
    bottom_m: float
    size_m: Size
    parameters: Parameters = ()
    fixed: bool = False

    def as_object(self, object_id: str = "guess") -> SceneObject:
        """Return it as an object of a scene."""
        half = self.yaw_rad / 2
        return SceneObject(
            id=object_id,
            category=self.entry.category,
            model=self.entry.model,
            position=(self.x_m, self.y_m, self.bottom_m + self.size_m[2] / 2),
            orientation=(math.cos(half), 0.0, 0.0, math.sin(half)),
            bbox_extent=self.size_m,
            parameters=dict(self.parameters),
            fixed=self.fixed,
        )

    def to_json(self) -> dict[str, object]:
        """Return it as plain data, which `hypothesis_of` reads back."""
        return {
            "model": self.entry.model,
            "category": self.entry.category,
            "place_m": [self.x_m, self.y_m, self.bottom_m],
            "yaw_rad": self.yaw_rad,
            "size_m": list(self.size_m),
            "parameters": dict(self.parameters),
            **({"fixed": True} if self.fixed else {}),
        }

    def with_parameters(self, **values: object) -> PoseHypothesis:
        """Return it with some options changed."""
        return replace(self, parameters=tuple(sorted({**dict(self.parameters), **values}.items())))

    def shifted(self, by_m: Array) -> PoseHypothesis:
        """Return it at another place, moved by (2,) along the floor."""
        return replace(self, x_m=self.x_m + float(by_m[0]), y_m=self.y_m + float(by_m[1]))

    def local(self, eye_m: Array) -> tuple[Array, Array]:
        """Return an eye (3,) in the object's frame, whose origin is the box's middle, and (3, 3) that rotates rays."""
        c, s = math.cos(self.yaw_rad), math.sin(self.yaw_rad)
        turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        middle = np.array([self.x_m, self.y_m, self.bottom_m + self.size_m[2] / 2])
        return (eye_m - middle) @ turn, turn

    def corners_m(self) -> Array:
        """Return the (8, 3) corners of its box in the level frame."""
        return self._placed(_CORNERS)

    def outline_m(self) -> Array:
        """Return points (N, 3) on the hull of the model in the level frame; they enclose it tightly."""
        return self._placed(_hull(self.entry))

    def _placed(self, points: Array) -> Array:
        """Transform points (N, 3) of a unit box to the level frame."""
        c, s = math.cos(self.yaw_rad), math.sin(self.yaw_rad)
        turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        middle = [self.x_m, self.y_m, self.bottom_m + self.size_m[2] / 2]
        return np.asarray(points * self.size_m @ turn.T + middle)


def hypothesis_of(data: Mapping[str, Any]) -> PoseHypothesis:
    """Return the hypothesis of plain data; KeyError, TypeError or ValueError where it is none."""
    entry = replace(BUILT[data["model"]], category=str(data["category"]))
    x_m, y_m, bottom_m = map(float, data["place_m"])
    length, width, height = map(float, data["size_m"])
    parameters = tuple(sorted(data["parameters"].items()))
    size_m, fixed = (length, width, height), bool(data.get("fixed", False))
    return PoseHypothesis(entry, x_m, y_m, float(data["yaw_rad"]), bottom_m, size_m, parameters, fixed)


class MeshRaycaster:
    """Casts rays against the mesh of a model at one size.

    Args:
        thing: What to build; only its size, model and parameters count.

    Raises:
        AssetError: It cannot be built.
    """

    def __init__(self, thing: SceneObject) -> None:
        shapes = _shapes(thing)
        triangles = [placed for _, placed in shapes]
        colors = [shape.color[:3] for shape, _ in shapes]
        clear = [len(shape.color) > 3 and shape.color[3] < 1.0 for shape, _ in shapes]
        corners = np.concatenate(triangles)
        self.colors = np.repeat(colors, [len(one) for one in triangles], axis=0)
        self.size_m = np.asarray(thing.extent_m)
        self.symmetric = asset_for(thing).symmetric_about_z
        self.groups = _alike(self.colors, corners)
        self.is_clear = np.repeat(clear, [len(one) for one in triangles])
        core = require("embreex.rtcore_scene", "photo")
        construction = require("embreex.mesh_construction", "photo")
        self._scene: Any = core.EmbreeScene()
        # The scene has a copy of it. A mesh that is deleted after its scene would take memory with it that is gone.
        construction.TriangleMesh(self._scene, np.ascontiguousarray(corners, dtype=np.float32))

    def depth(self, guess: PoseHypothesis, eye_m: Array, rays: Array) -> Array:
        """Return (N,) the depth at which each ray meets a hypothesis of this model, infinite for a miss."""
        distance = self._scene.run(*self._stretched(guess, eye_m, rays), query="DISTANCE")
        return np.where(distance > 1e6, np.inf, distance.astype(float))

    def render_depth(
        self, guess: PoseHypothesis, eye_m: Array, rays: Array, behind: NDArray[np.int32] | None = None
    ) -> tuple[Array, NDArray[np.int64]]:
        """Return (N,) the depth of each ray, infinite for a miss, and (N,) its group of similar faces, -1 for none.

        Args:
            guess: The hypothesis.
            eye_m: (3,) origin of the rays.
            rays: (N, 3) the rays.
            behind: (N,) the face behind the object, which shines through transparent faces and so splits their groups.
        """
        found = self._scene.run(*self._stretched(guess, eye_m, rays), output=1)
        hit = found["primID"] >= 0
        depth = np.where(hit, found["tfar"].astype(float), np.inf)
        face = np.where(hit, found["primID"], 0)
        group = np.where(hit, self.groups[face], -1)
        if behind is not None and self.is_clear.any():
            separated = group + (self.groups.max() + 1) * (1 + behind.astype(np.int64))
            separated = np.where(hit & self.is_clear[face], separated, group)
            group = np.unique(np.append(separated, -1), return_inverse=True)[1][:-1] - 1
        return depth, group

    def colours(self, guess: PoseHypothesis, eye_m: Array, rays: Array) -> tuple[Array, Array]:
        """Return (N,) the depth of each ray, and (N, 3) the linear colour there, black for a miss."""
        found = self._scene.run(*self._stretched(guess, eye_m, rays), output=1)
        hit = found["primID"] >= 0
        depth = np.where(hit, found["tfar"].astype(float), np.inf)
        return depth, np.where(hit[:, None], self.colors[np.where(hit, found["primID"], 0)], 0.0)

    def _stretched(
        self, guess: PoseHypothesis, eye_m: Array, rays: Array
    ) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        eye, turn = guess.local(eye_m)
        factor = self.size_m / np.asarray(guess.size_m)
        origins = np.empty(rays.shape, dtype=np.float32)
        origins[:] = eye * factor
        directions: NDArray[np.float32] = (rays @ (turn * factor)).astype(np.float32)
        return origins, directions


def _alike(colors: Array, corners: Array) -> NDArray[np.int64]:
    """Group triangles (N, 3, 3) of similar orientation and equal colour (N, 3); return (N,) group numbers."""
    a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    normals = a[:, [1, 2, 0]] * b[:, [2, 0, 1]] - a[:, [2, 0, 1]] * b[:, [1, 2, 0]]
    normals /= np.maximum(np.sqrt((normals * normals).sum(axis=1, keepdims=True)), 1e-12)
    steps = np.round(normals * _NORMAL_STEPS).astype(np.int64) + round(_NORMAL_STEPS)
    shades = np.round(colors * _SHADES).astype(np.int64)
    # One whole number for all six is sorted in a tenth of the time that rows are.
    number = np.zeros(len(corners), dtype=np.int64)
    for column in (*shades.T, *steps.T):
        number = number * (_SHADES + 1) + column
    return np.asarray(np.unique(number, return_inverse=True)[1].ravel(), dtype=np.int64)


def _box_triangles() -> Array:
    """Return (12, 3, 3) corners of the faces of a box from -1 to 1, wound outwards."""
    found = []
    for axis, side in itertools.product(range(3), (-1.0, 1.0)):
        across, up = (axis + 1) % 3, (axis + 2) % 3
        corners = np.zeros((4, 3))
        corners[:, axis] = side
        corners[:, across], corners[:, up] = side * np.array([-1, 1, 1, -1]), [-1, -1, 1, 1]
        found += [corners[[0, 1, 2]], corners[[0, 2, 3]]]
    return np.array(found)


@cache
def _unit(kind: Literal["box", "cylinder", "sphere"]) -> Array:
    """Return (N, 3, 3) corners of the faces of a box, a cylinder or a ball from -1 to 1."""
    return _box_triangles() if kind == "box" else np.asarray(shape_mesh(Shape(kind, (1.0, 1.0))).triangles)


def _triangles(shape: Shape) -> Array:
    """Return (N, 3, 3) in the link's frame. Most shapes are boxes and bars, in thousands of hypotheses."""
    if shape.kind == "convex" or shape.kind == "mesh":
        return np.asarray(shape_mesh(shape).triangles)
    # Sizes of round shapes begin with the radius; a cylinder's end with half its length.
    half_m = shape.size_m if shape.kind == "box" else (shape.size_m[0], shape.size_m[0], shape.size_m[-1])
    if tuple(shape.orientation) == _UPRIGHT:
        return np.asarray(_unit(shape.kind) * half_m + np.asarray(shape.position_m))
    T = transform_from_quaternion(shape.position_m, shape.orientation)
    return (_unit(shape.kind) * half_m) @ T[:3, :3].T + T[:3, 3]


@lru_cache(maxsize=_KEPT)
def _body(model: str, size_m: Size, parameters: Parameters) -> MeshRaycaster | None:
    try:
        return MeshRaycaster(PoseHypothesis(BUILT[model], 0.0, 0.0, 0.0, 0.0, size_m, parameters).as_object())
    except AssetError:
        return None


def _shapes(thing: SceneObject) -> list[tuple[Shape, Array]]:
    """Return the visible shapes of an object, each with its triangles (N, 3, 3) in the object's frame."""
    asset = asset_for(thing)
    frames = link_frames(asset, joints_at_start(thing, asset))
    found = []
    for link in asset.links:
        T = frames[link.name]
        found += [(one, _triangles(one) @ T[:3, :3].T + T[:3, 3]) for one in link.shapes if one.visible]
    return found


@cache
def _hull(entry: ModelEntry) -> Array:
    """Return (N, 3) corners of the convex hull of a closed model, scaled to a unit box."""
    thing = PoseHypothesis(entry, 0.0, 0.0, 0.0, 0.0, largest_m(entry)).as_object()
    corners = np.concatenate([triangles.reshape(-1, 3) for _, triangles in _shapes(thing)])
    return np.asarray(corners[ConvexHull(corners).vertices] / thing.extent_m)


def largest_m(entry: ModelEntry) -> Size:
    """Return the largest length, width and height of a model."""
    width = entry.width.high
    length, height = (span.high * (width if span.of_width else 1.0) for span in (entry.length, entry.height))
    return length, width, height


def raycaster_of(guess: PoseHypothesis) -> MeshRaycaster | None:
    """Return the raycaster of a hypothesis at its own size, to the millimetre; None if its model does not allow it."""
    x, y, z = (round(side, _DIGITS) for side in guess.size_m)
    return _body(guess.entry.model, (x, y, z), guess.parameters)


def as_built(guess: PoseHypothesis) -> PoseHypothesis:
    """Round a hypothesis to the millimetre if only its rounded size can be built."""
    try:
        asset_for(guess.as_object())
    except AssetError:
        x, y, z = (round(side, _DIGITS) for side in guess.size_m)
        return replace(guess, size_m=(x, y, z))
    return guess


def picture_of(guess: PoseHypothesis, observation: Observation) -> tuple[Array, NDArray[np.int32]]:
    """Return (H, W) depth of a hypothesis in a picture, infinite outside it, and (H, W) its groups of faces."""
    depth, group = np.full(observation.z_m.shape, np.inf), np.full(observation.z_m.shape, -1, dtype=np.int32)
    body = raycaster_of(guess)
    if body is None:
        return depth, group
    pixels = observation.pixels(guess.corners_m())
    window = np.s_[:, :]
    opened = float(str(dict(guess.parameters).get("open_fraction", 0.0))) > 0.0
    if np.isfinite(pixels).all() and not opened:
        width, height = observation.size_px
        left, top = np.clip(np.floor(pixels.min(axis=0)) - _AROUND_PX, 0, [width, height]).astype(int)
        right, bottom = np.clip(np.ceil(pixels.max(axis=0)) + _AROUND_PX, 0, [width, height]).astype(int)
        window = np.s_[top:bottom, left:right]
    rays = observation.rays[window]
    if rays.size:
        rendered = body.render_depth(guess, observation.eye_m, rays.reshape(-1, 3))
        depth[window], group[window] = (one.reshape(rays.shape[:2]) for one in rendered)
    return depth, group


@cache
def is_round(entry: ModelEntry) -> bool:
    """Return whether a model looks the same in every orientation at any size: a plate does, a die does not."""
    if not entry.length.of_width or entry.length.low != 1.0 or entry.length.high != 1.0:
        return False
    body = raycaster_of(PoseHypothesis(entry, 0.0, 0.0, 0.0, 0.0, largest_m(entry)))
    return body is not None and body.symmetric


def has_ear(entry: ModelEntry) -> bool:
    """Return whether a model has no sides but an orientation, as a mug has."""
    return entry.length.of_width and not is_round(entry)


def body_middle_m(yaw_rad: float, length_m: float, width_m: float) -> Array:
    """Return (2,) the offset of the round body of an object with an ear from the middle of its box."""
    return np.asarray(rotation_z(yaw_rad)[:2, 0] * (width_m - length_m) / 2)
