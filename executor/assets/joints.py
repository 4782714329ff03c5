"""Where a moving link is when its joint is somewhere."""

from __future__ import annotations

import math

import numpy as np

from executor.assets.model import Joint
from executor.geometry import Array, transform


def joint_transform(joint: Joint, position: float) -> Array:
    """Returns the (4, 4) pose of a joint's child link in its parent link, at a joint position in rad or m."""
    x, y, z = joint.axis
    if joint.kind == "prismatic":
        return transform(np.eye(3), np.asarray(joint.position_m) + position * np.array([x, y, z]))
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    rotation = np.eye(3) + math.sin(position) * cross + (1.0 - math.cos(position)) * (cross @ cross)
    return transform(rotation, joint.position_m)
