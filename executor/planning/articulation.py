"""Motion of a joint by the robot: how far to move it, and the paths of hand and base while it moves.

In a rigid arc the arm stays as it is and the base carries the gripped handle: there are no wrist limits and nothing
slips. A door that folds down takes its handle along an arc in a vertical plane, which no base can drive: the arm tracks
it while the base makes room. Where a hinge is upright but the floor of the rigid arc is taken, the base drives or turns
less. The arm makes up for it.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from executor.assets.asset_geometry import joint_transform
from executor.assets.model import Handle, Joint
from executor.geometry import Array, heading_of, inverse
from executor.planning.cargo import HELD, Carried, riders
from executor.planning.collision import Allowed, JointTarget, fingers_may_touch, held_may_touch
from executor.planning.drives import can_withdraw
from executor.planning.grasps import Push
from executor.planning.paths import arc_about, base_move, segment
from executor.planning.planner import Planner
from executor.sim.world import World
from oag import Action, Primitive
from oag.model.robots import Robot

STEP_M = 0.015  # Of the grip between two rows.
STEP_RAD = 0.04  # And of the hinge, for grips near to it.
LEAST_MARGIN_RAD = 0.03  # To the arm's joint limits on the way.
JUMP_RAD = 0.3
"""An arm joint that turns farther than this from one row to the next is on another branch."""

MOST_LOAD = 0.85  # Of an arm joint's torque; the rest speeds up, and turns the bar in the fingers.
ARC_STEP_M = 0.03  # Between rows of a rigid arc, where nothing bends in between.
VERTICAL = 0.99  # Of an axis: within 8 degrees of upright the base can follow it.
LEVEL = 0.01  # Of a slide: it rises by less than a centimetre a metre.


@dataclass(frozen=True, slots=True)
class Share:
    """How base and hand take part in a joint's motion.

    Attributes:
        travel: The base's travel, as a part of the grip's travel over the floor.
        turn: The base's turn, as a part of an upright hinge's.
        hold: The hand's turn, as a part of the hinge's: 1 keeps it fixed to the handle, 0 lets the bar turn in the
            fingers.
    """

    travel: float
    turn: float = 0.0
    hold: float = 1.0


# Turning the bar farther in the fingers than this needs more torque than the wrist has.
_FOLDING = tuple(Share(t, 0.0, hold) for hold in (1.0, 0.85) for t in (1.0, 0.8))
# Hands that turned half as far as the door lost three of the four handles that were examined.
_UPRIGHT = (
    Share(1.0, 0.5),
    Share(0.7, 0.5),
    Share(1.0),
    Share(0.7),
    Share(1.0, 0.5, 0.6),
    Share(1.0, 0.0, 0.0),
    Share(0.6, 0.0, 0.0),
    Share(0.3, 0.0, 0.0),
)
_SLIDING = (Share(0.6), Share(0.4), Share(0.2), Share(0.0))
_PUSH_FOLDING = (Share(0.8, 0.0, 0.0), Share(1.0, 0.0, 0.5), Share(0.8, 0.0, 1.0), Share(0.5, 0.0, 0.0))
_PUSH_UPRIGHT = (Share(1.0, 1.0), Share(1.0, 0.5, 0.5), *(Share(travel, 0.0, 0.0) for travel in (1.0, 0.6, 0.3)))
_PUSH_SLIDING = (Share(1.0), Share(0.5), Share(0.0))


def shares(joint: Joint, T_world_root: Array, *, pushing: bool = False) -> tuple[Share, ...]:
    """Return how base and arm may share a joint's motion, with a handle in hand or pushing, the likeliest first."""
    if joint.kind == "prismatic":
        return _PUSH_SLIDING if pushing else _SLIDING
    if driving_carries(joint, T_world_root):
        return _PUSH_UPRIGHT if pushing else _UPRIGHT
    return _PUSH_FOLDING if pushing else _FOLDING


@dataclass(frozen=True, slots=True)
class Tracked:
    """Result of tracking a joint's motion.

    Attributes:
        trajectory: Rows that the arm reaches, from the start on.
        complete: Whether these are all rows.
    """

    trajectory: ArticulationPath
    complete: bool


@dataclass(frozen=True, slots=True)
class Course:
    """Where hand and base are meant to be along a joint's motion.

    Attributes:
        positions: (N,) joint positions, the start first.
        hands: (N, 4, 4) hand poses.
        bases: (N, B) the base's coordinates.
    """

    positions: Array
    hands: Array
    bases: Array


