"""A guess of what a thing is and where, and the rays that meet it.

Rays are taken into the guess's own frame and stretched to the size at which its triangles were made: a pose or another
size so needs no new triangles. What a stretch gets wrong, such as the thickness of panels, is made anew when a search
has come near its end.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, replace
from functools import cache, lru_cache
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from executor.assets.library import LIBRARY, asset_for
from executor.assets.model import Shape
from executor.assets.parameters import AssetError, ModelEntry
from executor.assets.surface import surface_of
from executor.geometry import Array, rotation_z, transform_from_quaternion
from executor.machine.extras import require
from executor.photo.space.observation import Observation
from executor.pictures.solids import joints_at_start, link_frames
from oag import SceneObject

Parameters = tuple[tuple[str, object], ...]
Size = tuple[float, float, float]
_DIGITS = 3  # Triangles are made anew for every millimetre.
_KEPT = 500
_AROUND_PX = 12  # Of a box's corners: feet and rims reach a little out of it.
_CORNERS = np.array(list(itertools.product((-0.5, 0.5), repeat=3)))
_UPRIGHT = (1.0, 0.0, 0.0, 0.0)
_NORMAL_STEPS = 1.4  # Faces that look the same way are lit alike; round things so have a few shades.
_SHADES = 1000  # Of each part of a colour, that are told apart.


@dataclass(frozen=True)
class Guess:
    """What a thing may be, upright in the level frame.

    Attributes:
        entry: Model of the library.
        x_m, y_m: Middle of its box.
        yaw_rad: Heading of its own x axis, from front to back.
        bottom_m: Height of what it stands on.
        size_m: Length, width, height.
        parameters: Options of the model, such as its hinge side.
    """

    entry: ModelEntry
    x_m: float
    y_m: float
    yaw_rad: float
    bottom_m: float
    size_m: Size
    parameters: Parameters = ()

    def as_object(self, object_id: str = "guess") -> SceneObject:
        """Returns it as an object of a scene."""
        half = self.yaw_rad / 2
        return SceneObject(
            id=object_id,
            category=self.entry.category,
            model=self.entry.model,
            position=(self.x_m, self.y_m, self.bottom_m + self.size_m[2] / 2),
            orientation=(math.cos(half), 0.0, 0.0, math.sin(half)),
            bbox_extent=self.size_m,
            parameters=dict(self.parameters),
        )

    def with_parameters(self, **values: object) -> Guess:
        """Returns it with some options changed."""
        return replace(self, parameters=tuple(sorted({**dict(self.parameters), **values}.items())))

    def local(self, eye_m: Array) -> tuple[Array, Array]:
        """Returns an eye (3,) in its own frame, whose origin is its box's middle, and (3, 3) that turns rays."""
        c, s = math.cos(self.yaw_rad), math.sin(self.yaw_rad)
        turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        middle = np.array([self.x_m, self.y_m, self.bottom_m + self.size_m[2] / 2])
        return (eye_m - middle) @ turn, turn

    def corners_m(self) -> Array:
        """Returns the (8, 3) corners of its box in the level frame."""
        return self._placed(_CORNERS)

    def outline_m(self) -> Array:
        """Returns points (N, 3) in the level frame that enclose it, as its box's corners do, and all are on it."""
        return self._placed(_hull(self.entry))

    def _placed(self, points: Array) -> Array:
        """Points (N, 3) of a box with sides of 1 where they are in the level frame."""
        c, s = math.cos(self.yaw_rad), math.sin(self.yaw_rad)
        turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        middle = [self.x_m, self.y_m, self.bottom_m + self.size_m[2] / 2]
        return np.asarray(points * self.size_m @ turn.T + middle)


