"""Level planes of a depth picture, and the vertical that they share with walls and fronts.

Inverse depth is linear in the picture on a plane, so that each neighbourhood has its plane by least squares. Floors,
tops and seats are level, walls and fronts upright: of the three square directions that most neighbourhoods face, the
vertical is the one that is nearest to upwards in the picture. Walls so level a noisy picture with little floor.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d, uniform_filter
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from executor.geometry import Array
from executor.photo.inputs.depth import Depth
from executor.photo.inputs.picture import Intrinsics

STEEPEST_RAD = math.radians(70.0)
"""Largest angle between the vertical and the picture's upward direction."""

_CELLS, _WINDOW = 160, 7  # Along the longer side; cells of a neighbourhood.
_LEAST_SHARE, _UNEVEN = 0.5, 0.012  # Of a cell that is measured; of the depth, by which a neighbourhood is uneven.
_NEAREST_M, _FARTHEST_M = 0.1, 7.0  # Beyond that, noise makes every plane as good.
_COUNTED, _CANDIDATES, _DIRECTIONS = 3000, 400, 8  # Cells that are counted; second and first directions of frames.
_ALIKE_RAD, _SQUARE_RAD = math.radians(4.0), math.radians(6.0)
_ASIDE = math.sin(math.radians(75.0))  # A second direction is about square to the first one.
_GIVEN_RAD = math.radians(12.0)  # Between a given vertical and that of the depth.
_LEVEL_RAD = (math.radians(7.0), math.radians(15.0))  # Error of a neighbourhood's direction, and if noise is strong.
_OF_TOP, _CARRIED = 0.6, 2  # Share of a table's own cells that its top has; boxes in that of the table.
_BEHIND_M = 0.02  # A front: what is on a piece of furniture is behind that, and before the top that it is on.
_ACROSS, _COLUMNS = 0.9, 40  # Share of so many columns of the picture, in which a wall behind a floor is seen.
_OF_EACH_WALL, _OF_WALLS = 0.05, 0.5  # Shares of all cells: upright ones of one direction, and of both.
_LEAST_CELLS, _LEAST_OF_PLANE, _LARGE_M2 = 50, (50, 20), 0.1
_BIN_M, _APART_M, _MOST = 0.01, 0.12, 6  # Heights are counted in bins; planes nearer to each other are one.
_LEAST_PLANE = 0.01  # Of the level cells: less is no plane.
_POINTS, _NEAR_M, _SIGMAS, _ROUNDS = 12000, (0.04, 0.02, 0.01, 0.01), 3.0, 2
_INDEPENDENT, _SQUARED_RAD = 20.0, math.radians(1.0)  # Points whose errors are apart; error of the square directions.
Box = tuple[float, float, float, float]
_TYPICAL = (0.002, 0.0018)  # Noise of depth cameras for rooms: near [m], and by the square of the depth [1/m].


@dataclass(frozen=True)
class LevelPlane:
    """One level plane.

    Attributes:
        height_m: Of the camera above it.
        area_m2: Visible area.
        residual_m: Median distance of its cells from it.
        pixels: (N, 2) middles of the cells of the picture in which it is visible.
    """

    height_m: float
    area_m2: float
    residual_m: float
    pixels: Array

    def share_in(self, box_px: Box) -> float:
        """Return the share of it that is inside a box."""
        return float(_in_box(self.pixels, box_px).mean())


@dataclass(frozen=True)
class LevelPlanes:
    """The level planes of a picture.

    Attributes:
        up: (3,) vertical in the camera's frame.
        planes: The lowest first.
        deepest_m: How far below the camera the lowest hundredth of what was measured begins.
        is_walled: Whether an upright plane ends the lowest one across the picture.
    """

    up: Array
    planes: tuple[LevelPlane, ...]
    deepest_m: float = math.inf
    is_walled: bool = False

    @property
    def area_m2(self) -> float:
        """Visible area of all of them."""
        return sum(one.area_m2 for one in self.planes)


