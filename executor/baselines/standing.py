"""How a baseline gets its hand to a pose: the base straight before it, at the first reach that base and arm have."""

from __future__ import annotations

import itertools
from collections.abc import Iterable
from dataclasses import replace
from typing import TypeVar

import numpy as np

from executor.geometry import Array
from executor.motion.planning.candidates import REACHES_M, HandGoal, is_base_free
from executor.motion.planning.carry import drive_to
from executor.motion.planning.stance import PARKED_CLEARANCE_M, Stance
from executor.primitives.driving import follow_legs
from executor.primitives.grasp import approach
from executor.primitives.library import Runner
from executor.primitives.session import Session, StepResult
from executor.records.rollout import Failure, FailureKind
from executor.robot.kinematics import ARM
from oag import Action
from oag.revision.measurements import Measurement, Unplanned

Followup = TypeVar("Followup")


def stance_before(
    session: Session, goals: Iterable[HandGoal], before_m: float, followup: Followup
) -> Stance[Followup] | None:
    """Returns the first stance whose hand comes straight to a pose, or None.

    Of collisions only those where the straight way begins are looked at, as a motion there needs a free end; the way
    itself, the grasp and what comes after are not.

    Args:
        session: Where the robot is; its planner knows where things are.
        goals: Poses of the hand that will all do, and from where they are faced, the preferred one first.
        before_m: Length of the straight way to it.
        followup: What comes after.
    """
    kinematics, oracle = session.planner.kinematics, session.planner.oracle
    for goal, reach_m in itertools.product(goals, REACHES_M):
        base = goal.base_before(reach_m, 0.0)
        if not is_base_free(session.planner, base, PARKED_CLEARANCE_M):
            continue
        for solution in kinematics.solve(goal.T_world_eef, base):
            q = np.concatenate([base, solution.arm])
            T_back = kinematics.forward(q)
            T_back[:3, 3] -= before_m * T_back[:3, 2]
            line = session.planner.line(q, T_back).path if before_m else q[None]
            if line is not None and oracle.is_free(line[-1]):
                return Stance(q, line[::-1].copy(), kinematics.margin(line[:, ARM]), 0.0, followup, 0.0)
    return None


def fallen_short(session: Session, what: str) -> Failure:
    """Returns the failure of a robot that has no place and no posture for the one pose."""
    message = f"straight before {what} there is no room for the base, or no posture of the arm for the hand's pose"
    return Failure(FailureKind.UNREACHABLE, message, (Unplanned(target=session.subtask.target),))


def near_by(navigate: Runner) -> Runner:
    """Returns what APPROACH does: it takes up the pose before the grasp, by `navigate` where nothing has driven yet."""
    return lambda session, action: (navigate if session.plan.stance is None else approach)(session, action)


def go(session: Session, goal: Array, action: Action, *measured: Measurement) -> StepResult:
    """Drives to a configuration (10,) and takes it up, by the executor's free ways."""
    session.look()
    journey = drive_to(session.planner, session.q, goal)
    if journey is None:
        message = f"no free way leads to the one stance at {session.subtask.target}"
        found = Unplanned(target=session.subtask.target, stances_tried=1)
        return session.done(action, *measured, failure=Failure(FailureKind.NO_PATH, message, (found,)))
    failure = follow_legs(session, journey.legs)
    stance = session.plan.stance
    if failure is None and stance is not None and np.allclose(stance.approach[0], goal):
        # The journey may count the base's yaw in another turn than the stance did.
        turned = stance.turned(float(session.q[2] - goal[2]))
        session = replace(session, plan=replace(session.plan, stance=turned))
    return session.done(action, *measured, failure=failure)