class Body:
    """The triangles of a model at one size, ready for rays.

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

    def depth(self, guess: Guess, eye_m: Array, rays: Array) -> Array:
        """Returns (N,) the depth at which each ray meets a guess of this model, infinite where it does not."""
        distance = self._scene.run(*self._stretched(guess, eye_m, rays), query="DISTANCE")
        return np.where(distance > 1e6, np.inf, distance.astype(float))

    def looks(
        self, guess: Guess, eye_m: Array, rays: Array, behind: NDArray[np.int32] | None = None
    ) -> tuple[Array, NDArray[np.int64]]:
        """Returns the depth at which each ray meets it, and (N,) which group of like faces it meets, -1 for none.

        Args:
            guess: The guess.
            eye_m: (3,) where the rays begin.
            rays: (N, 3) the rays.
            behind: (N,) which face is behind it: it shines through faces that are clear, and so parts them.
        """
        found = self._scene.run(*self._stretched(guess, eye_m, rays), output=1)
        hit = found["primID"] >= 0
        depth = np.where(hit, found["tfar"].astype(float), np.inf)
        face = np.where(hit, found["primID"], 0)
        group = np.where(hit, self.groups[face], -1)
        if behind is not None and self.is_clear.any():
            parted = group + (self.groups.max() + 1) * (1 + behind.astype(np.int64))
            parted = np.where(hit & self.is_clear[face], parted, group)
            group = np.unique(np.append(parted, -1), return_inverse=True)[1][:-1] - 1
        return depth, group

    def colours(self, guess: Guess, eye_m: Array, rays: Array) -> tuple[Array, Array]:
        """Returns the depth at which each ray meets it, and (N, 3) the linear colour there, black for none."""
        found = self._scene.run(*self._stretched(guess, eye_m, rays), output=1)
        hit = found["primID"] >= 0
        depth = np.where(hit, found["tfar"].astype(float), np.inf)
        return depth, np.where(hit[:, None], self.colors[np.where(hit, found["primID"], 0)], 0.0)

    def _stretched(self, guess: Guess, eye_m: Array, rays: Array) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        eye, turn = guess.local(eye_m)
        factor = self.size_m / np.asarray(guess.size_m)
        origins = np.empty(rays.shape, dtype=np.float32)
        origins[:] = eye * factor
        directions: NDArray[np.float32] = (rays @ (turn * factor)).astype(np.float32)
        return origins, directions


def _alike(colors: Array, corners: Array) -> NDArray[np.int64]:
    """(N,) which of some triangles (N, 3, 3) look the same way and are of one colour (N, 3), by number."""
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
    """(12, 3, 3) corners of the faces of a box from -1 to 1, wound so that they look outwards."""
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
    """(N, 3, 3) corners of the faces of a box, a cylinder or a ball from -1 to 1."""
    return _box_triangles() if kind == "box" else np.asarray(surface_of(Shape(kind, (1.0, 1.0))).triangles)


def _triangles(shape: Shape) -> Array:
    """(N, 3, 3) in the link's frame. Most shapes are boxes and bars, which thousands of guesses are built of."""
    if shape.kind == "convex" or shape.kind == "mesh":
        return np.asarray(surface_of(shape).triangles)
    # Of what is round, the radius comes first, and of a cylinder half its length last.
    half_m = shape.size_m if shape.kind == "box" else (shape.size_m[0], shape.size_m[0], shape.size_m[-1])
    if tuple(shape.orientation) == _UPRIGHT:
        return np.asarray(_unit(shape.kind) * half_m + np.asarray(shape.position_m))
    T = transform_from_quaternion(shape.position_m, shape.orientation)
    return (_unit(shape.kind) * half_m) @ T[:3, :3].T + T[:3, 3]


@lru_cache(maxsize=_KEPT)
def _body(model: str, size_m: Size, parameters: Parameters) -> Body | None:
    try:
        return Body(Guess(LIBRARY[model], 0.0, 0.0, 0.0, 0.0, size_m, parameters).as_object())
    except AssetError:
        return None