def course(
    T_world_eef: Array,
    base: Array,
    joint: Joint,
    T_world_root: Array,
    start: float,
    end: float,
    share: Share,
    *,
    press: Array | None = None,
    coarseness: int = 1,
) -> Course:
    """Return where hand and base go while a joint moves.

    Args:
        T_world_eef: (4, 4) the hand at the start.
        base: (B,) the base at the start.
        T_world_root: (4, 4) where the object stands.
        start, end: Joint positions in rad or m.
        share: How base and hand take part.
        press: (3,) by how much the hand moves against the moving link on the way, in the world at the start.
        coarseness: How many steps are taken at once.
    """
    axis, grip = joint_axis(joint, T_world_root), T_world_eef[:3, 3]
    pivot = (T_world_root @ np.array([*joint.position_m, 1.0]))[:3]
    revolute = joint.kind == "revolute"
    arm_m = float(np.linalg.norm(np.cross(axis, grip - pivot))) if revolute else 1.0
    steps = max(abs(end - start) * arm_m / STEP_M, abs(end - start) / STEP_RAD if revolute else 0.0) / coarseness
    positions = np.linspace(start, end, max(int(np.ceil(steps)), 2) + 1)
    moved = positions - start
    angles = moved if revolute else np.zeros(len(moved))
    with_link = Rotation.from_rotvec(angles[:, None] * axis)
    points = with_link.apply(grip - pivot) + pivot if revolute else grip + moved[:, None] * axis
    if press is not None:
        points = points + np.linspace(0.0, 1.0, len(moved))[:, None] * with_link.apply(press)
    hands = np.tile(np.eye(4), (len(moved), 1, 1))
    hands[:, :3, :3] = Rotation.from_rotvec(share.hold * angles[:, None] * axis).as_matrix() @ T_world_eef[:3, :3]
    hands[:, :3, 3] = points
    turns = share.turn * angles * float(axis[2])
    offsets = Rotation.from_rotvec(turns[:, None] * np.array([0.0, 0.0, 1.0])).apply([*(base[:2] - grip[:2]), 0.0])
    places = grip[:2] + share.travel * (points - grip)[:, :2] + offsets[:, :2]
    bases = np.column_stack([places, base[2] + turns, np.tile(base[3:], (len(turns), 1))])
    return Course(positions, hands, bases)


def track(planner: Planner, q: Array, object_id: str, joint: Joint, along: Course) -> Tracked:
    """Return the robot's path along a course, as far as the arm reaches; not checked for collisions.

    Args:
        planner: Solves the hand's poses.
        q: (Q,) the start, at the course's first row.
        along: Where hand and base go.
    """
    rows, arm = [q.copy()], planner.robot.arm
    for hand, base in zip(along.hands[1:], along.bases[1:], strict=True):
        # One start from the posture before, no random ones: the arm stays on its branch.
        found = planner.kinematics.solve(
            hand, base, near=rows[-1][arm], restarts=1, minimum_margin_rad=LEAST_MARGIN_RAD
        )
        if not found or np.abs(found[0].arm - rows[-1][arm]).max() > JUMP_RAD:
            break
        rows.append(np.concatenate([base, found[0].arm]))
    joints = tuple({(object_id, joint.name): float(p)} for p in along.positions[: len(rows)])
    return Tracked(ArticulationPath(np.stack(rows), joints), len(rows) == len(along.positions))


def residual_m(planner: Planner, tracked: Tracked, along: Course) -> float:
    """Return how far off [m] the arm stays, within its limits, from the first hand pose that it does not reach."""
    reached = len(tracked.trajectory.path)
    if tracked.complete:
        return 0.0
    here = tracked.trajectory.path[-1].copy()
    here[planner.robot.base] = along.bases[reached]
    return planner.tracker.track(here, [along.hands[reached]])[1]


@dataclass(frozen=True, slots=True)
class ArticulationPath:
    """A path of the robot and the joint's position at each of its rows.

    Attributes:
        path: (N, Q) configurations, the start first.
        joints: N mappings from (object id, joint name) to a position.
    """

    path: Array
    joints: tuple[dict[JointTarget, float], ...]


