"""What is to be moved, what its numbers ask for, and what was planned for it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Literal

import numpy as np

from executor.assets.model import Handle, Joint
from executor.geometry import Array, inverse
from executor.motion.articulation.grips import Push
from executor.motion.articulation.joint_motion import Share
from executor.motion.planning.oracle import Allowed, JointTarget, fingers_may_touch
from executor.motion.planning.planner import Planner
from executor.motion.planning.withdraw import lets_go
from executor.world.world import World
from oag import Action, Primitive

ARC_CLEARANCE_M = 0.003  # Doors are built to pass their neighbours by about as much.
FAR_AWAY_M = 60.0  # Beyond every scene.
MEETING_STEPS = 40  # A quarter turn in steps of about 2 degrees.
STEP_BACK_M = 0.03  # Clear of the panel before the fingers open.
APART_M = 0.0015  # What the open fingers then keep.
Motion = Literal["rigid arc", "whole-body arc", "push"]
OPEN_FRACTIONS = (0.85, 0.75, 0.65, 0.55)
"""How far an unfilled ARTICULATE_OPEN opens, the widest feasible one first."""

SMALLER_FRACTIONS = (0.45, 0.35, 0.25, 0.15)
"""How far it opens where the floor or the arm allows no more; what stands ajar is then pushed on from inside."""

LEAST_STAGE = 0.06
"""A stage moves a joint by at least this part of its range, and leaves at least this much to the next."""

EDGE_M = 0.01  # What leans over the side of a drawer lies in it.


@dataclass(frozen=True, slots=True)
class Swing:
    """What an articulation does after the grasp.

    Attributes:
        end_fraction: The fraction of the joint's range it ends at.
        handle: The handle in use; its joint is the one that moves.
        motion: By which motion.
        share: How base and arm share it, for a tracked one.
        push: Where the panel is pushed, for a push.
        partial: Whether more was asked for than this motion gives.
    """

    end_fraction: float
    handle: Handle
    motion: Motion = "rigid arc"
    share: Share | None = None
    push: Push | None = None
    partial: bool = False


@dataclass(frozen=True, slots=True)
class Work:
    """One joint that is to be moved: what all ways of moving it need to know.

    Attributes:
        planner: Synchronised with the world.
        world: Where things are.
        object_id: The articulated object.
        handle: The handle of the joint.
        action: ARTICULATE_OPEN or ARTICULATE_CLOSE, filled or not.
        partial: Whether to do less than was asked.
    """

    planner: Planner
    world: World
    object_id: str
    handle: Handle
    action: Action
    partial: bool = False

    @property
    def joint(self) -> Joint:
        """The joint that moves."""
        return self.world.assets[self.object_id].joint(self.handle.joint)

    @property
    def now(self) -> float:
        """Where the joint is, in rad or m."""
        return self.world.joint_position(self.object_id, self.handle.joint)

    @property
    def fractions(self) -> tuple[float, ...]:
        """Where it may end, the preferred one first."""
        return end_fractions(self.action, self.joint, self.joint.fraction(self.now))

    @property
    def smaller(self) -> tuple[float, ...]:
        """Where a first stage may end that does less than was asked."""
        return smaller_fractions(self.action, self.joint, self.joint.fraction(self.now))

    @property
    def riders(self) -> Allowed:
        """What the moving link may touch, since it carries it."""
        link = self.handle.link
        mover = f"{self.object_id}/{link}"
        return frozenset((mover, item) for item in riders(self.world, self.object_id, link))

    @contextmanager
    def from_here(self, allowed: Allowed) -> Iterator[None]:
        """Lets the joint's link leave what it is near to where it is now: it may come no nearer to that.

        A door that was opened until a neighbour is as near as it may be is, by what the joint is off its target,
        nearer or farther.

        Args:
            allowed: Contacts that are meant to be, the riders' among them.
        """
        at = {(self.object_id, self.joint.name): self.now}
        with self.planner.oracle.leaving(_far_away(), margin_m=ARC_CLEARANCE_M, allowed=allowed, joints=at):
            yield

    @property
    def T_root(self) -> Array:
        """(4, 4) where the object stands."""
        return self.world.T_world_link(self.object_id)


def door_meets(work: Work) -> tuple[float, str] | None:
    """Returns at which fraction of its range the joint's link meets something on its way, and what; None when never.

    The robot is left out of it, so that what no stance could do is known before any is looked for.
    """
    target, link = (work.object_id, work.joint.name), f"{work.object_id}/{work.handle.link}"
    start, end = work.now, work.joint.position(work.fractions[0])
    oracle, carried = work.planner.oracle, work.riders
    with work.from_here(carried):
        for position in np.linspace(start, end, MEETING_STEPS):
            hits = oracle.hits(_far_away(), joints={target: float(position)}, margin_m=ARC_CLEARANCE_M, allowed=carried)
            met = next((hit.other for hit in hits if hit.mover == link), None)
            if met is not None:
                return work.joint.fraction(float(position)), met
    return None


def _far_away() -> Array:
    """Returns a configuration (10,) in which the robot is near to nothing."""
    q = np.zeros(10)
    q[:2] = FAR_AWAY_M
    return q


def possible_fractions(work: Work) -> tuple[float, ...]:
    """Returns where the joint may end that nothing but the robot could be in the way of."""
    meets = door_meets(work)
    fractions = work.smaller if work.partial else work.fractions
    if meets is None:
        return fractions
    now = work.joint.fraction(work.now)
    return tuple(f for f in fractions if abs(f - now) < abs(meets[0] - now))


def handle_contacts(object_id: str, handle: Handle) -> Allowed:
    """Returns the contacts that holding a handle means."""
    return fingers_may_touch(f"{object_id}/{handle.link}", hand=True)


def can_let_go(planner: Planner, q: Array, joints: dict[JointTarget, float], holding: Allowed) -> bool:
    """Decides whether the hand gets away from the handle where the joint ends."""
    with joints_at(planner, joints):
        return lets_go(planner, q, allowed=holding)


def can_step_back(planner: Planner, q: Array, joints: dict[JointTarget, float]) -> bool:
    """Decides whether the hand gets away from a panel that it has pushed, with open fingers that touch nothing."""
    path = step_back(planner, q)
    if path is None:
        return False
    opening_m = planner.kinematics.finger_upper_m
    with joints_at(planner, joints):
        free = not planner.oracle.hits(path[-1], opening_m=opening_m, margin_m=APART_M)
        return free and lets_go(planner, path[-1])


def step_back(planner: Planner, q: Array) -> Array | None:
    """Returns the path (N, 10) of the hand off a panel, along its own axis; None where the arm does not follow."""
    T = planner.kinematics.forward(q)
    T[:3, 3] -= STEP_BACK_M * T[:3, 2]
    return planner.line(q, T).path


@contextmanager
def joints_at(planner: Planner, joints: dict[JointTarget, float]) -> Iterator[None]:
    """Lets the oracle believe for a while that joints are elsewhere."""
    before = {key: planner.oracle.joint_position(key) for key in joints}
    for key, position in joints.items():
        planner.oracle.set_joint(key, position)
    try:
        yield
    finally:
        for key, position in before.items():
            planner.oracle.set_joint(key, position)


def end_fractions(action: Action, joint: Joint, now: float) -> tuple[float, ...]:
    """Returns where an articulation may end, as fractions of the joint's range, the preferred one first.

    An interval [a, b] opens to b, or closes by b - a of the range but not below a; no interval opens wide and closes
    fully. Limits up to 1 are fractions of the range, larger ones radians (or metres).

    Source: appendix, "Articulated-Object Interaction"; the reading of the interval is ours (docs/departures.md).

    Args:
        action: ARTICULATE_OPEN or ARTICULATE_CLOSE.
        joint: The joint that moves.
        now: The joint's fraction now.
    """
    interval = action.parameter
    if isinstance(interval, tuple):
        low, high = interval
        if high > 1.0:
            low, high = joint.fraction(low), min(joint.fraction(high), 1.0)
        return (high,) if action.primitive is Primitive.ARTICULATE_OPEN else (max(now - (high - low), low),)
    if action.primitive is Primitive.ARTICULATE_OPEN:
        return tuple(f for f in OPEN_FRACTIONS if f > now) or (1.0,)
    return (0.0,)


def smaller_fractions(action: Action, joint: Joint, now: float) -> tuple[float, ...]:
    """Returns where a first stage may end when what is asked for cannot be had in one motion, the nearest first.

    Args:
        action: ARTICULATE_OPEN or ARTICULATE_CLOSE.
        joint: The joint that moves.
        now: The joint's fraction now.
    """
    end = end_fractions(action, joint, now)[-1]
    if action.primitive is Primitive.ARTICULATE_OPEN:
        steps = (*OPEN_FRACTIONS, *SMALLER_FRACTIONS)
        return tuple(f for f in steps if now + LEAST_STAGE < f < end - LEAST_STAGE)
    steps = (*SMALLER_FRACTIONS[::-1], *OPEN_FRACTIONS[::-1])
    return tuple(f for f in steps if end + LEAST_STAGE < f < now - LEAST_STAGE)


def interval(start: float, end: float) -> tuple[float, float]:
    """Returns the interval that says what was done, rounded so that reading it back does the same or more."""
    low, high = sorted((max(0.0, start), end))
    return (round(low, 2), min(round(high + 0.005, 2), 1.0))


def riders(world: World, object_id: str, link: str | None = None) -> tuple[str, ...]:
    """Returns the items that lie where a moving link of an object carries them.

    Args:
        world: Where things are.
        object_id: The object.
        link: One of its moving links; all of them by default.
    """
    asset = world.assets[object_id]
    moving = {joint.child for joint in asset.joints} if link is None else {link}
    found = []
    for region in asset.regions:
        if region.link not in moving:
            continue
        T_link_world = inverse(world.T_world_link(object_id, region.link))
        room = np.array(region.half_extents_m) + EDGE_M
        for item in world.dynamic_ids:
            centre = (T_link_world @ world.T_world_link(item)[:, 3])[:3]
            if bool(np.all(np.abs(centre - np.array(region.center_m)) <= room)):
                found.append(item)
    return tuple(dict.fromkeys(found))