@dataclass(frozen=True)
class _Cells:
    """The evenly measured cells of a picture: N of them.

    Attributes:
        normals: (N, 3) of the planes of their neighbourhoods, towards the camera.
        points_m: (N, 3) in the camera's frame.
        area_m2: (N,) of their surface.
        pixels: (N, 2) their middles.
    """

    normals: Array
    points_m: Array
    area_m2: Array
    pixels: Array

    @classmethod
    def of(cls, z_m: Array, rays: Array, camera: Intrinsics) -> _Cells:
        side = max(1, round(max(z_m.shape) / _CELLS))
        rows, columns = z_m.shape[0] // side, z_m.shape[1] // side

        def total(values: Array) -> Array:
            return np.asarray(
                values[: rows * side, : columns * side].reshape(rows, side, columns, side).sum(axis=(1, 3))
            )

        near = (z_m > 0.0) & (z_m < _FARTHEST_M)
        count = total(near.astype(float))
        inverse = total(np.where(near, 1.0 / np.maximum(z_m, _NEAREST_M), 0.0)) / np.maximum(count, 1.0)
        ray = np.stack([total(rays[..., axis]) / side**2 for axis in range(3)], axis=-1)
        known = count >= _LEAST_SHARE * side**2
        planes, uneven = _neighbourhoods(inverse, ray, known)
        size = np.maximum(np.linalg.norm(planes, axis=-1), 1e-9)
        normals = -planes / size[..., None]
        good = known & (uneven < _UNEVEN)
        z = 1.0 / np.maximum(inverse[good], 1e-6)
        slope = np.maximum(-(normals[good] * ray[good]).sum(axis=1), 1e-3)
        v, u = np.nonzero(good)
        middles = side * (np.stack([u, v], axis=1) + 0.5)
        return cls(normals[good], ray[good] * z[:, None], (side * z) ** 2 / (camera.fx * camera.fy * slope), middles)


def _neighbourhoods(inverse: Array, ray: Array, known: NDArray[np.bool_]) -> tuple[Array, Array]:
    """Return (h, w, 3) the linear inverse depth about each cell, and (h, w) how uneven it is, as a share."""
    weight = known.astype(float)

    def mean(values: Array) -> Array:
        return np.asarray(uniform_filter(values * weight, _WINDOW, mode="constant"))

    sides, target = np.empty((*known.shape, 3, 3)), np.empty((*known.shape, 3))
    for i in range(3):
        target[..., i] = mean(ray[..., i] * inverse)
        for j in range(i, 3):
            sides[..., i, j] = sides[..., j, i] = mean(ray[..., i] * ray[..., j])
    planes = np.asarray(np.linalg.solve(sides + 1e-9 * np.eye(3), target[..., None])[..., 0], dtype=float)
    off = np.maximum(mean(inverse**2) - (planes * target).sum(axis=-1), 0.0) / np.maximum(mean(weight), 1e-9)
    return planes, np.sqrt(off) / np.maximum(inverse, 1e-6)


def level_planes(depth: Depth, camera: Intrinsics, about: Array | None = None) -> LevelPlanes | None:
    """Return the level planes of a picture; None where nothing level is visible.

    Args:
        depth, camera: The input.
        about: (3,) the vertical as people give it, which is within some degrees; by default upwards in the picture.
    """
    rays = camera.rays((depth.z_m.shape[1], depth.z_m.shape[0]))
    cells = _Cells.of(depth.z_m, rays, camera)
    frame = _square_frame(cells.normals, about)
    if frame is None:
        return None
    found = frame[0]
    planes = _planes(cells, found)
    for _ in range(_ROUNDS):
        if not planes:
            break
        found = _refined(depth.z_m, rays, found, [one.height_m for one in planes])
        planes = _planes(cells, found)
    deepest_m = float(np.percentile(-(cells.points_m @ found), 99.0))
    if not planes:
        return None
    is_walled = _is_walled(cells, frame, planes[0].height_m, depth.z_m.shape[1])
    return LevelPlanes(found, tuple(planes), deepest_m, is_walled)