def rows_within_torque(planner: Planner, trajectory: ArticulationPath, joint: Joint) -> int:
    """Return for how many rows of a trajectory, from the first on, the arm's torques suffice for the joint's
    resistance.

    Args:
        planner: Knows the arm.
        trajectory: With the hand at the handle, or at the panel.
        joint: The joint that the hand moves.
    """
    positions = np.array([next(iter(row.values())) for row in trajectory.joints])
    if len(positions) < 2 or positions[0] == positions[-1]:
        return len(positions)
    hands = np.stack([planner.kinematics.forward(q)[:3, 3] for q in trajectory.path])
    # Along the hand's path, with the lever's strength: a hand that moves far for a turn of the joint presses little.
    hand_steps = np.gradient(hands, axis=0)
    squared = np.sum(hand_steps**2, axis=1)
    # Where the hand rests, the joint asks for nothing.
    levers = np.divide(np.abs(np.gradient(positions)), squared, out=np.zeros_like(squared), where=squared > 0.0)
    opening = positions[-1] > positions[0]
    asked = [joint.friction - (joint.pull(p) if opening else 0.0) for p in positions.tolist()]
    forces = (np.array(asked) * levers)[:, None] * hand_steps
    weak = planner.tracker.load(trajectory.path, forces) > MOST_LOAD
    return int(np.argmax(weak)) if weak.any() else len(weak)


def joint_axis(joint: Joint, T_world_root: Array) -> Array:
    """Return a joint's axis (3,) in the world."""
    return np.asarray(T_world_root[:3, :3] @ np.array(joint.axis))


def driving_carries(joint: Joint, T_world_root: Array) -> bool:
    """Return whether driving alone moves a joint: its hinge is vertical, or its slide level."""
    upward = abs(float(joint_axis(joint, T_world_root)[2]))
    return upward >= VERTICAL if joint.kind == "revolute" else upward <= LEVEL


def carry_joint(
    robot: Robot, q: Array, object_id: str, joint: Joint, T_world_root: Array, start: float, end: float
) -> ArticulationPath:
    """Return the robot's path that carries a gripped handle from one joint position to another.

    Args:
        robot: Its record.
        q: (Q,) with the handle in the gripper.
        joint: A joint that `driving_carries`.
        T_world_root: (4, 4) where the object stands.
        start, end: Joint positions in rad or m.
    """
    axis = joint_axis(joint, T_world_root)
    if joint.kind == "revolute":
        pivot = (T_world_root @ np.array([*joint.position_m, 1.0]))[:3]
        radius_m = max(float(np.hypot(*(q[:2] - pivot[:2]))), 0.5)
        count = max(int(np.ceil(abs(end - start) * radius_m / ARC_STEP_M)), 2)
        path = arc_about(q, pivot, float(np.sign(axis[2])) * (end - start), count)
    else:
        ends = base_move(q, end - start, heading_of(axis))
        path = np.concatenate([ends[:1], segment(robot, ends[0], ends[1])])
    positions = np.linspace(start, end, len(path))
    return ArticulationPath(path, tuple({(object_id, joint.name): float(p)} for p in positions))


ARC_CLEARANCE_M = 0.003  # Doors are built to pass their neighbours by about as much.
FAR_AWAY_M = 60.0  # Beyond every scene.
PRESSED_M = 0.002  # Less deep than this into something, what a drawer carries gives way.
MEETING_STEPS = 40  # A quarter turn in steps of about 2 degrees.
STEP_BACK_M = 0.03  # Clear of the panel before the fingers open.
APART_M = 0.0015  # What the open fingers then keep.
Motion = Literal["rigid arc", "whole-body arc", "push"]
OPEN_FRACTIONS = (0.85, 0.75, 0.65, 0.55)
"""How far an unfilled ARTICULATE_OPEN opens, the widest feasible one first."""

PULLED_OUT = 0.97
"""How far a drawer is pulled where it can be, short of its stop: what is at its back comes out from below the top."""

SMALLER_FRACTIONS = (0.45, 0.35, 0.25, 0.15)
"""How far it opens where the floor or the arm allows no more; what stands ajar is then pushed on from inside."""

LEAST_STAGE = 0.06
"""A stage moves a joint by at least this part of its range, and leaves at least this much to the next."""


@dataclass(frozen=True, slots=True)
class Swing:
    """The motion of a joint after the grasp.

    Attributes:
        end_fraction: The fraction of the joint's range it ends at.
        handle: The handle in use; its joint is the one that moves.
        motion: The kind of motion.
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
class ArticulationTask:
    """One joint that is to be moved: the common input of all strategies.

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
        """Position of the joint, [rad] or [m]."""
        return self.world.joint_position(self.object_id, self.handle.joint)

    @property
    def fractions(self) -> tuple[float, ...]:
        """Where it may end, the preferred one first."""
        return end_fractions(self.planner.robot, self.action, self.joint, self.joint.fraction(self.now))

    @property
    def smaller(self) -> tuple[float, ...]:
        """Where a first stage may end that does less than was asked."""
        return smaller_fractions(self.planner.robot, self.action, self.joint, self.joint.fraction(self.now))

    @property
    def riders(self) -> Allowed:
        """Contacts that the moving link may have, with the items that it carries."""
        link = self.handle.link
        mover = f"{self.object_id}/{link}"
        return frozenset((mover, item) for item in riders(self.world, self.object_id, link))

    @contextmanager
    def leaving_start(self, allowed: Allowed) -> Iterator[None]:
        """Permit the joint's link to leave what it is near to now; it may come no nearer to that.

        A door that was opened until a neighbour is as near as allowed is nearer or farther by the joint's tracking
        error.

        Args:
            allowed: Intended contacts, those of carried items among them.
        """
        at = {(self.object_id, self.joint.name): self.now}
        with self.planner.oracle.leaving(
            _far_away(self.planner.robot), margin_m=ARC_CLEARANCE_M, allowed=allowed, joints=at
        ):
            yield

    @property
    def T_root(self) -> Array:
        """(4, 4) where the object stands."""
        return self.world.T_world_link(self.object_id)


