"""Base stances of baselines: the base straight before a hand pose, at the first reach that base and arm have."""

from __future__ import annotations

import itertools
from collections.abc import Iterable
from dataclasses import replace
from typing import TypeVar

import numpy as np

from executor.geometry import Array
from executor.planning.drives import drive_to
from executor.planning.stances import PARKED_CLEARANCE_M, HandGoal, Stance, is_base_free
from executor.records import Failure, FailureKind
from executor.skills.grasp import approach
from executor.skills.library import Runner
from executor.skills.navigate import follow_legs
from executor.skills.session import Session, StepResult
from oag import Action
from oag.measurements import Measurement, Unplanned

Followup = TypeVar("Followup")


def stance_before(
    session: Session, goals: Iterable[HandGoal], before_m: float, followup: Followup
) -> Stance[Followup] | None:
    """Return the first stance whose hand comes straight to a pose, or None.

    Collisions are checked only at the begin of the straight line, since a motion there needs a free end. The line
    itself, the grasp and what follows are not checked.

    Args:
        session: State of the robot; its planner knows the world.
        goals: Alternative hand poses with their approach headings, the preferred one first.
        before_m: Length of the straight line to it [m].
        followup: What comes after.
    """
    kinematics, oracle = session.planner.kinematics, session.planner.oracle
    robot = session.planner.robot
    for goal, reach_m in itertools.product(goals, robot.reaches_m):
        base = goal.base_before(robot, reach_m, 0.0)
        if not is_base_free(session.planner, base, PARKED_CLEARANCE_M):
            continue
        for solution in kinematics.solve(goal.T_world_eef, base):
            q = np.concatenate([base, solution.arm])
            T_back = kinematics.forward(q)
            T_back[:3, 3] -= before_m * T_back[:3, 2]
            line = session.planner.line(q, T_back).path if before_m else q[None]
            if line is not None and oracle.is_free(line[-1]):
                return Stance(robot, q, line[::-1].copy(), kinematics.margin(line[:, robot.arm]), 0.0, followup, 0.0)
    return None


def unreachable_failure(session: Session, what: str) -> Failure:
    """Return the failure of a robot without room or posture for the one pose."""
    message = f"straight before {what} there is no room for the base, or no posture of the arm for the hand's pose"
    return Failure(FailureKind.UNREACHABLE, message, (Unplanned(target=session.subtask.target),))


def approach_by(navigate: Runner) -> Runner:
    """Return the runner of APPROACH: move to the pose before the grasp, by `navigate` where nothing has driven yet."""
    return lambda session, action: (navigate if session.plan.stance is None else approach)(session, action)


def drive_to_stance(session: Session, goal: Array, action: Action, *measured: Measurement) -> StepResult:
    """Drive to a configuration (10,), by the executor's free paths."""
    session.sync_planner()
    journey = drive_to(session.planner, session.q, goal)
    if journey is None:
        message = f"no free way leads to the one stance at {session.subtask.target}"
        found = Unplanned(target=session.subtask.target, stances_tried=1)
        return session.done(action, *measured, failure=Failure(FailureKind.NO_PATH, message, (found,)))
    failure = follow_legs(session, journey.legs)
    stance = session.plan.stance
    if failure is None and stance is not None and np.allclose(stance.approach[0], goal):
        # The journey's yaw may differ from the stance's by full turns.
        turned = stance.turned(float(session.q[2] - goal[2]))
        session = replace(session, plan=replace(session.plan, stance=turned))
    return session.done(action, *measured, failure=failure)
