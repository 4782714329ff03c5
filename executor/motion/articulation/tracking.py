"""How far a tracked motion of base and arm gets from a configuration, checked row by row."""

from __future__ import annotations

from executor.geometry import Array
from executor.motion.articulation.push import Push
from executor.motion.articulation.rigid import ArticulationPath
from executor.motion.articulation.whole_body import Course, Share, Tracked, course, residual_m, shares, track
from executor.motion.articulation.work import ARC_CLEARANCE_M, Swing, Work, can_let_go, can_step_back
from executor.motion.planning.contacts import NOTHING, Allowed, fingers_may_touch
from executor.robot.kinematics import ARM

COARSE = 4
CORNERS = 0.72
"""Half the diagonal of a square bar against its side, for a bar that turns in the fingers."""


def carried_to(
    work: Work, q: Array, share: Share, fractions: tuple[float, ...], fingers: Allowed, push: Push | None = None
) -> tuple[float, float] | None:
    """Returns the best fraction that a tracked motion gets to, free all the way, and its joint margin; or None."""
    planner, end = work.planner, work.joint.position(fractions[0])
    # Most do not get far, and long steps tell so sooner.
    for coarseness in (COARSE, 1):
        way = _tracked(work, q, share, end, push, coarseness).way
        free = _free_rows(work, way, fingers, push)
        if free < _rows_to(work, fractions[-1], way):
            return None
    for fraction in fractions:
        rows = _rows_to(work, fraction, way)
        if rows > free:
            continue
        last, joints = way.path[rows - 1], way.joints[rows - 1]
        leaves = can_step_back(planner, last, joints) if push else can_let_go(planner, last, joints, fingers)
        if leaves:
            return fraction, planner.kinematics.margin(way.path[:rows, ARM])
    return None


def _rows_to(work: Work, fraction: float, way: ArticulationPath) -> int:
    """How many rows of a way it takes to a fraction of the joint's range; more than there are where it falls short."""
    first, last = (next(iter(row.values())) for row in (way.joints[0], way.joints[-1]))
    if len(way.path) < 2:
        return 2
    if last == first:
        # What is asked for is how it is: a shut door that is to be closed.
        return 1
    part = (work.joint.position(fraction) - first) / (last - first)
    return 1 + round((len(way.path) - 1) * part)


def _free_rows(work: Work, way: ArticulationPath, fingers: Allowed, push: Push | None) -> int:
    """Returns how many rows of a tracked motion are free, from the first on."""
    oracle, widest_m = work.planner.oracle, work.planner.kinematics.finger_upper_m
    holding_m = min(CORNERS * work.handle.thickness_m + 2 * ARC_CLEARANCE_M, widest_m)
    opening_m, allowed = (holding_m, NOTHING) if push is None else (0.0, fingers)
    allowed |= work.riders
    with work.from_here(allowed):
        for count, (q, joints) in enumerate(zip(way.path, way.joints, strict=True)):
            if oracle.hits(q, allowed=allowed, joints=joints, opening_m=opening_m, margin_m=ARC_CLEARANCE_M):
                return count
    return len(way.path)


def _tracked(work: Work, q: Array, share: Share, end: float, push: Push | None, coarseness: int) -> Tracked:
    return track(work.planner, q, work.object_id, work.joint, _course(work, q, share, end, push, coarseness))


def _course(work: Work, q: Array, share: Share, end: float, push: Push | None, coarseness: int = 1) -> Course:
    T_eef = work.planner.kinematics.forward(q)
    press = None if push is None else push.press
    return course(T_eef, q[:3], work.joint, work.T_root, work.now, end, share, press=press, coarseness=coarseness)


def tracked_path(work: Work, q: Array, swing: Swing) -> tuple[Tracked, float]:
    """Returns the path of a tracked motion from where the hand really is, and how far off it stays in metres.

    Args:
        work: What is to be moved.
        q: (10,) with the handle in the gripper, or the closed gripper at the panel.
        swing: What was planned.
    """
    if swing.share is None:
        raise ValueError("a rigid arc is not tracked")
    along = _course(work, q, swing.share, work.joint.position(swing.end_fraction), swing.push)
    tracked = track(work.planner, q, work.object_id, work.joint, along)
    return tracked, residual_m(work.planner, tracked, along)


def improvised(work: Work, q: Array) -> Swing | None:
    """Returns a tracked motion from where the hand holds the handle already, for a grasp that nobody planned it for.

    Args:
        work: What is to be moved.
        q: (10,) with the handle in the gripper.
    """
    fingers = fingers_may_touch(f"{work.object_id}/{work.handle.link}")
    for share in shares(work.joint, work.T_root):
        found = carried_to(work, q, share, work.fractions, fingers)
        if found is not None:
            return Swing(found[0], work.handle, "whole-body arc", share)
    return None
