"""Which planning seed has the robot stand, and hold its arm, where what it sees says, and not where a draw does.

A hand gets to the same thing with the elbow on either side and the wrist turned either way, and from several places;
which of them the planner takes, the draws of its seed decide. A demonstration is as good with each; but what follows
from nothing that is seen, no policy can learn, and the mean of two postures reaches nowhere. Here the same few seeds
are tried in every episode, and the stance counts whose arm is nearest to home, from where every episode begins.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from executor.primitives.navigate import with_stance
from executor.primitives.session import Session
from executor.records.rollout import Failure, ignore
from executor.robot.description import ARM_HOME
from executor.robot.kinematics import ARM
from executor.rollouts.checkpoint import Checkpoint
from executor.rollouts.running import RECORD_HZ, Run
from executor.world.physics import STANDARD, Physics
from oag import ObjectActionGraph, Scene


def seed_nearest_home(
    graph: ObjectActionGraph,
    scene: Scene,
    count: int,
    physics: Physics = STANDARD,
    start: Checkpoint | None = None,
) -> int:
    """Returns the seed of planning, below `count`, by which the first subtask's arm posture is nearest to home.

    Args:
        graph: The composed task; its first subtask drives to its target.
        scene: The concrete scene that worlds are built of.
        count: How many seeds are tried, from 0 on.
        physics: Of the episode.
        start: Where things are; by default as the scene has them. Who drives from there brings its arm home first.

    Raises:
        PlanRefused: `verify` does not prove the plan.
        MissingFlow: A subtask has no flow.
    """
    run = Run(graph, scene, 0, ignore, RECORD_HZ, physics=physics)
    try:
        begun = run.begin() if start is None else replace(start, target=(*start.target[:3], *ARM_HOME))
        world, control = begun.restore(scene, lambda: None, physics=physics)
        with world:
            if start is not None:
                widest_m = run.planner.kinematics.finger_upper_m
                world.robot.set_qpos([*begun.target, widest_m, widest_m])
            control.settle(world.timestep_s)  # Contacts are found by stepping.
            session = run.session(0, begun, world, control)
            return min(range(count), key=lambda seed: _from_home_rad(session, seed))
    finally:
        run.close()


def _from_home_rad(session: Session, seed: int) -> float:
    """Returns how far, over all joints of the arm, it is from home to the posture that a seed gives."""
    session.planner.start_subtask(session.believed, seed, 0)
    planned = with_stance(session)
    if isinstance(planned, Failure) or planned.plan.stance is None:
        return np.inf
    return float(np.abs(planned.plan.stance.q[ARM] - np.array(ARM_HOME)).sum())
