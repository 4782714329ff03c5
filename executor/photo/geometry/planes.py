"""Level planes of a depth picture, and the vertical that they share.

Inverse depth is linear in the picture on a plane, so that each neighbourhood has its plane by least squares. Floors,
tops and seats are level: of all directions of such planes, the one that most of them share is the vertical.
"""

from __future__ import annotations

import math
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
_CANDIDATES, _ALIKE_RAD = 500, math.radians(4.0)
_GIVEN_RAD = math.radians(12.0)  # Between a given vertical and that of the depth.
_LEVEL_RAD = math.radians(7.0)  # Error of a neighbourhood's direction.
_LEAST_CELLS = 50
_BIN_M, _APART_M, _MOST = 0.01, 0.12, 6  # Heights are counted in bins; planes nearer to each other are one.
_LEAST_PLANE = 0.01  # Of the level cells: less is no plane.
_POINTS, _NEAR_M, _SIGMAS, _ROUNDS = 12000, (0.04, 0.02, 0.01, 0.01), 3.0, 2
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

    def share_in(self, box_px: tuple[float, float, float, float]) -> float:
        """Return the share of it that is inside a box."""
        inside = (self.pixels >= box_px[:2]).all(axis=1) & (self.pixels <= box_px[2:]).all(axis=1)
        return float(inside.mean())


@dataclass(frozen=True)
class LevelPlanes:
    """The level planes of a picture.

    Attributes:
        up: (3,) vertical in the camera's frame.
        planes: The lowest first.
    """

    up: Array
    planes: tuple[LevelPlane, ...]


@dataclass(frozen=True)
class _Cells:
    """The evenly measured cells of a picture that face upwards: N of them.

    Attributes:
        normals: (N, 3) of the planes of their neighbourhoods.
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
        good = known & (uneven < _UNEVEN) & (-normals[..., 1] > math.cos(STEEPEST_RAD))
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
        about: (3,) the vertical as people give it, which is within some degrees.
    """
    rays = camera.rays((depth.z_m.shape[1], depth.z_m.shape[0]))
    cells = _Cells.of(depth.z_m, rays, camera)
    found = _shared_direction(cells, about)
    if found is None:
        return None
    planes = _planes(cells, found)
    for _ in range(_ROUNDS):
        if not planes:
            break
        found = _refined(depth.z_m, rays, found, [one.height_m for one in planes])
        planes = _planes(cells, found)
    return LevelPlanes(found, tuple(planes)) if planes else None


def _shared_direction(cells: _Cells, about: Array | None) -> Array | None:
    normals = cells.normals if about is None else cells.normals[cells.normals @ about > math.cos(_GIVEN_RAD)]
    if len(normals) < _LEAST_CELLS:
        return None
    tried = normals[np.linspace(0, len(normals) - 1, min(_CANDIDATES, len(normals))).astype(int)]
    alike = (tried @ normals.T > math.cos(_ALIKE_RAD)).sum(axis=1)
    found = tried[int(alike.argmax())]
    for _ in range(4):
        on = normals @ found > math.cos(_ALIKE_RAD)
        found = np.median(normals[on], axis=0)
        found = found / np.linalg.norm(found)
    return found if alike.max() >= _LEAST_CELLS else None


def _planes(cells: _Cells, up: Array) -> list[LevelPlane]:
    """Return the planes across a vertical, the lowest first."""
    level = cells.normals @ up > math.cos(_LEVEL_RAD)
    heights, area, pixels = -(cells.points_m[level] @ up), cells.area_m2[level], cells.pixels[level]
    left = heights > _NEAREST_M
    found: list[LevelPlane] = []
    while left.sum() > max(_LEAST_CELLS, _LEAST_PLANE * len(left)) and len(found) < _MOST:
        counts, edges = np.histogram(heights[left], np.arange(_NEAREST_M, _FARTHEST_M, _BIN_M))
        best = int(gaussian_filter1d(counts.astype(float), 2.0).argmax())
        on = left & (np.abs(heights - (edges[best] + _BIN_M / 2)) < _APART_M / 2)
        if on.sum() > max(_LEAST_CELLS, _LEAST_PLANE * len(left)):
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

        def error(values: Array, on: NDArray[np.bool_] = on, of: NDArray[np.intp] = of) -> Array:
            slope = -(ray[on] @ Rotation.from_rotvec(values[:3]).apply(up))
            return np.asarray((z[on] - values[3:][of[on]] / np.maximum(slope, 1e-3)) / sigma[on])

        if on.sum() < _LEAST_CELLS:
            break
        fitted = least_squares(error, [*turned.as_rotvec(), *heights], loss="cauchy", max_nfev=8).x
        turned, heights = Rotation.from_rotvec(fitted[:3]), fitted[3:]
    return np.asarray(turned.apply(up))
