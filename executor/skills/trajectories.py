"""Timing of paths: speeds, steps of speed and accelerations that a real base and arm can do; and noise in drive
targets.

A path is followed as fast as the speed limits allow. Before a corner the robot slows down until the step of each
joint's speed there is small; a moving average over a tenth of a second then makes a ramp of the remaining step.
Straight pieces stay where they are. A corner is cut by two millimetres at the most, less than half of the clearance
that planning keeps on free paths.

With noise the robot deviates from its path and returns, while the recorded target is the path. A policy that is trained
without noise does not know how to recover from its own mistakes.

Source of the noise: Laskey et al., "DART: Noise injection for robust imitation learning" (2017). The arm would not
follow white noise; noise with a memory is Uhlenbeck and Ornstein's, here smoothed once more.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np

from executor.geometry import Array
from oag.model.robots import Robot

_SPEEDS = (0.5, 1.0, 0.15, 1.2)  # m/s along the floor, rad/s of yaw, m/s of a lift, rad/s of the arm.
_ACCELERATIONS = (2.5, 5.0, 0.75)
"""m/s2 and rad/s2 of base and lift: what 170 N give the 66 kg of the base. An arm's is in its record."""

STOPS = 2.0
"""Accelerations at the end of a motion that has to end at once: about what the 350 N of the base give its 66 kg and the
arm on it."""

RAMP_S = 0.35  # From rest to full speed, and back.
BLEND_S = 0.1  # Of the moving average.
_CORNER_STEPS = (0.08, 0.16, 0.05, 0.24)
"""By how much a speed may change at a corner, in m/s and rad/s: with BLEND_S, 0.8 m/s2, 1.6 and 2.4 rad/s2."""


def _of_joints(robot: Robot, kinds: tuple[float, float, float, float]) -> Array:
    """Return (Q,) a number for each joint of base and arm: along the floor, of yaw, of a lift, of the arm."""
    floor, yaw, lift, arm = kinds
    lifts = [lift] * (len(robot.base_joints) - 3)
    found = np.array([floor, floor, yaw, *lifts] + [arm] * len(robot.arm_joints))
    found.setflags(write=False)  # Some are cached.
    return found


@cache
def speed_limits(robot: Robot) -> Array:
    """Return (Q,) the speed limits of base and arm, m/s and rad/s."""
    return _of_joints(robot, _SPEEDS)


@cache
def acceleration_limits(robot: Robot) -> Array:
    """Return (Q,) the acceleration limits of base and arm, m/s2 and rad/s2; twice these at the end of a motion that has
    to end at once."""
    return _of_joints(robot, (*_ACCELERATIONS, robot.acceleration_rad_s2))


@cache
def corner_steps(robot: Robot) -> Array:
    """Return (Q,) by how much the speeds of base and arm may change at a corner, m/s and rad/s."""
    return _of_joints(robot, _CORNER_STEPS)


_SHORTEST_S = 1e-6  # At full speed; less is nowhere.
_SLOWER, _ROUNDS = 1.02, 40  # Many corners one after the other add up; each round checks again.


def time_path(robot: Robot, path: Array, dt_s: float, speed: float = 1.0) -> tuple[Array, Array]:
    """Return positions and velocities, one row a control tick, along a path.

    Args:
        robot: Its record.
        path: (N, Q) waypoints, the first one being where the robot stands.
        dt_s: Length of a control tick.
        speed: Fraction of the speed limits to use.

    Returns:
        (T, Q) positions and (T, Q) velocities in rad/s or m/s, both ending at rest at the path's end, no speed or
        acceleration beyond its limit; T = 0 for a path that goes nowhere.
    """
    most = acceleration_limits(robot)
    for _ in range(_ROUNDS):
        positions = _blended(path[0], _sampled(robot, path, dt_s, speed), dt_s)
        velocities = np.diff(np.concatenate([path[:1], positions]), axis=0) / dt_s
        if not len(positions):
            break
        accelerations = np.diff(np.concatenate([np.zeros((1, path.shape[1])), velocities]), axis=0) / dt_s
        excess = float((np.abs(accelerations) / most).max())
        if excess <= 1.0:
            break
        speed /= max(np.sqrt(excess), _SLOWER)
    return positions, velocities


