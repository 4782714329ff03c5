"""Which planning seed has the robot stand where what it sees says, and not where a draw does.

From many a place a hand gets to the same thing about as well, and which of them the planner takes follows from the draws
of its seed too. A demonstration is as good from each; but what follows from nothing that is seen, no policy can learn.
Here the same few seeds are tried in every episode, and the stance that takes the least driving counts.
"""

from __future__ import annotations

import numpy as np

from executor.geometry import wrap_angle
from executor.motion.planning.planner import BASE_WEIGHTS
from executor.primitives.navigate import with_stance
from executor.primitives.session import Session
from executor.records.rollout import Failure, ignore
from executor.rollouts.running import RECORD_HZ, Run
from executor.world.physics import STANDARD, Physics
from oag import ObjectActionGraph


def nearest_stance_seed(graph: ObjectActionGraph, count: int, physics: Physics = STANDARD) -> int:
    """Returns the seed of planning, below `count`, by which the first subtask's stance is nearest to the start.

    Args:
        graph: The composed task in its concrete scene; its first subtask drives to its target.
        count: How many seeds are tried, from 0 on.
        physics: Of the episode.

    Raises:
        PlanRefused: `verify` does not prove the plan.
        MissingFlow: A subtask has no flow.
    """
    run = Run(graph, graph.scene, 0, ignore, RECORD_HZ, physics=physics)
    try:
        start = run.begin()
        world, control = start.restore(graph.scene, lambda: None, physics=physics)
        with world:
            control.settle(world.timestep_s)  # Contacts are found by stepping.
            session = run.session(0, start, world, control)
            return min(range(count), key=lambda seed: (_way_m(session, seed), seed))
    finally:
        run.close()


def _way_m(session: Session, seed: int) -> float:
    """Returns how far it is to the stance that a seed gives, turning counted as driving."""
    session.planner.start_subtask(session.believed, seed, 0)
    planned = with_stance(session)
    if isinstance(planned, Failure) or planned.plan.stance is None:
        return np.inf
    way = planned.plan.stance.base - session.q[:3]
    way[2] = wrap_angle(float(way[2]))
    return float(np.hypot(way[0], way[1]) + BASE_WEIGHTS[2] * abs(way[2]))
