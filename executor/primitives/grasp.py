"""GRASP and UNGRASP: close until both fingers press, open until neither does."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from executor.geometry import Array, inverse, rotation_z
from executor.motion.grasping.reach import Lift
from executor.motion.planning.contacts import FINGERS, fingers_may_touch, held_may_touch
from executor.primitives.fit import grip_width_m, misfit
from executor.primitives.handles import is_push, target_contacts
from executor.records.rollout import Failure, FailureKind
from executor.session.session import Outcome, Session
from executor.world.detectors import fingers_touching, touching_bodies
from oag import Action
from oag.revision.measurements import GripMeasured, ReleaseMeasured

RELEASE_SETTLE_S = 0.6
FALL_M = 0.10
SQUEEZE_M = 0.015
"""How far beyond each other the fingers are sent around something thin: so they press with all their force."""


def grasp(session: Session, action: Action) -> Outcome:
    """Closes the gripper on the target and measures whether both fingers press on it."""
    target = session.subtask.target
    asset = session.world.assets[target]
    if is_push(session):
        session.control.grip(0.0)
        session.handled |= {target}
        session.released = target_contacts(session)
        return Outcome(action, (GripMeasured(motion="push"),))
    if (failure := misfit(target, asset)) is not None:
        return Outcome(action, (), failure)
    supports = [body for body in touching_bodies(session.world, target) if body != "robot"]
    meant = _meant(session)
    at_rim = _at_rim(session)
    fingers = session.control.grip(-SQUEEZE_M if at_rim else 0.0)
    touching = fingers_touching(session.world, target)
    measured = GripMeasured(
        fingers_touching=touching,
        opening_m=round(float(fingers.sum()), 4),
        target_width_m=round(asset.rim.thickness_m if at_rim and asset.rim else grip_width_m(asset), 4),
    )
    if touching < len(FINGERS):
        message = f"{touching} of 2 fingers touch {target} after closing to {fingers.sum() * 1000:.0f} mm"
        return Outcome(action, (measured,), Failure(FailureKind.GRASP_MISSED, message, (measured,)))
    session.handled |= {target}
    if asset.motion == "dynamic":
        session.held = target
        session.lifted_from = held_may_touch(supports)
        session.released = fingers_may_touch(target)
    else:
        session.gripped = target
        session.released = target_contacts(session)
    session.look()
    if asset.motion == "dynamic":
        measured = _beside(session, meant, replace(measured, grip_force_n=round(_grip_force_n(session), 2)))
    return Outcome(action, (measured,))


def _at_rim(session: Session) -> bool:
    """Decides whether the grasp in use is around the target's wall, not around all of it."""
    followup = None if session.stance is None else session.stance.followup
    return isinstance(followup, Lift) and followup.at_rim


def _meant(session: Session) -> Array | None:
    """Returns (4, 4) the pose in the hand that the grasp was planned for, the flow's own corrections left out."""
    if session.stance is None or session.world.assets[session.subtask.target].motion != "dynamic":
        return None
    q = session.stance.q.copy()
    q[:2] -= session.aside_m
    T_eef_target: Array = inverse(session.planner.kinematics.forward(q)) @ session.believed.T_world_link(
        session.subtask.target
    )
    return T_eef_target


def _beside(session: Session, meant: Array | None, measured: GripMeasured) -> GripMeasured:
    """Adds how far the held item is from where the grasp meant it to be, in the base's directions.

    Across the fingers it counts as nothing, since they centre what they close on.
    """
    carried = session.planner.oracle.carried
    if meant is None or carried is None:
        return measured
    off = carried.T_eef_object[:3, 3] - meant[:3, 3]
    off[1] = 0.0
    in_world = session.planner.kinematics.forward(session.control.q)[:3, :3] @ off
    forward, left, up = rotation_z(float(session.q[2])).T @ in_world
    return replace(
        measured,
        held_off_m=round(float(np.linalg.norm(off)), 4),
        held_forward_m=round(float(forward), 4),
        held_left_m=round(float(left), 4),
        held_up_m=round(float(up), 4),
    )


def _grip_force_n(session: Session) -> float:
    """Returns the force of the finger that presses less."""
    world, target = session.world, session.subtask.target
    forces = dict.fromkeys(FINGERS, 0.0)
    for contact in world.contacts({target}):
        for near, far in ((contact.a, contact.b), (contact.b, contact.a)):
            if near.owner == "robot" and near.link in forces and far.owner == target:
                forces[near.link] += contact.impulse_ns / world.timestep_s
    return min(forces.values())


def ungrasp(session: Session, action: Action) -> Outcome:
    """Opens the gripper and waits until what it held is at rest."""
    held = session.held
    before = session.world.T_world_link(held)[:3, 3] if held is not None else np.zeros(3)
    session.control.grip(session.planner.kinematics.finger_upper_m)
    session.held, session.gripped = None, None
    session.control.settle(RELEASE_SETTLE_S)
    session.look()
    if held is None:
        return Outcome(action)
    fell_m = float(before[2] - session.world.T_world_link(held)[2, 3])
    moved_m = float(np.linalg.norm(session.world.T_world_link(held)[:2, 3] - before[:2]))
    measured = ReleaseMeasured(round(fell_m, 4), round(moved_m, 4))
    if fell_m > FALL_M:
        message = f"{held} fell {fell_m * 100:.0f} cm when the gripper opened"
        return Outcome(action, (measured,), Failure(FailureKind.DROPPED, message, (measured,)))
    return Outcome(action, (measured,))