def _is_walled(cells: _Cells, frame: Array, below_m: float, width_px: int) -> bool:
    """Return whether an upright plane ends a level one across the picture: it goes down to that, with nothing behind.

    Args:
        cells: The picture's.
        frame: (3, 3) the square directions, the first of them upwards.
        below_m: How far below the camera the level plane is.
        width_px: Of the picture.
    """
    for side in (*frame[1:], *-frame[1:]):
        faces = cells.normals @ side > math.cos(_LEVEL_RAD[1])
        if faces.sum() < _LEAST_CELLS:
            continue
        # The camera is at the origin, and normals are towards it.
        off_m = cells.points_m @ side
        counts, edges = np.histogram(off_m[faces], np.arange(-_FARTHEST_M, 0.0, _BIN_M))
        wall_m = edges[int(gaussian_filter1d(counts.astype(float), 2.0).argmax())] + _BIN_M / 2
        on = faces & (np.abs(off_m - wall_m) < _APART_M / 2)
        across = np.histogram(cells.pixels[on, 0], _COLUMNS, (0.0, width_px))[0] > 0
        foot_m = float(np.percentile(-(cells.points_m[on] @ frame[0]), 99.0)) if on.any() else 0.0
        behind = float((off_m < wall_m - _APART_M).mean())
        if across.mean() > _ACROSS and abs(below_m - foot_m) < _APART_M and behind < _LEAST_PLANE:
            return True
    return False


def level_by_walls(depth: Depth, camera: Intrinsics, support_px: Box, others_px: Sequence[Box]) -> LevelPlanes | None:
    """Return the top of a support that is seen too flat to be a plane, with the vertical of walls; None if unsure.

    The vertical is that of walls and fronts in two directions. The top is where the boxes of things on it end.

    Args:
        depth, camera: The input.
        support_px: The support's box.
        others_px: Boxes of other things.
    """
    rays = camera.rays((depth.z_m.shape[1], depth.z_m.shape[0]))
    cells = _Cells.of(depth.z_m, rays, camera)
    frame = _square_frame(cells.normals, None, is_level_visible=False)
    if frame is None:
        return None
    faced = (np.abs(cells.normals @ frame[1:].T) > math.cos(_SQUARE_RAD)).mean(axis=0)
    if faced.min() < _OF_EACH_WALL or faced.sum() < _OF_WALLS:
        return None
    ends = np.array([((x0 + x1) / 2, y1) for x0, _, x1, y1 in others_px]).reshape(-1, 2)
    ends = ends[_in_box(ends, support_px)]
    columns, rows = np.minimum(ends.astype(int), np.array(depth.z_m.shape[::-1]) - 1).T
    z, slope = depth.z_m[rows, columns], -(rays[rows, columns] @ frame[0])
    heights = (z * slope)[z > 0.0]
    if len(heights) < _CARRIED:
        return None
    height_m = float(np.median(heights))
    top = LevelPlane(height_m, 0.0, float(np.median(np.abs(heights - height_m))), ends[z > 0.0])
    return LevelPlanes(frame[0], (top,), float(np.percentile(-(cells.points_m @ frame[0]), 99.0)))


