"""A demonstration's drives as seen from beside where they led.

A drive goes through free room, so that whoever stands a little beside it does best to get back to it: the same joint
targets are right from there. Demonstrations of drives show next to nothing of that, as each of them ends to the
millimetre where it should. Who was led aside by so much as a hand's width on the way comes to a place from which no
demonstration went on, and the arm reaches beside the thing. Neither physics nor planner is asked: robot, hand and what
that holds are moved together, all else stays.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from executor.datasets.formats.observations import THING, THINGS

SHARE = 0.5
"""Of a drive's moments, that many are seen from beside."""

TURN_RAD_PER_M = 2.0
"""By how much the base is turned for each metre that it is off: what moves what is half a metre ahead by as much."""

_HELD_M = 0.1  # From the hand to where it takes a thing, while that is in it.


def beside(
    columns: Mapping[str, NDArray],
    drives: NDArray[np.bool_],
    carries: NDArray[np.bool_],
    off_m: float,
    rng: np.random.Generator,
) -> dict[str, NDArray]:
    """Returns an episode's columns (`executor.datasets.formats.stream`) with the base beside where it drove.

    Args:
        columns: Of the episode; joint targets stay as they are, hand actions would be others.
        drives, carries: (N,) moments in which the base drives, and in which it does so with a thing in the hand.
        off_m: Deviation along x and along y.
        rng: Draws where it stands.
    """
    agent = np.array(columns["observation.state"], np.float64)
    rows = np.flatnonzero(drives & (rng.random(len(agent)) < SHARE))
    moved = rng.normal(0.0, off_m, (len(rows), 3)) * [1.0, 1.0, TURN_RAD_PER_M]
    turn = Rotation.from_euler("z", moved[:, 2:])
    base_m = np.concatenate([agent[rows, :2], np.zeros((len(rows), 1))], axis=1)
    by_m = np.concatenate([moved[:, :2], np.zeros((len(rows), 1))], axis=1)
    hand_m = agent[rows, 12:15]
    agent[rows, :3] += moved
    agent[rows, 12:15] = turn.apply(hand_m - base_m) + base_m + by_m
    agent[rows, 15:19] = (turn * Rotation.from_quat(agent[rows, 15:19])).as_quat()
    around = np.array(columns["observation.environment_state"], np.float64)
    things = around[:, : THINGS * THING].reshape(len(around), THINGS, THING)
    for thing in range(THINGS):
        seen = things[rows, thing]
        held = carries[rows] & (seen[:, 0] > 0.0) & (np.linalg.norm(seen[:, 11:14] - hand_m, axis=1) < _HELD_M)
        if held.any():
            spun = turn[held]
            for place in (slice(1, 4), slice(11, 14)):
                things[rows[held], thing, place] = spun.apply(seen[held, place] - base_m[held]) + (base_m + by_m)[held]
            things[rows[held], thing, 4:8] = (spun * Rotation.from_quat(seen[held, 4:8])).as_quat()
    return {
        **columns,
        "observation.state": agent.astype(np.float32),
        "observation.environment_state": around.astype(np.float32),
    }
