"""A thing as it stands in the room: upright, with a heading, and its front where the library has fronts."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from executor.geometry import Array, rotation_z, wrap_angle
from executor.scenes.cousins.form import Cousin

MOST_TILTED_RAD = math.radians(20.0)


class Tilted(ValueError):
    """None of its own axes is near the vertical."""


@dataclass(frozen=True, slots=True)
class Upright:
    """Where a thing is and which way it faces.

    Attributes:
        centre_m: Middle of its box in the world.
        yaw_rad: Heading of the own x axis of the library's model for it, whose front is at -x.
        size_m: Sides along the model's own x, y and z.
        turned: Whether its front is taken to be the side at its own -y.
    """

    centre_m: tuple[float, float, float]
    yaw_rad: float
    size_m: tuple[float, float, float]
    turned: bool


def upright(cousin: Cousin, camera_m: Array, *, front: bool) -> Upright:
    """Returns how a thing stands.

    The front of a cousin is at its own +x, or at -y for assets that were made so; the file does not say which. Fronts
    are what a photograph shows, so it is +x unless that looks away from the camera and -y looks at it.

    Args:
        cousin: The thing.
        camera_m: Where the camera was, in the world.
        front: Whether it is something with a front, such as a cabinet.

    Raises:
        Tilted: It leans by more than 20 degrees; the message says how much.
    """
    R = cousin.T_world[:3, :3]
    yaw = _yaw(R)
    stood = rotation_z(yaw).T @ R
    tilt = float(np.arccos(min(1.0, float(np.abs(stood[2]).max()))))
    if tilt > MOST_TILTED_RAD:
        raise Tilted(f"leans by {math.degrees(tilt):.0f} degrees")
    # Each own axis counts for the one of the upright frame that it is nearest to, so that a lean adds no length.
    nearest = np.abs(stood).argmax(axis=0)
    size = np.zeros(3)
    np.maximum.at(size, nearest, cousin.extent_m)
    if not size.all():
        raise Tilted("leans sideways")
    x, y, z = (float(value) for value in cousin.T_world[:3, 3])
    length, width, height = (float(value) for value in size)
    towards = np.asarray(camera_m)[:2] - (x, y)
    ahead, right = rotation_z(yaw)[:2, 0], -rotation_z(yaw)[:2, 1]
    turned = front and bool(ahead @ towards < 0.0 < right @ towards)
    if turned:
        return Upright((x, y, z), wrap_angle(yaw + math.pi / 2), (width, length, height), turned)
    return Upright((x, y, z), wrap_angle(yaw + math.pi), (length, width, height), turned)


def _yaw(R: Array) -> float:
    """The turn about the vertical that was applied last; that of the own y axis where x is vertical."""
    if math.hypot(R[0, 0], R[1, 0]) > math.sin(MOST_TILTED_RAD):
        return math.atan2(R[1, 0], R[0, 0])
    return math.atan2(-R[0, 1], R[1, 1])