def top_direction(depth: Depth, camera: Intrinsics, table_px: Box, others_px: Sequence[Box]) -> Array | None:
    """Return (3,) the direction of a table's top that is seen from above, however the camera is turned; None if unsure.

    The top is the one plane of most of what the table's box shows besides other boxes. Half of these or more, and at
    least two, are on it: by the median of what they show they are not behind that plane.

    Args:
        depth, camera: The input.
        table_px: The table's box.
        others_px: Boxes of other things.
    """
    x0, y0, x1, y1 = table_px
    carried = [box for box in others_px if x0 <= box[0] and y0 <= box[1] and box[2] <= x1 and box[3] <= y1]
    if len(carried) < _CARRIED:
        return None
    cells = _Cells.of(depth.z_m, camera.rays((depth.z_m.shape[1], depth.z_m.shape[0])), camera)
    own = _in_box(cells.pixels, table_px)
    for box in others_px:
        own &= ~_in_box(cells.pixels, box)
    normals = cells.normals[own]
    if len(normals) < _LEAST_CELLS:
        return None
    some = normals[np.linspace(0, len(normals) - 1, min(_CANDIDATES, len(normals))).astype(int)]
    alike = some @ normals.T > math.cos(_LEVEL_RAD[0])
    best = int(alike.mean(axis=1).argmax())
    if alike[best].mean() < _OF_TOP:
        return None
    top = some[best]
    top_m = float(np.median(cells.points_m[own][alike[best]] @ top))
    over = [cells.points_m[_in_box(cells.pixels, box)] @ top - top_m for box in carried]
    standing = sum(len(one) > 0 and float(np.median(one)) > -_BEHIND_M for one in over)
    return np.asarray(top) if standing >= max(_CARRIED, len(carried) / 2) else None


def _in_box(pixels: Array, box_px: Box) -> NDArray[np.bool_]:
    return np.asarray((pixels >= box_px[:2]).all(axis=1) & (pixels <= box_px[2:]).all(axis=1))


def _square_frame(normals: Array, about: Array | None, *, is_level_visible: bool = True) -> Array | None:
    """Return (3, 3) the square directions that most normals (N, 3) face, the first of them upwards; None without any.

    Args:
        normals: Of neighbourhoods.
        about: (3,) the vertical as people give it.
        is_level_visible: Whether floors and tops give the upward direction; else it is nearest to the picture's.
    """
    if len(normals) < _LEAST_CELLS:
        return None
    counted = normals[np.linspace(0, len(normals) - 1, min(_COUNTED, len(normals))).astype(int)]
    tried = counted[np.linspace(0, len(counted) - 1, min(_CANDIDATES, len(counted))).astype(int)]
    alike = (np.abs(tried @ counted.T) > math.cos(_ALIKE_RAD)).sum(axis=1)
    firsts: list[Array] = []
    for index in np.argsort(-alike, kind="stable"):
        if len(firsts) < _DIRECTIONS and all(abs(tried[index] @ one) < math.cos(_SQUARE_RAD) for one in firsts):
            firsts.append(tried[index])
    upwards = np.array([0.0, -1.0, 0.0]) if about is None else about
    least = math.cos(STEEPEST_RAD if about is None else _GIVEN_RAD)
    most, best = 0, None
    for first, second in itertools.product(firsts, [*tried, *np.eye(3)]):
        aside = second - (second @ first) * first
        length = float(np.linalg.norm(aside))
        if length < _ASIDE:
            continue
        frame = np.stack([first, aside / length, np.cross(first, aside / length)])
        frame *= np.sign(frame @ upwards)[:, None]
        along = counted @ frame.T
        count = int((np.abs(along) > math.cos(_SQUARE_RAD)).sum())
        # Of what goes upwards in the picture, floors and tops face that way, and walls the other one.
        level = (along > math.cos(_SQUARE_RAD)).sum(axis=0) if is_level_visible else frame @ upwards
        faced = np.where(frame @ upwards > least, level, 0)
        if count > most and faced.max() > 0:
            most, best = count, np.roll(frame, -int(faced.argmax()), axis=0)
    if best is None:
        return None
    for _ in range(4):
        on = normals @ best.T
        means = np.zeros((3, 3))
        for axis, one in enumerate(on.T):
            faces = np.abs(one) > math.cos(_SQUARE_RAD)
            # Many cells of one plane have its error in common.
            means[axis] = (normals[faces] * np.sign(one[faces, None])).sum(axis=0) / (faces.sum() + _LEAST_CELLS)
        left, _, right = np.linalg.svd(means)
        best = left @ right
    # Where nothing is level, only the two others have a sign.
    return np.asarray(best * np.sign(best[0] @ upwards))