def _shapes(thing: SceneObject) -> list[tuple[Shape, Array]]:
    """The shapes of a thing that are seen, each with its triangles (N, 3, 3) in the thing's frame."""
    asset = asset_for(thing)
    frames = link_frames(asset, joints_at_start(thing, asset))
    found = []
    for link in asset.links:
        T = frames[link.name]
        found += [(one, _triangles(one) @ T[:3, :3].T + T[:3, 3]) for one in link.shapes if one.visible]
    return found


@cache
def _hull(entry: ModelEntry) -> Array:
    """(N, 3) corners of the convex hull of a model that is shut, where its box has sides of 1."""
    thing = Guess(entry, 0.0, 0.0, 0.0, 0.0, largest_m(entry)).as_object()
    corners = np.concatenate([triangles.reshape(-1, 3) for _, triangles in _shapes(thing)])
    return np.asarray(corners[ConvexHull(corners).vertices] / thing.extent_m)


def largest_m(entry: ModelEntry) -> Size:
    """Returns the length, width and height of a model that is as large as it comes."""
    width = entry.width.high
    length, height = (span.high * (width if span.of_width else 1.0) for span in (entry.length, entry.height))
    return length, width, height


def body_of(guess: Guess) -> Body | None:
    """Returns the triangles of a guess at its own size, to the millimetre; None where its model cannot have that."""
    x, y, z = (round(side, _DIGITS) for side in guess.size_m)
    return _body(guess.entry.model, (x, y, z), guess.parameters)


def as_built(guess: Guess) -> Guess:
    """Returns a guess that has triangles, to the millimetre, as one that can be built at exactly its size."""
    try:
        asset_for(guess.as_object())
    except AssetError:
        x, y, z = (round(side, _DIGITS) for side in guess.size_m)
        return replace(guess, size_m=(x, y, z))
    return guess


def picture_of(guess: Guess, seen: Observation) -> tuple[Array, NDArray[np.int32]]:
    """Returns (H, W) depth of a guess in a picture, infinite where it is not, and (H, W) its groups of like faces.

    Without depth all its faces are one group: their edges are in the picture as its outline is, and hide where that is.
    """
    depth, group = np.full(seen.z_m.shape, np.inf), np.full(seen.z_m.shape, -1, dtype=np.int32)
    body = body_of(guess)
    if body is None:
        return depth, group
    pixels = seen.pixels(guess.corners_m())
    window = np.s_[:, :]
    opened = float(str(dict(guess.parameters).get("open_fraction", 0.0))) > 0.0
    if np.isfinite(pixels).all() and not opened:
        width, height = seen.size_px
        left, top = np.clip(np.floor(pixels.min(axis=0)) - _AROUND_PX, 0, [width, height]).astype(int)
        right, bottom = np.clip(np.ceil(pixels.max(axis=0)) + _AROUND_PX, 0, [width, height]).astype(int)
        window = np.s_[top:bottom, left:right]
    rays = seen.rays[window]
    if rays.size:
        looks = body.looks(guess, seen.eye_m, rays.reshape(-1, 3))
        depth[window], group[window] = (one.reshape(rays.shape[:2]) for one in looks)
    return depth, np.minimum(group, 0) if seen.by_sight else group


@cache
def is_round(entry: ModelEntry) -> bool:
    """Decides whether no turn of a model is told apart, whatever its size: a plate is round, and a die is not."""
    if not entry.length.of_width or entry.length.low != 1.0 or entry.length.high != 1.0:
        return False
    body = body_of(Guess(entry, 0.0, 0.0, 0.0, 0.0, largest_m(entry)))
    return body is not None and body.symmetric


def has_ear(entry: ModelEntry) -> bool:
    """Decides whether a model has no sides, and yet looks otherwise from turn to turn, as a mug does."""
    return entry.length.of_width and not is_round(entry)


def body_middle_m(yaw_rad: float, length_m: float, width_m: float) -> Array:
    """Returns (2,) how far the round body of what has an ear is from the middle of its box, ear and all."""
    return np.asarray(rotation_z(yaw_rad)[:2, 0] * (width_m - length_m) / 2)
