"""How the robot moves with a joint: all of it along an arc or a line, or base and arm each their share of the way.

Where the arm stays as it is and the base carries the gripped handle, there are no wrist limits and nothing slips. A
door that folds down takes its handle along an arc in a vertical plane, which no base can drive: the arm tracks it
while the base makes room. Where a hinge is upright but the floor of the rigid arc is taken, the base goes less far,
or turns less, and the arm makes up for it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from executor.assets.model import Joint
from executor.geometry import Array, heading_of
from executor.motion.planning.oracle import JointTarget
from executor.motion.planning.paths import arc_about, base_move, segment
from executor.motion.planning.planner import Planner
from executor.robot.kinematics import ARM

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


# A bar that turns farther in the fingers than this asks more of the wrist than it has.
_FOLDING = tuple(Share(t, 0.0, hold) for hold in (1.0, 0.85) for t in (1.0, 0.8))
# Hands that turned half as far as the door lost three of the four handles that were looked at.
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
    """Returns how base and arm may share a joint's motion, with a handle in hand or pushing, the likeliest first."""
    if joint.kind == "prismatic":
        return _PUSH_SLIDING if pushing else _SLIDING
    if driving_carries(joint, T_world_root):
        return _PUSH_UPRIGHT if pushing else _UPRIGHT
    return _PUSH_FOLDING if pushing else _FOLDING


@dataclass(frozen=True, slots=True)
class Tracked:
    """What came of tracking a joint's motion.

    Attributes:
        way: Rows that the arm reaches, from the start on.
        complete: Whether that is all of them.
    """

    way: ArticulationPath
    complete: bool


@dataclass(frozen=True, slots=True)
class Course:
    """Where hand and base are meant to be along a joint's motion.

    Attributes:
        positions: (N,) joint positions, the start first.
        hands: (N, 4, 4) hand poses.
        bases: (N, 3) base poses.
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
    """Returns where hand and base go while a joint moves.

    Args:
        T_world_eef: (4, 4) the hand at the start.
        base: (3,) the base at the start.
        joint: The joint.
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
    bases = np.column_stack([grip[:2] + share.travel * (points - grip)[:, :2] + offsets[:, :2], base[2] + turns])
    return Course(positions, hands, bases)


def track(planner: Planner, q: Array, object_id: str, joint: Joint, along: Course) -> Tracked:
    """Returns the robot's path along a course, as far as the arm reaches; not checked for collisions.

    Args:
        planner: Solves the hand's poses.
        q: (10,) the start, at the course's first row.
        object_id: The articulated object.
        joint: Its joint.
        along: Where hand and base go.
    """
    rows = [q.copy()]
    for hand, base in zip(along.hands[1:], along.bases[1:], strict=True):
        # One start from the posture before, no random ones: the arm stays on its branch.
        found = planner.kinematics.solve(
            hand, base, near=rows[-1][ARM], restarts=1, minimum_margin_rad=LEAST_MARGIN_RAD
        )
        if not found or np.abs(found[0].arm - rows[-1][ARM]).max() > JUMP_RAD:
            break
        rows.append(np.concatenate([base, found[0].arm]))
    joints = tuple({(object_id, joint.name): float(p)} for p in along.positions[: len(rows)])
    return Tracked(ArticulationPath(np.stack(rows), joints), len(rows) == len(along.positions))


def residual_m(planner: Planner, tracked: Tracked, along: Course) -> float:
    """Returns how far off the arm stays, within its limits, from the first hand pose that it does not reach."""
    reached = len(tracked.way.path)
    if tracked.complete:
        return 0.0
    here = tracked.way.path[-1].copy()
    here[:3] = along.bases[reached]
    return planner.tracker.track(here, [along.hands[reached]])[1]


@dataclass(frozen=True, slots=True)
class ArticulationPath:
    """A path of the robot and the joint's position at each of its rows.

    Attributes:
        path: (N, 10) configurations, the start first.
        joints: N mappings from (object id, joint name) to a position.
    """

    path: Array
    joints: tuple[dict[JointTarget, float], ...]


def strong_rows(planner: Planner, way: ArticulationPath, joint: Joint) -> int:
    """Returns on how many rows of a way, from the first on, the arm's torques suffice for what the joint asks.

    Args:
        planner: Knows the arm.
        way: With the hand at the handle, or at the panel.
        joint: The joint that the hand moves.
    """
    positions = np.array([next(iter(row.values())) for row in way.joints])
    if len(positions) < 2 or positions[0] == positions[-1]:
        return len(positions)
    hands = np.stack([planner.kinematics.forward(q)[:3, 3] for q in way.path])
    # Along the way and as strong as the lever makes it: what moves far for a turn of the joint presses little.
    ways = np.gradient(hands, axis=0) / np.abs(np.gradient(positions))[:, None]
    opening = positions[-1] > positions[0]
    asked = [joint.friction - (joint.pull(p) if opening else 0.0) for p in positions.tolist()]
    forces = np.array(asked)[:, None] * ways / np.sum(ways**2, axis=1)[:, None]
    weak = planner.tracker.load(way.path, forces) > MOST_LOAD
    return int(np.argmax(weak)) if weak.any() else len(weak)


def joint_axis(joint: Joint, T_world_root: Array) -> Array:
    """Returns a joint's axis (3,) in the world."""
    return np.asarray(T_world_root[:3, :3] @ np.array(joint.axis))


def driving_carries(joint: Joint, T_world_root: Array) -> bool:
    """Decides whether driving alone moves a joint: its hinge is vertical, or its slide level."""
    upward = abs(float(joint_axis(joint, T_world_root)[2]))
    return upward >= VERTICAL if joint.kind == "revolute" else upward <= LEVEL


def carry_joint(
    q: Array, object_id: str, joint: Joint, T_world_root: Array, start: float, end: float
) -> ArticulationPath:
    """Returns the robot's path that carries a gripped handle from one joint position to another.

    Args:
        q: (10,) with the handle in the gripper.
        object_id: The articulated object.
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
        path = np.concatenate([ends[:1], segment(ends[0], ends[1])])
    positions = np.linspace(start, end, len(path))
    return ArticulationPath(path, tuple({(object_id, joint.name): float(p)} for p in positions))
