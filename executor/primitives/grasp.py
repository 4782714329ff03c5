"""GRASP and UNGRASP: close until both fingers press, open until neither does."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from executor.assets.model import Asset, Handle
from executor.geometry import Array, inverse, rotation_z
from executor.motion.articulation.doors import gripped_handle
from executor.motion.articulation.work import handle_contacts
from executor.motion.planning.contacts import FINGERS, Allowed, fingers_may_touch, held_may_touch
from executor.primitives.session import Hand, Outcome, Session
from executor.records.rollout import Failure, FailureKind
from executor.world.detectors import fingers_touching, touching_bodies
from oag import Action
from oag.revision.measurements import GripMeasured, ReleaseMeasured, TooWide
from oag.task.sizes import GRIPPER_OPENING_M, WIDEST_GRASP_M

RELEASE_SETTLE_S = 0.6
FALL_M = 0.10
SQUEEZE_M = 0.015
"""How far beyond each other the fingers are sent around something thin: so they press with all their force."""

_ROUNDING_M = 1e-6


def grip_width_m(asset: Asset) -> float:
    """Returns how far apart the fingers are when they hold a thing: the bar of its handle, or its own width."""
    if asset.handles:
        return asset.handles[0].thickness_m
    return asset.graspable_width_m if asset.graspable_width_m is not None else min(asset.extent_m[:2])


def fits_between(asset: Asset) -> bool:
    """Decides whether the fingers can close around all of a thing."""
    return grip_width_m(asset) <= WIDEST_GRASP_M + _ROUNDING_M


def misfit(target: str, asset: Asset) -> Failure | None:
    """Returns a failure when a thing is too wide for the gripper and has no rim to be held by, else None."""
    if fits_between(asset) or asset.rim is not None:
        return None
    width_m = grip_width_m(asset)
    takes = f"the gripper opens to {GRIPPER_OPENING_M * 1000:.0f} mm and takes at most {WIDEST_GRASP_M * 1000:.0f}"
    message = f"{target} is {width_m * 1000:.0f} mm wide, {takes}"
    return Failure(FailureKind.TOO_WIDE, message, (TooWide(round(width_m, 4), GRIPPER_OPENING_M),))


def handle_in_use(session: Session) -> Handle | None:
    """Returns the handle that was planned for, else the one between the fingers, else the first; None without any."""
    if session.plan.swing is not None:
        return session.plan.swing.handle
    target = session.subtask.target
    handles = session.world.assets[target].handles
    return (gripped_handle(session.world, target) or handles[0]) if handles else None


def target_contacts(session: Session) -> Allowed:
    """Returns the contacts that holding the target means: its handle's link, or the item."""
    target, handle = session.subtask.target, handle_in_use(session)
    return handle_contacts(target, handle) if handle is not None else fingers_may_touch(target)


def grasp(session: Session, action: Action) -> Outcome:
    """Closes the gripper on the target and measures whether both fingers press on it."""
    target, handled = session.subtask.target, session.handled | {session.subtask.target}
    asset = session.world.assets[target]
    if session.plan.is_push:
        session.control.grip(0.0)
        pushing = replace(session.hand, released=target_contacts(session))
        return replace(session, hand=pushing, handled=handled).done(action, GripMeasured(motion="push"))
    if (failure := misfit(target, asset)) is not None:
        return session.done(action, failure=failure)
    supports = [body for body in touching_bodies(session.world, target) if body != "robot"]
    meant, at_rim = _meant(session), session.plan.at_rim
    fingers = session.control.grip(-SQUEEZE_M if at_rim else 0.0)
    touching = fingers_touching(session.world, target)
    measured = GripMeasured(
        fingers_touching=touching,
        opening_m=round(float(fingers.sum()), 4),
        target_width_m=round(asset.rim.thickness_m if at_rim and asset.rim else grip_width_m(asset), 4),
    )
    if touching < len(FINGERS):
        message = f"{touching} of 2 fingers touch {target} after closing to {fingers.sum() * 1000:.0f} mm"
        return session.done(action, measured, failure=Failure(FailureKind.GRASP_MISSED, message, (measured,)))
    if asset.motion != "dynamic":
        holding = replace(session.hand, gripped=target, released=target_contacts(session))
        session = replace(session, hand=holding, handled=handled)
        session.look()
        return session.done(action, measured)
    holding = Hand(target, session.hand.gripped, held_may_touch(supports), fingers_may_touch(target))
    session = replace(session, hand=holding, handled=handled)
    session.look()
    measured = replace(measured, grip_force_n=round(_grip_force_n(session), 2))
    return session.done(action, _beside(session, meant, measured))


def _meant(session: Session) -> Array | None:
    """Returns (4, 4) the pose in the hand that the grasp was planned for, the flow's own corrections left out."""
    stance, target = session.plan.stance, session.subtask.target
    if stance is None or session.world.assets[target].motion != "dynamic":
        return None
    q = stance.q.copy()
    q[:2] -= session.plan.aside_m
    T_eef_target: Array = inverse(session.planner.kinematics.forward(q)) @ session.believed.T_world_link(target)
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
    held = session.hand.held
    before = session.world.T_world_link(held)[:3, 3] if held is not None else np.zeros(3)
    session.control.grip(session.planner.kinematics.finger_upper_m)
    session = replace(session, hand=replace(session.hand, held=None, gripped=None))
    session.control.settle(RELEASE_SETTLE_S)
    session.look()
    if held is None:
        return session.done(action)
    fell_m = float(before[2] - session.world.T_world_link(held)[2, 3])
    moved_m = float(np.linalg.norm(session.world.T_world_link(held)[:2, 3] - before[:2]))
    measured = ReleaseMeasured(round(fell_m, 4), round(moved_m, 4))
    failure = None
    if fell_m > FALL_M:
        message = f"{held} fell {fell_m * 100:.0f} cm when the gripper opened"
        failure = Failure(FailureKind.DROPPED, message, (measured,))
    return session.done(action, measured, failure=failure)
