"""What room there is: where the target's corners and its door's hinge are, and how far it is to the nearest things.

A door turns about the edge that is farther from its handle; of two doors side by side, whose handles are next to each
other, about the edge on its own side. That is read off as things stood when the episode began, and not from a door that
stands open by more than 45 degrees, as where a correction may begin. What is beside a thing is in the way of a hand
that comes from there. A thing counts as the box around it, upright and seen from above. The base is held up by whatever
it meets, since furniture stands on the floor and what stands on furniture is within it; a hand by what is as high as
what it takes. Of a door that is open its body alone counts.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from executor.datasets.formats.observations import HANDLE, HANDLES, THING, THINGS

FAR_FROM_BASE_M, FAR_FROM_TARGET_M = 2.0, 0.4
"""What is farther off counts as so far off: rooms are three or four metres wide, and a hand is 0.2 m wide."""

SIDE_BY_SIDE_M, AS_HIGH_M = 0.25, 0.1
"""Handles that are nearer to each other, and as high, are of two doors side by side."""

_LEAST = 1e-9


def surrounding_numbers(agent: NDArray, environment: NDArray, began: NDArray, directions: int) -> NDArray[np.float64]:
    """Returns (N, 10 + 2 * directions): corners and hinge of the first thing, and two rounds of distances, in m.

    The four corners (x, y from the base) are those of the box around it, in the order of its own axes. The hinge (x, y
    from the base) is that of the first handle's door; of what has no handle, one of the corners. The first round
    is from the middle of the base to the nearest thing; 0 inside one. The second is from where a hand takes the first
    thing, to others that are as high. Either begins in the direction of the base and goes counter-clockwise, evenly.

    Args:
        agent: (N, AGENT) the robot, as `executor.datasets.formats.observations` has it.
        environment: (N, ENVIRONMENT) what is around it.
        began: (ENVIRONMENT,) what was around it when the policy began.
        directions: How many.
    """
    things = _things(environment)
    there = things[..., 0] > 0.0
    base_m, yaw_rad = np.asarray(agent[:, :2], float), np.asarray(agent[:, 2], float)
    site_m = things[:, 0, 11:14]
    as_high = np.abs(things[..., 3] - site_m[:, 2:]) < things[..., 10] / 2
    as_high[:, 0] = False
    return np.concatenate(
        [
            _corners_m(things[:, 0], base_m, yaw_rad),
            _turned(hinge_m(began) - base_m, -yaw_rad),
            _distances_m(things, there, base_m, yaw_rad, directions, FAR_FROM_BASE_M),
            _distances_m(things, there & as_high, site_m[:, :2], yaw_rad, directions, FAR_FROM_TARGET_M),
        ],
        axis=1,
    )


def hinge_m(environment: NDArray) -> NDArray[np.float64]:
    """Returns (2,) where in the room the door of the first handle turns about, as it stands shut.

    Args:
        environment: (ENVIRONMENT,) what is there.
    """
    thing = _things(environment[None])[0, :1]
    yaw = _yaws_rad(thing[:, None], thing[:, :1] > 0.0)[0]
    half_m = thing[0, 8:10] / 2
    handles = np.asarray(environment[THINGS * THING :], float).reshape(HANDLES, HANDLE)
    bars_m = _turned(handles[:, 3:5] - thing[0, 1:3], -yaw)
    front = int(np.argmax(np.abs(bars_m[0]) / np.maximum(half_m, _LEAST)))
    beside = 1 - front
    next_to = (handles[:, 0] > 0.0) & (np.abs(handles[:, 5] - handles[0, 5]) < AS_HIGH_M)
    next_to &= np.linalg.norm(bars_m - bars_m[0], axis=1) < SIDE_BY_SIDE_M
    next_to[0] = False
    other = bars_m[next_to.argmax()] - bars_m[0] if next_to.any() else bars_m[0]
    found = np.empty(2)
    found[front] = np.copysign(half_m[front], bars_m[0, front])
    found[beside] = -np.copysign(half_m[beside], other[beside])
    return _turned(found, yaw[0]) + thing[0, 1:3]


def _corners_m(thing: NDArray, base_m: NDArray, yaw_rad: NDArray) -> NDArray[np.float64]:
    """Returns (N, 8) the corners of things (N, THING) on the floor, from the base."""
    yaw = _yaws_rad(thing[:, None], thing[:, :1] > 0.0)[:, 0]
    signs = np.array([(1.0, 1.0), (1.0, -1.0), (-1.0, -1.0), (-1.0, 1.0)])
    corners_m = _turned(signs * thing[:, None, 8:10] / 2, yaw[:, None]) + thing[:, None, 1:3] - base_m[:, None]
    return _turned(corners_m, -yaw_rad[:, None]).reshape(len(thing), 8)


def _turned(vectors: NDArray, yaw_rad: NDArray) -> NDArray[np.float64]:
    """Returns vectors (..., 2), turned by angles (...)."""
    cosine, sine = np.cos(yaw_rad), np.sin(yaw_rad)
    x, y = np.moveaxis(vectors, -1, 0)
    return np.stack([cosine * x - sine * y, sine * x + cosine * y], axis=-1)


def _yaws_rad(things: NDArray, counts: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Returns (N, K) headings of the first axes of things (N, K, THING); 0 of those that do not count."""
    quaternions = np.where(counts[..., None], things[..., 4:8], [0.0, 0.0, 0.0, 1.0])
    ahead = Rotation.from_quat(quaternions.reshape(-1, 4)).as_matrix()[:, :2, 0].reshape(*counts.shape, 2)
    return np.arctan2(ahead[..., 1], ahead[..., 0])


def _things(environment: NDArray) -> NDArray[np.float64]:
    return np.asarray(environment[:, : THINGS * THING], float).reshape(len(environment), THINGS, THING)


def _distances_m(
    things: NDArray, counts: NDArray[np.bool_], from_m: NDArray, yaw_rad: NDArray, directions: int, farthest_m: float
) -> NDArray[np.float64]:
    """Returns (N, directions) how far boxes are off along rays on the floor.

    Args:
        things: (N, THINGS, THING).
        counts: (N, THINGS) which of them are seen.
        from_m: (N, 2) where the rays begin.
        yaw_rad: (N,) heading of the first.
        directions: How many rays.
        farthest_m: The most that is told.
    """
    # In the axes of each box.
    yaw = _yaws_rad(things, counts)
    start_m = _turned(from_m[:, None] - things[..., 1:3], -yaw)[:, :, None]
    rays = yaw_rad[:, None, None] + 2 * np.pi * np.arange(directions) / directions - yaw[..., None]
    slope = np.stack([np.cos(rays), np.sin(rays)], axis=-1)
    slope = np.where(np.abs(slope) < _LEAST, _LEAST, slope)
    half_m = things[:, :, None, 8:10] / 2
    one, other = (-half_m - start_m) / slope, (half_m - start_m) / slope
    enters_m, leaves_m = np.minimum(one, other).max(axis=-1), np.maximum(one, other).min(axis=-1)
    meets = (enters_m <= leaves_m) & (leaves_m >= 0.0) & counts[..., None]
    return np.where(meets, np.clip(enters_m, 0.0, farthest_m), farthest_m).min(axis=1)