class Obstruction(NamedTuple):
    """Where on its way a joint's link, or what that carries, meets something.

    Attributes:
        fraction: Of the joint's range.
        met: What is met, as "id/link".
        item: What meets it, of what the link carries; None for the link itself.
    """

    fraction: float
    met: str
    item: str | None = None


def first_obstruction(work: ArticulationTask) -> Obstruction | None:
    """Return where the joint's link, or what that carries, first meets something; None where it meets nothing.

    The robot is left out, so that what no stance could do is known before any is searched for. A drawer does not shut
    with a pile in it that is higher than its room.
    """
    target, link = (work.object_id, work.joint.name), f"{work.object_id}/{work.handle.link}"
    start, end = work.now, work.joint.position(work.fractions[0])
    oracle, carried, away = work.planner.oracle, work.riders, _far_away(work.planner.robot)
    positions = np.linspace(start, end, MEETING_STEPS)
    found = [_first_met_by(work, item, positions) for item in _aboard(work)]
    with work.leaving_start(carried):
        for position in positions:
            hits = oracle.hits(away, joints={target: float(position)}, margin_m=ARC_CLEARANCE_M, allowed=carried)
            met = next((hit.other for hit in hits if hit.mover == link), None)
            if met is not None:
                found.append(Obstruction(work.joint.fraction(float(position)), met))
                break
    met_first = [one for one in found if one is not None]
    return min(met_first, key=lambda one: abs(one.fraction - work.joint.fraction(start)), default=None)


def _aboard(work: ArticulationTask) -> tuple[str, ...]:
    """Return the items that the moving link carries; none where stored results were found without them."""
    return () if work.planner.robot.keeps_order else riders(work.world, work.object_id, work.handle.link)


def _first_met_by(work: ArticulationTask, item: str, positions: Array) -> Obstruction | None:
    """Return where an item that the moving link carries first meets something else; None where it meets nothing."""
    oracle, link = work.planner.oracle, f"{work.object_id}/{work.handle.link}"
    away, allowed = _far_away(work.planner.robot), held_may_touch((link, *_aboard(work)))
    T_eef_world = inverse(work.planner.kinematics.forward(away))
    T_world_parent = work.world.T_world_link(work.object_id, work.joint.parent)
    T_link_world = inverse(T_world_parent @ joint_transform(work.joint, work.now))
    before = oracle.carried
    try:
        for number, position in enumerate(positions.tolist()):
            # As if the hand held it: what is held still meets nothing that stands.
            moved = T_eef_world @ T_world_parent @ joint_transform(work.joint, position) @ T_link_world
            oracle.carried = Carried(item, moved @ work.world.T_world_link(item))
            hits = oracle.hits(away, joints={(work.object_id, work.joint.name): position}, allowed=allowed)
            if number == 0:
                # What it touches where it is it may slide along.
                allowed |= {(hit.mover, hit.other) for hit in hits}
                continue
            met = next((hit.other for hit in hits if hit.mover == HELD and hit.separation_m < -PRESSED_M), None)
            if met is not None:
                return Obstruction(work.joint.fraction(position), met, item)
    finally:
        oracle.carried = before
    return None


def _far_away(robot: Robot) -> Array:
    """Return a configuration (Q,) in which the robot is near to nothing."""
    q = np.zeros(robot.movers)
    q[:2] = FAR_AWAY_M
    return q


def possible_fractions(work: ArticulationTask) -> tuple[float, ...]:
    """Return where the joint may end with only the robot as a possible obstacle."""
    meets = first_obstruction(work)
    fractions = work.smaller if work.partial else work.fractions
    if meets is None:
        return fractions
    now = work.joint.fraction(work.now)
    return tuple(f for f in fractions if abs(f - now) < abs(meets.fraction - now))