def stop_path(robot: Robot, position: Array, velocity: Array, dt_s: float) -> tuple[Array, Array]:
    """Return positions and velocities, one row a control tick, that end a motion evenly and as soon as possible.

    Args:
        robot: Its record.
        position: (Q,) last commanded position.
        velocity: (Q,) commanded velocity there.
        dt_s: Length of a control tick.

    Returns:
        (T, Q) each, straight on from there; T = 0 for a robot that stood.
    """
    duration_s = float((np.abs(velocity) / (STOPS * acceleration_limits(robot))).max())
    times = np.minimum(np.arange(1, int(np.ceil(duration_s / dt_s)) + 1) * dt_s, duration_s)[:, None]
    left = 1.0 - times / duration_s
    return position + velocity * times * (1.0 + left) / 2, velocity * left


def _sampled(robot: Robot, path: Array, dt_s: float, speed: float) -> Array:
    """Return (T, J) where the robot is at each tick, slowed down at the corners and not yet blended; T may be 0."""
    ways = np.diff(path, axis=0)
    lengths = np.max(np.abs(ways) / (speed_limits(robot) * speed), axis=1)
    moving = lengths > _SHORTEST_S
    ways, lengths = ways[moving], lengths[moving]
    if not len(lengths):
        return np.empty((0, path.shape[1]))
    most = corner_steps(robot)
    steps = np.abs(np.diff(ways / lengths[:, None], axis=0))
    rates = np.concatenate([[0.0], np.min(most / np.maximum(steps, most), axis=1), [0.0]])
    # Of full speed, that is; no knot may be passed faster than slowing down to, or speeding up from, another allows.
    for k in range(len(lengths)):
        rates[k + 1] = min(rates[k + 1], np.sqrt(rates[k] ** 2 + 2 * lengths[k] / RAMP_S))
    for k in reversed(range(len(lengths))):
        rates[k] = min(rates[k], np.sqrt(rates[k + 1] ** 2 + 2 * lengths[k] / RAMP_S))
    along = _along(lengths, rates, dt_s)
    knots = np.concatenate([[0.0], np.cumsum(lengths)])
    corners = np.concatenate([path[:1], path[:1] + np.cumsum(ways, axis=0)])
    corners[-1] = path[-1]
    return np.stack([np.interp(along, knots, corners[:, j]) for j in range(path.shape[1])], axis=1)


def _along(lengths: Array, rates: Array, dt_s: float) -> Array:
    """Return (T,) how far along the robot is at each tick, in seconds at full speed.

    Each piece has an acceleration, an even rate, and a deceleration.

    Args:
        lengths: (N,) of the pieces, in seconds at full speed.
        rates: (N + 1,) of full speed, at the pieces' ends.
        dt_s: Length of a tick.
    """
    before, after = rates[:-1], rates[1:]
    top = np.minimum(np.sqrt((before**2 + after**2) / 2 + lengths / RAMP_S), 1.0)
    rising_s, falling_s = (top - before) * RAMP_S, (top - after) * RAMP_S
    covered = (before + top) / 2 * rising_s + (after + top) / 2 * falling_s
    even_s = np.maximum(lengths - covered, 0.0) / top
    # Where an acceleration begins or ends: when, how far along by then, how fast there.
    times = np.cumsum(np.stack([rising_s, even_s, falling_s], axis=1).ravel())
    starts = np.concatenate([[0.0], np.cumsum(lengths)[:-1]])
    rise, fall = starts + (before + top) / 2 * rising_s, starts + lengths - (after + top) / 2 * falling_s
    places = np.concatenate([[0.0], np.stack([rise, fall, starts + lengths], axis=1).ravel()])
    speeds = np.concatenate([[0.0], np.stack([top, top, after], axis=1).ravel()])
    times = np.concatenate([[0.0], times])
    ticks = np.minimum(np.arange(1, int(np.ceil(times[-1] / dt_s)) + 1) * dt_s, times[-1])
    k = np.clip(np.searchsorted(times, ticks, side="right") - 1, 0, len(times) - 2)
    since, lasts = ticks - times[k], np.maximum(times[k + 1] - times[k], 1e-12)
    gone = places[k] + speeds[k] * since + (speeds[k + 1] - speeds[k]) / lasts * since**2 / 2
    return np.clip(gone, 0.0, places[-1])


