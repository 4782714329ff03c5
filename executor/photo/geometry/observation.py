"""The picture in the level frame: a ray, a depth and its noise for every pixel.

The floor defines the level frame: it is the lowest large level plane of the depth. Where a table's top fills the
picture, that is the lowest one. The floor is then below it by the usual height of a table, and the record says so.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from executor.assets.library import LIBRARY
from executor.geometry import Array
from executor.photo.errors import PhotoRefused
from executor.photo.geometry.planes import LevelPlane, LevelPlanes, level_by_walls, level_planes, top_direction
from executor.photo.inputs.annotations import Detection
from executor.photo.inputs.depth import Depth
from executor.photo.inputs.picture import HEIGHTS_M, CameraFacts, Intrinsics, Photograph
from executor.system.extras import require
from oag.model.symbols import Kind, is_known, kind_of


@dataclass(frozen=True)
class Noise:
    """Standard deviation of depth: `base_m` close by, growing by `growth_per_m` times the square of the depth."""

    base_m: float
    growth_per_m: float

    def sigma_m(self, z_m: Array) -> Array:
        """Return the standard deviation at some depths."""
        return np.asarray(self.base_m + self.growth_per_m * z_m**2)

    def to_json(self) -> dict[str, object]:
        """Return it as plain data."""
        return {"base_m": self.base_m, "growth_per_m": self.growth_per_m}


TYPICAL = Noise(0.002, 0.0018)
"""Of structured-light and stereo cameras for rooms; assumed until the floor has been measured."""

_STRIP, _LEAST_PX, _ASIDE = (
    0.1,
    2.0,
    0.2,
)  # Of a box's height, above its lower end; of its width, left out at each side.
_LOW_PERCENTILE = 25.0  # Of the heights there: what is seen of the thing itself is higher.
_LEAST_MEASURED = 6
_NEARER_M = 0.08
_NEAREST_M = 0.05  # Before the camera.


@dataclass(frozen=True)
class Observation:
    """A picture in the level frame, with or without depth.

    Attributes:
        rgb: (H, W, 3) uint8.
        z_m: (H, W) depth along the camera's axis, 0 where nothing was measured.
        rays: (H, W, 3) in the level frame; a point is the eye plus depth times ray.
        eye_m: (3,) the camera: on the z axis of the level frame.
        R_camera_level: (3, 3) level to camera.
        noise: Of the depth.
        K: The camera's intrinsics.
        depth_distortion: Relative depth error that varies slowly over the picture, see `Depth`.
        heading_rad: Without depth, or if it is distorted, one of the main directions of the room's lines, up to quarter
            turns.
    """

    rgb: NDArray[np.uint8]
    z_m: Array
    rays: Array
    eye_m: Array
    R_camera_level: Array
    noise: Noise
    K: Intrinsics
    heading_rad: float | None = None
    depth_distortion: float = 0.0

    @property
    def size_px(self) -> tuple[int, int]:
        """Width and height."""
        return self.z_m.shape[1], self.z_m.shape[0]

    @cached_property
    def has_depth(self) -> bool:
        """Whether anything was measured; else the picture is the only evidence."""
        return bool(self.z_m.any())

    @cached_property
    def measured(self) -> NDArray[np.bool_]:
        """(H, W) where there is a depth."""
        return self.z_m > 0.0

    @cached_property
    def points_m(self) -> Array:
        """(H, W, 3) in the level frame; the eye where nothing was measured."""
        return np.asarray(self.eye_m + self.rays * self.z_m[..., None])

    @cached_property
    def sigma_m(self) -> Array:
        """(H, W) standard deviation of each depth."""
        return self.noise.sigma_m(self.z_m)

    @property
    def depth_distortion_m(self) -> Array:
        """(H, W) standard deviation of each depth including its distortion."""
        return np.hypot(self.sigma_m, self.depth_distortion * self.z_m)

    @property
    def floor_z_m(self) -> Array:
        """(H, W) depth of the floor, infinite above the horizon."""
        down = -self.rays[..., 2]
        return np.where(down > 1e-6, self.eye_m[2] / np.maximum(down, 1e-6), np.inf)

    def foot_m(self, box_px: tuple[float, float, float, float]) -> Array | None:
        """Return (3,) the point where a box ends; None where hardly anything is measured there."""
        x0, y0, x1, y1 = box_px
        first = max(0, int(y1 - max(_LEAST_PX, _STRIP * (y1 - y0))))
        left = int(x0 + _ASIDE * (x1 - x0))
        window = np.s_[first : int(y1) + 1, left : max(left + 1, int(x1 - _ASIDE * (x1 - x0)))]
        points = self.points_m[window][self.measured[window]]
        if len(points) < _LEAST_MEASURED:
            return None
        x, y, _ = np.median(points, axis=0)
        return np.array([x, y, np.percentile(points[:, 2], _LOW_PERCENTILE)])

    def pixels(self, points_m: Array) -> Array:
        """Return (N, 2) the pixels of points (N, 3) of the level frame; nan behind the camera."""
        in_camera = (np.atleast_2d(points_m) - self.eye_m) @ self.R_camera_level.T
        depth = np.where(in_camera[:, 2] > 1e-6, in_camera[:, 2], np.nan)
        u = self.K.fx * in_camera[:, 0] / depth + self.K.cx
        v = self.K.fy * in_camera[:, 1] / depth + self.K.cy
        return np.stack([u, v], axis=1)

    def bounds_px(self, points_m: Array) -> tuple[Array, Array]:
        """Return the least and the largest u and v of the visible part of the hull of points (N, 3).

        They are those of the points themselves if none of it is in the picture, nan if all of it is behind the camera.
        """
        pixels = self.pixels(points_m)
        if np.isnan(pixels).any():
            pixels = self.pixels(self._before(points_m))
        if not len(pixels):
            return np.full(2, np.nan), np.full(2, np.nan)
        low, high = pixels.min(axis=0), pixels.max(axis=0)
        if (low >= 0.0).all() and (high <= self.size_px).all():
            return low, high
        geometry = require("shapely.geometry", "photo")
        shown = geometry.MultiPoint(pixels).convex_hull.intersection(geometry.box(0.0, 0.0, *self.size_px))
        return (low, high) if shown.is_empty else (np.array(shown.bounds[:2]), np.array(shown.bounds[2:]))

    def _before(self, points_m: Array) -> Array:
        """Return points (N, 3) whose hull is the part before the camera of the hull of some points (M, 3)."""
        depth = (points_m - self.eye_m) @ self.R_camera_level.T[:, 2] - _NEAREST_M
        before, behind = points_m[depth > 0.0], points_m[depth <= 0.0]
        near, far = depth[depth > 0.0][:, None], depth[depth <= 0.0][None, :]
        share = (near / np.maximum(near - far, 1e-9))[..., None]
        crossing = before[:, None] + share * (behind[None, :] - before[:, None])
        return np.concatenate([before, crossing.reshape(-1, 3)])

    @cached_property
    def edges(self) -> NDArray[np.bool_]:
        """(H, W) where depth jumps to a neighbour by more than noise does, or was not measured."""
        jump = 0.04 + 4.0 * self.noise.sigma_m(self.z_m)
        across = np.abs(np.diff(self.z_m, axis=1, append=self.z_m[:, -1:])) > jump
        down = np.abs(np.diff(self.z_m, axis=0, append=self.z_m[-1:])) > jump
        return np.asarray(across | down)


def is_hidden(observation: Observation, depth_m: Array) -> NDArray[np.bool_]:
    """Return (H, W) where something clearly nearer than a depth picture (H, W) was measured."""
    return np.asarray(
        observation.measured & (observation.z_m < depth_m - _NEARER_M - 4.0 * observation.depth_distortion_m)
    )


_STRAIGHT_DOWN = math.cos(math.radians(0.5))
USUAL_TOP_M = 0.74
"""Height of a table whose floor is not visible: that of desks by EN 527-1, and of most dining tables."""

_LEAST_FLOOR_M2 = 0.2  # Visible floor: a smaller area can be a seat.
_DESK_M = 0.75  # Nobody holds a camera lower above a floor; above a table's top, people do.
_TOPS = ("table", "desk", "desk_with_drawers", "coffee_table", "countertop", "nightstand", "bottom_cabinet")
_SEATS_M = {"bed": 0.5, "sofa": 0.42, "armchair": 0.42, "chair": 0.45, "ottoman": 0.42}
"""Usual heights of what people sit or lie on."""

_NOTHING_BELOW_M = 0.1  # Of what is measured, below a floor that is near the camera.
_HARDLY_M2 = 0.02  # Of level planes: they have no direction.
_CLEARER = 10.0  # Times as large as what seems level by the picture's upwards.
_ON_TOP, _LEAST_LOWER_M = 0.8, 0.25  # Share of a plane in the box of its table; of a floor, below a top in that box.
_AS_GIVEN = 0.1  # Share by which people are off with the height of a camera.
_SAMPLES, _LEVELS = 8000, 8  # Points and bins of depth by which noise is measured.
_SHOW_IT = (
    "add --tilt DEGREES (and --roll of a camera that is turned, --camera-height-m METRES if that does not do), or a "
    "box around the table below the camera; are the depths in the right unit (--depth-unit-m)?"
)


@dataclass(frozen=True)
class FloorPlane:
    """The floor in the camera's frame.

    Attributes:
        up: (3,) unit normal in the camera's frame.
        height_m: Of the camera above it.
        visible_m2: Visible area.
        tilt_deg: How far the camera looks down.
        residual_m: Median distance of its points from the plane.
        source: Its origin, for people.
        spread_share: Relative uncertainty of its distance: the scale of everything on it.
        above_top_m: Height of the camera above the top that was measured where no floor is visible; None elsewhere.
    """

    up: Array
    height_m: float
    visible_m2: float
    tilt_deg: float
    residual_m: float
    source: str = "plane fitted to the depth"
    spread_share: float = 0.0
    above_top_m: float | None = None

    def to_json(self) -> dict[str, object]:
        """Return it as plain data."""
        return {
            "camera_height_m": self.height_m,
            "camera_above_top_m": self.above_top_m,
            "camera_looks_down_deg": self.tilt_deg,
            "floor_seen_m2": self.visible_m2,
            "floor_residual_m": self.residual_m,
            "source": self.source,
            "spread_share": self.spread_share,
        }


def observe(
    picture: Photograph, depth: Depth, camera: Intrinsics, things: Sequence[Detection] = ()
) -> tuple[Observation, FloorPlane]:
    """Return the picture in the level frame, and the floor that levels it.

    Args:
        picture, depth, camera: The input.
        things: Detections, by which a table's top is told from a floor.

    Raises:
        PhotoRefused: Nothing level is visible.
    """
    floor = floor_below(picture.source, level_planes(depth, camera), things)
    return levelled(picture, depth, camera, floor), floor


def levelled(picture: Photograph, depth: Depth, camera: Intrinsics, floor: FloorPlane) -> Observation:
    """Return the picture in the level frame of a floor, with the noise of its depth there."""
    R = level_rotation(floor.up)
    return Observation(
        picture.rgb,
        depth.z_m,
        camera.rays(picture.size_px) @ R.T,
        np.array([0.0, 0.0, floor.height_m]),
        R.T,
        _noise(depth, camera, floor),
        camera,
        depth_distortion=depth.depth_distortion,
    )


def floor_below(
    source: str | Path, found: LevelPlanes | None, things: Sequence[Detection] = (), facts: CameraFacts | None = None
) -> FloorPlane:
    """Return the floor by the level planes of the depth.

    It is the lowest plane, unless that is a table's top: it lies in the boxes of tables, or near below the camera. A
    given height decides.

    Args:
        source: The picture's file, for messages.
        found: The planes; None without any.
        things: Detections.
        facts: What is known of the camera.

    Raises:
        PhotoRefused: There is no plane, and tilt and height are not given; or it is absurdly far below.
    """
    up, given_m = (None, None) if facts is None else (facts.up, facts.height_m)
    if found is None:
        if up is None or given_m is None:
            raise PhotoRefused("floor", source, "no floor is seen in it: nothing level is below the camera", _SHOW_IT)
        return FloorPlane(up, given_m, 0.0, tilt_deg(up), 0.0, "tilt and height as given; the depth has no level plane")
    lowest = _lowest(found)
    if lowest.height_m > HEIGHTS_M[1]:
        problem = f"no floor is seen in it: the lowest level plane is {lowest.height_m:.2f} m below the camera"
        raise PhotoRefused("floor", source, problem, f"expected at most {HEIGHTS_M[1]:g} m; {_SHOW_IT}")
    if given_m is not None:
        nearest = min(found.planes, key=lambda one: abs(one.height_m - given_m))
        if abs(nearest.height_m - given_m) < _AS_GIVEN * given_m:
            return _floor(found.up, nearest, "plane fitted to the depth, as far below the camera as given")
        return _below(found.up, lowest, given_m, "the camera's height as given; the depth shows no floor there")
    if small := _small_floor(found, lowest, things):
        return _floor(found.up, small, "plane fitted to the depth, a small part of the floor")
    carrier = _carrier(found, things)
    is_floor = (
        lowest.height_m >= _DESK_M or _stands_furniture(found, lowest, things) or _is_walled(found, lowest, things)
    )
    if carrier is None and is_floor:
        return _floor(found.up, lowest, "plane fitted to the depth")
    named, top_m = ("table", USUAL_TOP_M) if carrier is None else (carrier.label, _usual_top_m(carrier))
    assumed = f"assumed: {top_m:.2f} m below the top of the {named}, which is {lowest.height_m:.2f} m below the camera"
    return _below(found.up, lowest, lowest.height_m + top_m, f"{assumed}; no floor is visible")


def planes_below(
    found: LevelPlanes | None, depth: Depth, camera: Intrinsics, things: Sequence[Detection]
) -> LevelPlanes | None:
    """Return the level planes of a picture, by a detected table's top where the camera looks down or is turned.

    A top that is seen too flat, with nothing else that is level, is told by walls and by the things on it.

    Args:
        found: The planes of a camera that is held upright, if any; those below a table have to be far larger.
        depth, camera: The input.
        things: Detections.
    """
    for table in (one for one in things if one.category in _TOPS):
        others = [one.box_px for one in things if one is not table and one.area_px < table.area_px]
        about = top_direction(depth, camera, table.box_px, others)
        turned = None if about is None else level_planes(depth, camera, about)
        if turned is not None and (found is None or turned.area_m2 > _CLEARER * found.area_m2):
            return turned
        is_hardly = found is None or found.area_m2 < _HARDLY_M2
        if is_hardly and (flat := level_by_walls(depth, camera, table.box_px, others)) is not None:
            return flat
    return found


def unnamed_top(found: LevelPlanes | None, floor: FloorPlane, things: Sequence[Detection]) -> Detection | None:
    """Return the table whose top was measured where no floor is visible, unless it is detected; None without one."""
    if found is None or floor.above_top_m is None or _carrier(found, things) is not None:
        return None
    pixels = _lowest(found).pixels
    (x0, y0), (x1, y1) = pixels.min(axis=0), pixels.max(axis=0)
    box_px = float(x0), float(y0), float(x1), float(y1)
    return Detection("table", "table", box_px, 1.0, "level plane of the depth", provenance="detector")


def _lowest(found: LevelPlanes) -> LevelPlane:
    return next((one for one in found.planes if one.area_m2 >= _LEAST_FLOOR_M2), found.planes[0])


def _small_floor(found: LevelPlanes, lowest: LevelPlane, things: Sequence[Detection]) -> LevelPlane | None:
    """Return the small plane far below the lowest large one, if that one is of tops: it lies in boxes of things."""
    under = [one for one in found.planes if one.height_m > lowest.height_m + _LEAST_LOWER_M]
    u, v = lowest.pixels.T
    boxed = np.zeros(len(u), dtype=bool)
    for x0, y0, x1, y1 in (one.box_px for one in things):
        boxed |= (u >= x0) & (u <= x1) & (v >= y0) & (v <= y1)
    return max(under, key=lambda one: one.area_m2) if under and boxed.mean() >= _ON_TOP else None


def _carrier(found: LevelPlanes, things: Sequence[Detection]) -> Detection | None:
    """Return the detected table of which the lowest plane is the top: no other plane in its box is its top.

    Nearer below the camera than a floor, it may be a seat or a bed as well.
    """
    lowest = _lowest(found)
    tops = _TOPS if lowest.height_m >= _DESK_M else (*_TOPS, *_SEATS_M)
    higher = [one for one in found.planes if one.height_m < lowest.height_m - _LEAST_LOWER_M]
    for thing in sorted((one for one in things if one.category in tops), key=lambda one: one.area_px):
        is_in = lowest.share_in(thing.box_px) >= _ON_TOP
        if is_in and not any(one.share_in(thing.box_px) >= _ON_TOP for one in higher):
            return thing
    return None


def _stands_furniture(found: LevelPlanes, lowest: LevelPlane, things: Sequence[Detection]) -> bool:
    """Return whether a plane near below the camera is the floor: furniture has boxes, and nothing is lower."""
    names = (one.category or "" for one in things)
    standing = any(is_known(name) and kind_of(name, 0.0) is not Kind.ITEM for name in names if name not in _TOPS)
    return standing and found.deepest_m < lowest.height_m + _NOTHING_BELOW_M


def _is_walled(found: LevelPlanes, lowest: LevelPlane, things: Sequence[Detection]) -> bool:
    """Return whether a plane near below the camera is the floor: it ends at a wall, and a person boxed no table.

    Of 43 real depths with boxes that people drew, one would get a table without a box, and that is a floor.
    A network may miss a table.
    """
    is_drawn = bool(things) and all(one.provenance == "person" and one.category not in _TOPS for one in things)
    return is_drawn and found.is_walled and found.deepest_m < lowest.height_m + _NOTHING_BELOW_M


def _usual_top_m(thing: Detection) -> float:
    if thing.category in _SEATS_M:
        return _SEATS_M[thing.category]
    entry = next(one for one in LIBRARY.values() if one.category == thing.category)
    return entry.height.clipped(USUAL_TOP_M, entry.width.low)


def _floor(up: Array, plane: LevelPlane, source: str) -> FloorPlane:
    return FloorPlane(up, plane.height_m, plane.area_m2, tilt_deg(up), plane.residual_m, source)


def _below(up: Array, top: LevelPlane, height_m: float, source: str) -> FloorPlane:
    above_top_m = top.height_m if top.height_m < height_m else None
    return FloorPlane(up, height_m, 0.0, tilt_deg(up), top.residual_m, source, above_top_m=above_top_m)


def tilt_deg(up: Array) -> float:
    """Return how far a camera with this vertical (3,) looks down [deg]."""
    return math.degrees(math.asin(float(np.clip(-up[2], -1.0, 1.0))))


def level_rotation(up: Array) -> Array:
    """Return (3, 3) camera to level: z up, x where the camera looks."""
    # Where it looks straight down, upwards in the picture is ahead.
    view = np.array([0.0, 0.0, 1.0]) if abs(up[2]) < _STRAIGHT_DOWN else np.array([0.0, -1.0, 0.0])
    ahead = view - (view @ up) * up
    ahead /= np.linalg.norm(ahead)
    return np.stack([ahead, np.cross(up, ahead), up])


def _noise(depth: Depth, camera: Intrinsics, floor: FloorPlane) -> Noise:
    """Estimate the depth noise from the points of floor or top: their spread along the rays, by depth."""
    rows, columns = np.nonzero(depth.z_m > 0.0)
    some = np.linspace(0, len(rows) - 1, 4 * _SAMPLES).astype(int) if len(rows) else np.zeros(0, dtype=int)
    z = depth.z_m[rows[some], columns[some]]
    rays = camera.rays((depth.z_m.shape[1], depth.z_m.shape[0]))[rows[some], columns[some]]
    # Depth errs along the ray, which meets the floor at a low angle: the foot of a wall is farther off than noise.
    slope = -(rays @ floor.up)
    off = z * slope - (floor.height_m if floor.above_top_m is None else floor.above_top_m)
    on = np.abs(off) < 0.005 + 3 * TYPICAL.sigma_m(z) * np.abs(slope)
    if on.sum() < _LEVELS * _LEVELS:
        return TYPICAL
    along, z = np.abs(off[on]) / np.maximum(slope[on], 1e-6), z[on]
    edges = np.quantile(z, np.linspace(0, 1, _LEVELS + 1))
    bins = [(z >= low) & (z <= high) for low, high in itertools.pairwise(edges)]
    spread = np.array([1.4826 * np.median(along[one]) for one in bins])
    middle = np.array([np.median(z[one]) for one in bins])
    (base, growth), *_ = np.linalg.lstsq(np.stack([np.ones_like(middle), middle**2], axis=1), spread, rcond=None)
    # Files round to a millimetre.
    return Noise(max(float(base), 0.001), min(max(float(growth), 0.0), 0.01))