def handle_contacts(robot: Robot, object_id: str, handle: Handle) -> Allowed:
    """Return the intended contacts of a hand that holds a handle."""
    return fingers_may_touch(robot, f"{object_id}/{handle.link}", hand=True)


def can_let_go(planner: Planner, q: Array, joints: dict[JointTarget, float], holding: Allowed) -> bool:
    """Return whether the hand gets away from the handle where the joint ends."""
    with joints_at(planner, joints):
        return can_withdraw(planner, q, allowed=holding)


def can_step_back(planner: Planner, q: Array, joints: dict[JointTarget, float], panel: Allowed) -> bool:
    """Return whether the hand gets away from a panel that it has pushed, with open fingers that touch nothing.

    The step itself is gone through too: a wrist that moves straight back may bend the elbow out over a table.

    Args:
        planner: Of the robot.
        q: (Q,) the end of the push.
        joints: Where the panel's joint is then.
        panel: What the hand may touch on its first way off the panel.
    """
    path = step_back(planner, q)
    if path is None:
        return False
    opening_m = planner.kinematics.finger_upper_m
    with joints_at(planner, joints):
        if planner.oracle.hits(path[-1], opening_m=opening_m, margin_m=APART_M):
            return False
        # Of the paper's robot the step is not gone through: its stored results were found without.
        if not planner.robot.keeps_order:
            with planner.oracle.leaving(q, opening_m=0.0, allowed=panel):
                if planner.oracle.first_hit(path, opening_m=0.0, allowed=panel):
                    return False
        return can_withdraw(planner, path[-1])


def step_back(planner: Planner, q: Array) -> Array | None:
    """Return the path (N, Q) of the hand off a panel, along its own axis; None where the arm does not follow."""
    T = planner.kinematics.forward(q)
    T[:3, 3] -= STEP_BACK_M * T[:3, 2]
    return planner.line(q, T).path


@contextmanager
def joints_at(planner: Planner, joints: dict[JointTarget, float]) -> Iterator[None]:
    """Set joints of the oracle's world elsewhere for the duration of the block."""
    before = {key: planner.oracle.joint_position(key) for key in joints}
    for key, position in joints.items():
        planner.oracle.set_joint(key, position)
    try:
        yield
    finally:
        for key, position in before.items():
            planner.oracle.set_joint(key, position)


def end_fractions(robot: Robot, action: Action, joint: Joint, now: float) -> tuple[float, ...]:
    """Return where an articulation may end, as fractions of the joint's range, the preferred one first.

    An interval [a, b] opens to b, or closes by b - a of the range but not below a; no interval opens wide and closes
    fully. Limits up to 1 are fractions of the range, larger ones radians (or metres).

    Source: appendix, "Articulated-Object Interaction"; the reading of the interval is ours (docs/departures.md).

    Args:
        robot: Its record.
        action: ARTICULATE_OPEN or ARTICULATE_CLOSE.
        now: The joint's fraction now.
    """
    interval = action.parameter
    if isinstance(interval, tuple):
        low, high = interval
        if high > 1.0:
            low, high = joint.fraction(low), min(joint.fraction(high), 1.0)
        return (high,) if action.primitive is Primitive.ARTICULATE_OPEN else (max(now - (high - low), low),)
    if action.primitive is Primitive.ARTICULATE_OPEN:
        slides = joint.kind == "prismatic" and not robot.keeps_order
        return tuple(f for f in ((PULLED_OUT,) * slides + OPEN_FRACTIONS) if f > now) or (1.0,)
    return (0.0,)


def smaller_fractions(robot: Robot, action: Action, joint: Joint, now: float) -> tuple[float, ...]:
    """Return where a first stage may end when what is asked for cannot be had in one motion, the nearest first.

    Args:
        robot: Its record.
        action: ARTICULATE_OPEN or ARTICULATE_CLOSE.
        now: The joint's fraction now.
    """
    end = end_fractions(robot, action, joint, now)[-1]
    if action.primitive is Primitive.ARTICULATE_OPEN:
        steps = (*OPEN_FRACTIONS, *SMALLER_FRACTIONS)
        return tuple(f for f in steps if now + LEAST_STAGE < f < end - LEAST_STAGE)
    steps = (*SMALLER_FRACTIONS[::-1], *OPEN_FRACTIONS[::-1])
    return tuple(f for f in steps if end + LEAST_STAGE < f < now - LEAST_STAGE)


def interval(start: float, end: float) -> tuple[float, float]:
    """Return the interval of a motion, rounded so that reading it back does the same or more."""
    low, high = sorted((max(0.0, start), end))
    return (round(low, 2), min(round(high + 0.005, 2), 1.0))