def _blended(start: Array, positions: Array, dt_s: float) -> Array:
    """Return (T + W - 1, J) the moving average over W ticks, at rest at the start before and at the end after them."""
    if not len(positions):
        return positions
    width = max(round(BLEND_S / dt_s), 1)
    held = np.concatenate([np.tile(start, (width, 1)), positions, np.tile(positions[-1], (width - 1, 1))])
    sums = np.cumsum(held - positions[-1], axis=0)
    return np.asarray(positions[-1] + (sums[width:] - sums[:-width]) / width)


RAD_PER_M = 2.0
"""Noise in a joint or the base's heading for that in the base's place: each moves the hand about as far."""

MEMORY_S = 0.4
"""Correlation time: the base and the arm can follow it, and it changes within a motion of a second."""

MOST = 2.0  # Standard deviations; what goes beyond is cut off, so that limits can be widened by it.
_FULL_FROM = 0.8  # Of the speed limit of any joint; slower, as near things, it is less, and at rest it is gone.
_FADES_S = 0.5  # Before a motion's end: the base needs that long to be back where a grasp was planned from.
_OVERSHOOT = 1.5  # The drives lag, and overshoot.
_GRIPPING = 0.25  # More would tear a grip open, or move a door off its circle.


@dataclass(frozen=True, slots=True)
class CommandNoise:
    """How much noise an episode has.

    Attributes:
        deviation_m: Standard deviation for the base along x and y; `RAD_PER_M` of it for every angle.
        seed: Equal seeds give equal noise.
    """

    deviation_m: float = 0.0
    seed: int = 0

    def of_subtask(self, robot: Robot, subtask: int, dt_s: float) -> NoiseStream | None:
        """Return the noise of a subtask, the same in every run of it; None where there is none.

        Args:
            robot: Its record.
            dt_s: Length of a physics step.
        """
        return (
            NoiseStream(robot, self.deviation_m, np.random.default_rng((self.seed, subtask)), dt_s)
            if self.deviation_m
            else None
        )


NO_NOISE = CommandNoise()


class NoiseStream:
    """Noise, physics step by physics step.

    Args:
        robot: Its record.
        deviation_m: As in `CommandNoise`.
        rng: Samples it.
        dt_s: Length of a physics step.

    Attributes:
        max_offset_m: Largest deviation of the base from its path by noise, along x or y.
    """

    def __init__(self, robot: Robot, deviation_m: float, rng: np.random.Generator, dt_s: float) -> None:
        self.max_offset_m = _OVERSHOOT * MOST * deviation_m
        self._limits = speed_limits(robot)
        self._scale = deviation_m * _of_joints(robot, (1.0, RAD_PER_M, 0.0, RAD_PER_M))
        self._rng = rng
        self._keeps = float(np.exp(-dt_s / MEMORY_S))
        # So that the smoothed process has a variance of 1.
        self._gain = (1.0 + self._keeps) / float(np.sqrt(1.0 + self._keeps**2))
        self._rough = rng.standard_normal(robot.movers)
        self._smooth = np.zeros(robot.movers)

    def offset(self, velocity: Array, left_s: float, *, gripping: bool) -> Array:
        """Return (Q,) the offsets of the next targets of base and arm, [m] and [rad].

        Args:
            velocity: (Q,) commanded velocity.
            left_s: Time until the motion's end.
            gripping: Whether the fingers are commanded to close.
        """
        a = self._keeps
        self._rough = a * self._rough + float(np.sqrt(1.0 - a * a)) * self._rng.standard_normal(len(self._rough))
        self._smooth = a * self._smooth + (1.0 - a) * self._rough
        share = min(float((np.abs(velocity) / self._limits).max()) / _FULL_FROM, left_s / _FADES_S, 1.0) ** 2
        share *= _GRIPPING if gripping else 1.0
        return np.asarray(share * self._scale * np.clip(self._gain * self._smooth, -MOST, MOST))
