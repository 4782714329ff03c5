"""What was seen, in the level frame: a ray and a depth for every pixel, each with its uncertainty."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt

from executor.geometry import Array
from executor.machine.extras import require
from executor.photo.inputs.camera import Intrinsics


@dataclass(frozen=True)
class Noise:
    """Standard deviation of depth: `base_m` close by, growing by `growth_per_m` times the square of the depth."""

    base_m: float
    growth_per_m: float

    def sigma_m(self, z_m: Array) -> Array:
        """Returns the standard deviation at some depths."""
        return np.asarray(self.base_m + self.growth_per_m * z_m**2)

    def to_json(self) -> dict[str, object]:
        """Returns it as plain data."""
        return {"base_m": self.base_m, "growth_per_m": self.growth_per_m}


TYPICAL = Noise(0.002, 0.0018)
"""Of structured-light and stereo cameras for rooms; what is assumed until the floor has been measured."""

_NEARER_M = 0.08


@dataclass(frozen=True)
class Observation:
    """A picture with depth in the level frame.

    Attributes:
        rgb: (H, W, 3) uint8.
        z_m: (H, W) depth along the camera's axis, 0 where nothing was measured.
        rays: (H, W, 3) in the level frame; a point is the eye plus depth times ray.
        eye_m: (3,) the camera: on the z axis of the level frame.
        R_camera_level: (3, 3) level to camera.
        noise: Of the depth.
        K: The camera's intrinsics.
        bend_share: How far off depths slowly go over the picture, as a share of themselves, see `Depth`.
        heading_rad: Without depth, or where it is bent, one of the directions in which most lines of the room go, up
            to quarter turns.
        sight_first: Whether colours and edges tell places though there are depths.
    """

    rgb: NDArray[np.uint8]
    z_m: Array
    rays: Array
    eye_m: Array
    R_camera_level: Array
    noise: Noise
    K: Intrinsics
    heading_rad: float | None = None
    bend_share: float = 0.0
    sight_first: bool = False

    @property
    def size_px(self) -> tuple[int, int]:
        """Width and height."""
        return self.z_m.shape[1], self.z_m.shape[0]

    @cached_property
    def has_depth(self) -> bool:
        """Whether anything was measured; else the picture is all there is."""
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
    def is_exact(self) -> bool:
        """Whether depths tell places better than colours and edges do: there are some, and they are not bent."""
        return self.has_depth and not self.bend_share

    @property
    def by_sight(self) -> bool:
        """Whether colours and edges tell places."""
        return self.sight_first or not self.has_depth

    @cached_property
    def edge_strength(self) -> tuple[Array, Array]:
        """(H, W) how much the picture differs to the right, and below, see `edge_strength`."""
        return edge_strength(self.rgb)

    @property
    def bent_m(self) -> Array:
        """(H, W) standard deviation of each depth with all that it is bent by."""
        return np.hypot(self.sigma_m, self.bend_share * self.z_m)

    @property
    def floor_z_m(self) -> Array:
        """(H, W) depth that the floor has, infinite above the horizon."""
        down = -self.rays[..., 2]
        return np.where(down > 1e-6, self.eye_m[2] / np.maximum(down, 1e-6), np.inf)

    def pixels(self, points_m: Array) -> Array:
        """Returns (N, 2) the pixels of points (N, 3) of the level frame; nan behind the camera."""
        seen = (np.atleast_2d(points_m) - self.eye_m) @ self.R_camera_level.T
        depth = np.where(seen[:, 2] > 1e-6, seen[:, 2], np.nan)
        u = self.K.fx * seen[:, 0] / depth + self.K.cx
        v = self.K.fy * seen[:, 1] / depth + self.K.cy
        return np.stack([u, v], axis=1)

    def bounds_px(self, points_m: Array) -> tuple[Array, Array]:
        """Returns the least and the most u and v of what points (N, 3) enclose and the picture shows.

        They are those of the points themselves where none of that is in the picture, nan where one is behind it.
        """
        pixels = self.pixels(points_m)
        low, high = pixels.min(axis=0), pixels.max(axis=0)
        if np.isnan(low).any() or ((low >= 0.0).all() and (high <= self.size_px).all()):
            return low, high
        geometry = require("shapely.geometry", "photo")
        shown = geometry.MultiPoint(pixels).convex_hull.intersection(geometry.box(0.0, 0.0, *self.size_px))
        return (low, high) if shown.is_empty else (np.array(shown.bounds[:2]), np.array(shown.bounds[2:]))

    @cached_property
    def edges(self) -> NDArray[np.bool_]:
        """(H, W) where depth jumps to a neighbour by more than noise does, or was not measured."""
        return self._jumps(self.z_m)

    @cached_property
    def measured_edges(self) -> NDArray[np.bool_]:
        """(H, W) where depth jumps to a neighbour; where none was measured, the nearest counts: holes are no edges."""
        nearest = distance_transform_edt(~self.measured, return_distances=False, return_indices=True)
        return self._jumps(self.z_m[tuple(nearest)])

    def _jumps(self, z_m: Array) -> NDArray[np.bool_]:
        jump = 0.04 + 4.0 * self.noise.sigma_m(z_m)
        across = np.abs(np.diff(z_m, axis=1, append=z_m[:, -1:])) > jump
        down = np.abs(np.diff(z_m, axis=0, append=z_m[-1:])) > jump
        return np.asarray(across | down)


def is_hidden(seen: Observation, depth_m: Array) -> NDArray[np.bool_]:
    """Return (H, W) where something clearly nearer than a depth picture (H, W) was measured."""
    return np.asarray(seen.measured & (seen.z_m < depth_m - _NEARER_M - 4.0 * seen.bent_m))


def edge_strength(rgb: NDArray[np.uint8]) -> tuple[Array, Array]:
    """Returns (H, W) how much each pixel of a picture differs from those to its right, and from those below, 0 to 1."""
    light = rgb.astype(np.float32) / 255.0
    across, down = np.zeros(rgb.shape[:2]), np.zeros(rgb.shape[:2])
    # Over two pixels each way, as edges are mostly that wide.
    across[:, 1:-2] = np.abs(light[:, 3:] + light[:, 2:-1] - light[:, 1:-2] - light[:, :-3]).max(axis=2) / 2
    down[1:-2] = np.abs(light[3:] + light[2:-1] - light[1:-2] - light[:-3]).max(axis=2) / 2
    return across, down
