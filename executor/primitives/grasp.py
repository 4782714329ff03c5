"""GRASP and UNGRASP: close until both fingers press, open until neither does."""

from __future__ import annotations

import numpy as np

from executor.detectors import fingers_touching, touching_bodies
from executor.motion.contacts import FINGERS, fingers_may_touch, held_may_touch
from executor.primitives.fit import grip_width_m, misfit
from executor.primitives.reach import target_contacts
from executor.records import Failure, FailureKind, JsonValue
from executor.session import Outcome, Session
from oag import Action

RELEASE_SETTLE_S = 0.6
FALL_M = 0.10


def grasp(session: Session, action: Action) -> Outcome:
    """Closes the gripper on the target and measures whether both fingers press on it."""
    target = session.subtask.target
    asset = session.world.assets[target]
    if (failure := misfit(target, asset)) is not None:
        return Outcome(action, {}, failure)
    supports = [body for body in touching_bodies(session.world, target) if body != "robot"]
    fingers = session.control.grip(0.0)
    touching = fingers_touching(session.world, target)
    measurements: dict[str, JsonValue] = {
        "fingers_touching": touching,
        "opening_m": round(float(fingers.sum()), 4),
        "target_width_m": round(grip_width_m(asset), 4),
    }
    if touching < len(FINGERS):
        message = f"{touching} of 2 fingers touch {target} after closing to {fingers.sum() * 1000:.0f} mm"
        return Outcome(action, measurements, Failure(FailureKind.GRASP_MISSED, message, measurements))
    session.handled |= {target}
    if asset.motion == "dynamic":
        session.held = target
        session.lifted_from = held_may_touch(supports)
        session.released = fingers_may_touch(target)
    else:
        session.gripped = target
        session.released = target_contacts(session)
    session.look()
    return Outcome(action, measurements)


def ungrasp(session: Session, action: Action) -> Outcome:
    """Opens the gripper and waits until what it held is at rest."""
    held = session.held
    before = session.world.T_world_link(held)[:3, 3] if held is not None else np.zeros(3)
    session.control.grip(session.planner.kinematics.finger_upper_m)
    session.held, session.gripped = None, None
    session.control.settle(RELEASE_SETTLE_S)
    session.look()
    if held is None:
        return Outcome(action, {})
    fell_m = float(before[2] - session.world.T_world_link(held)[2, 3])
    moved_m = float(np.linalg.norm(session.world.T_world_link(held)[:2, 3] - before[:2]))
    measurements: dict[str, JsonValue] = {"fell_m": round(fell_m, 4), "moved_m": round(moved_m, 4)}
    if fell_m > FALL_M:
        message = f"{held} fell {fell_m * 100:.0f} cm when the gripper opened"
        return Outcome(action, measurements, Failure(FailureKind.DROPPED, message, measurements))
    return Outcome(action, measurements)