def _planes(cells: _Cells, up: Array) -> list[LevelPlane]:
    """Return the planes across a vertical, the lowest first."""
    found: list[LevelPlane] = []
    for error_rad, least in zip(_LEVEL_RAD, _LEAST_OF_PLANE, strict=True):
        if sum(one.area_m2 for one in found) < _LARGE_M2:
            found = _planes_within(cells, up, error_rad, least)
    return found


def _planes_within(cells: _Cells, up: Array, error_rad: float, least: int) -> list[LevelPlane]:
    level = cells.normals @ up > math.cos(error_rad)
    heights, area, pixels = -(cells.points_m[level] @ up), cells.area_m2[level], cells.pixels[level]
    left = heights > _NEAREST_M
    found: list[LevelPlane] = []
    while left.sum() > max(least, _LEAST_PLANE * len(left)) and len(found) < _MOST:
        counts, edges = np.histogram(heights[left], np.arange(_NEAREST_M, _FARTHEST_M, _BIN_M))
        best = int(gaussian_filter1d(counts.astype(float), 2.0).argmax())
        on = left & (np.abs(heights - (edges[best] + _BIN_M / 2)) < _APART_M / 2)
        if on.sum() > max(least, _LEAST_PLANE * len(left)):
            height_m = float(np.median(heights[on]))
            off_m = float(np.median(np.abs(heights[on] - height_m)))
            found.append(LevelPlane(height_m, float(area[on].sum()), off_m, pixels[on]))
        left &= np.abs(heights - (edges[best] + _BIN_M / 2)) > _APART_M
    return sorted(found, key=lambda one: -one.height_m)


def _refined(z_m: Array, rays: Array, up: Array, heights_m: list[float]) -> Array:
    """Return the vertical for which all planes are level: by the points near them, which err along their rays."""
    rows, columns = np.nonzero((z_m > 0.0) & (z_m < _FARTHEST_M))
    some = np.linspace(0, len(rows) - 1, min(len(rows), _POINTS)).astype(int)
    z, ray = z_m[rows[some], columns[some]], rays[rows[some], columns[some]]
    sigma = _TYPICAL[0] + _TYPICAL[1] * z**2
    heights, turned = np.array(heights_m), Rotation.identity()
    for near_m in _NEAR_M:
        slope = -(ray @ turned.apply(up))
        off = np.abs(z * slope - heights[:, None])
        of = off.argmin(axis=0)
        on = (off[of, np.arange(len(z))] < near_m + _SIGMAS * sigma * slope) & (slope > 0.02)

        weight = math.sqrt(on.sum() / _INDEPENDENT) / _SQUARED_RAD

        def error(
            values: Array, on: NDArray[np.bool_] = on, of: NDArray[np.intp] = of, weight: float = weight
        ) -> Array:
            slope = -(ray[on] @ Rotation.from_rotvec(values[:3]).apply(up))
            off = (z[on] - values[3:][of[on]] / np.maximum(slope, 1e-3)) / sigma[on]
            return np.concatenate([off, weight * values[:3]])

        if on.sum() < _LEAST_CELLS:
            break
        fitted = least_squares(error, [*turned.as_rotvec(), *heights], loss=_cauchy_but_last, max_nfev=8).x
        turned, heights = Rotation.from_rotvec(fitted[:3]), fitted[3:]
    return np.asarray(turned.apply(up))


def _cauchy_but_last(squares: Array) -> Array:
    """Return (3, N) Cauchy's loss of squares (N,) and its derivatives; the last three count as they are."""
    loss = np.stack([np.log1p(squares), 1.0 / (1.0 + squares), -1.0 / (1.0 + squares) ** 2])
    loss[:, -3:] = squares[-3:], np.ones(3), np.zeros(3)
    return loss
