"""Ways of grasping: a hand gets to the same place with the elbow on either side and the wrist turned either way.

What decides it is not seen. So demonstrations are sorted by it, and a policy is told, or chooses.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from executor.datasets.formats.stream import FoldedEpisode
from executor.policies.steps import subtask_of
from oag.model.primitives import ARTICULATIONS, Primitive

SAME_WAY_RAD = 1.0
"""Over all joints; half a turn of the wrist or an elbow on the other side is 2 rad and more, and where things stand
makes 0.3 rad."""

MOST_WAYS = 8  # What a few of a hundred demonstrations do is not learned from them.


def ways_of(episodes: Sequence[FoldedEpisode], going_on: Sequence[NDArray[np.int64]]) -> NDArray[np.int64]:
    """Returns (M,) the way of the subtask that goes on: what one grasp is like says nothing of another thing's."""
    subtasks = [subtask_of(steps) for steps in going_on]
    found = [np.zeros_like(rows) for rows in subtasks]
    for subtask in np.unique(np.concatenate(subtasks)):
        of_it = [rows == subtask for rows in subtasks]
        postures = [_postures_at_grasps(episode, rows) for episode, rows in zip(episodes, of_it, strict=True)]
        having = [number for number, rows in enumerate(of_it) if rows.any()]
        for number, way in zip(having, ways([postures[number] for number in having]), strict=True):
            found[number][of_it[number]] = way
    return np.concatenate(found)


def ways(postures: Sequence[NDArray]) -> NDArray[np.int64]:
    """Returns (N,) which way each demonstration takes things, 0 being the way of the most.

    The mean of two postures reaches nowhere. A way is a posture that others are near to, those that most
    others are near to first. From `MOST_WAYS` on, all that are left are one.

    Args:
        postures: Of each demonstration, (G, 7) the arm at each of its grasps, or where it lets go, rad. The last ones
            are compared with the last ones, since some demonstrations begin in the middle.
    """
    near = np.array([[_apart_rad(one, other) <= SAME_WAY_RAD for other in postures] for one in postures])
    found = np.full(len(postures), MOST_WAYS - 1)
    left = np.ones(len(postures), dtype=bool)
    for way in range(MOST_WAYS - 1):
        if not left.any():
            break
        usual = near[np.where(left, near.astype(int) @ left, -1).argmax()] & left
        found[usual], left = way, left & ~usual
    return found


def _apart_rad(one: NDArray, other: NDArray) -> float:
    """Returns how far two demonstrations' postures are apart at the most different of their grasps, over all joints."""
    count = min(len(one), len(other))
    return float(np.abs(one[len(one) - count :] - other[len(other) - count :]).sum(axis=1).max(initial=0.0))


def _postures_at_grasps(episode: FoldedEpisode, rows: NDArray[np.bool_]) -> NDArray[np.float32]:
    """Returns (G, 7) the arm where each of an episode's grasps begins, of those in some of its rows; where there are
    none, as of what is only put somewhere, where it lets go. Who goes on with a door whose handle is in the hand
    already shows none."""
    primitives = episode.columns["primitive_index"]
    grasping = (primitives == Primitive.GRASP) & rows
    if not grasping.any() and not (np.isin(primitives, list(ARTICULATIONS)) & rows).any():
        grasping = (primitives == Primitive.UNGRASP) & rows
    begun = np.flatnonzero(grasping & ~np.append(False, grasping[:-1]))
    return episode.columns["observation.state"][begun, 3:10]
