"""How a scene is looked at, drawn from a seed: its light, and cameras a little off from where they are mounted."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from executor.assets.model import Vector
from executor.geometry import transform
from executor.pictures.backdrop import TINTS, drawn_surroundings
from executor.pictures.cameras import Camera
from executor.pictures.overview import stands_free
from executor.pictures.stage import DAYLIGHT, Lights
from oag import Scene

# A camera's place (m, each way), its direction (rad, about each axis) and its vertical opening angle (rad): what
# mounting and calibrating leave; the overview is carried from room to room. The wrist's camera has 23 mm to the hand.
_STRAYS = {
    "global": (0.20, math.radians(3.0), math.radians(3.0)),
    "head": (0.02, math.radians(3.0), math.radians(4.0)),
    "wrist": (0.005, math.radians(2.0), math.radians(4.0)),
}
_TRIES = 20


def drawn_lights(rng: np.random.Generator) -> Lights:
    """Returns light of a drawn side, height, colour and strength, and what is around; enough to see by in any case."""
    azimuth, height = rng.uniform(-math.pi, math.pi), math.radians(rng.uniform(45.0, 78.0))
    beside, fill_height = azimuth + math.pi + rng.uniform(-1.0, 1.0), math.radians(rng.uniform(20.0, 50.0))
    warmth = rng.uniform(-0.12, 0.12)  # From a cloudy noon to lamps.
    tint = np.array([1.0 + warmth, 1.0, 1.0 - warmth])
    sun, fill, ambient = rng.uniform(0.6, 1.25), rng.uniform(0.5, 1.5), rng.uniform(0.7, 1.4)
    surroundings, panorama = drawn_surroundings(rng)
    return Lights(
        ambient=_color(np.multiply(DAYLIGHT.ambient, ambient) * TINTS[surroundings]),
        sun_direction=_from(azimuth, height),
        sun_color=_color(np.multiply(DAYLIGHT.sun_color, sun * tint)),
        fill_direction=_from(beside, fill_height),
        fill_color=_color(np.multiply(DAYLIGHT.fill_color, fill * tint[::-1])),
        surroundings=surroundings,
        panorama=panorama,
    )


def strayed_cameras(rng: np.random.Generator, cameras: Iterable[Camera], scene: Scene) -> tuple[Camera, ...]:
    """Returns cameras near where they were, opened a little more or less; one that stands still stays clear of all.

    Args:
        rng: Draws them; each camera has draws of its own, so that it does not matter which others there are.
        cameras: Where they were.
        scene: The concrete scene.
    """
    base = int(rng.integers(2**62))
    return tuple(_strayed(np.random.default_rng((base, *camera.name.encode())), camera, scene) for camera in cameras)


def _strayed(rng: np.random.Generator, camera: Camera, scene: Scene) -> Camera:
    place_m, turn_rad, fov_rad = _STRAYS[camera.name]
    for _ in range(_TRIES):
        turn = Rotation.from_rotvec(rng.uniform(-turn_rad, turn_rad, 3)).as_matrix()
        T = camera.T_mount_camera @ transform(turn, rng.uniform(-place_m, place_m, 3))
        found = replace(camera, T_mount_camera=T, fov_y_rad=camera.fov_y_rad + float(rng.uniform(-fov_rad, fov_rad)))
        if camera.mount is not None or stands_free(scene, T[:3, 3]):
            return found
    return camera


def _from(azimuth_rad: float, height_rad: float) -> Vector:
    across = math.cos(height_rad)
    return (across * math.cos(azimuth_rad), across * math.sin(azimuth_rad), -math.sin(height_rad))


def _color(values: np.ndarray) -> Vector:
    r, g, b = (round(float(value), 4) for value in values)
    return (r, g, b)
