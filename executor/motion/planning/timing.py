"""When to be where: time along a path under joint speed limits, with smooth start and stop."""

from __future__ import annotations

import numpy as np

from executor.geometry import Array

SPEED_LIMITS = np.array([0.5, 0.5, 1.0] + [1.2] * 7)
"""m/s for the base, rad/s for its yaw and the arm."""

RAMP_S = 0.35


def time_path(path: Array, dt_s: float, speed: float = 1.0) -> tuple[Array, Array]:
    """Returns positions and velocities, one row a control tick, along a path.

    The path is followed at the highest speed that no joint limit forbids, with a constant acceleration over the first
    and last 0.35 s.

    Args:
        path: (N, 10) waypoints, the first one being where the robot stands.
        dt_s: Length of a control tick.
        speed: Fraction of the speed limits to use.

    Returns:
        (T, 10) positions and (T, 10) velocities in rad/s or m/s; T = 0 for a path that goes nowhere.
    """
    lengths = np.max(np.abs(np.diff(path, axis=0)) / (SPEED_LIMITS * speed), axis=1)
    knots = np.concatenate([[0.0], np.cumsum(lengths)])
    total_s = float(knots[-1])
    if total_s < 1e-6:
        return np.empty((0, path.shape[1])), np.empty((0, path.shape[1]))
    ramp_s = RAMP_S
    peak = 1.0
    if total_s < ramp_s:
        # Too short to reach full speed: a triangle whose two ramps cover the way.
        peak = total_s / ramp_s
    duration_s = total_s / peak + ramp_s
    t = np.arange(1, int(np.ceil(duration_s / dt_s)) + 1) * dt_s
    t = np.minimum(t, duration_s)
    rate = peak / ramp_s
    rising = 0.5 * rate * t**2
    cruising = 0.5 * rate * ramp_s**2 + peak * (t - ramp_s)
    falling = total_s - 0.5 * rate * (duration_s - t) ** 2
    along = np.where(t < ramp_s, rising, np.where(t < duration_s - ramp_s, cruising, falling))
    along = np.clip(along, 0.0, total_s)
    positions = np.stack([np.interp(along, knots, path[:, j]) for j in range(path.shape[1])], axis=1)
    velocities = np.diff(np.concatenate([path[:1], positions]), axis=0) / dt_s
    return positions, velocities
