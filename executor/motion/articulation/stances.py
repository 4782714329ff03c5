"""Stances at a handle or a panel, chosen together with the motion that the joint is carried along right after."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from executor.geometry import Array
from executor.motion.articulation.grips import EDGE_TILTS_DEG, Push, edge_of, panel_of, push_goals, tilted_goals
from executor.motion.articulation.joint_motion import (
    ArticulationPath,
    Course,
    Share,
    Tracked,
    carry_joint,
    course,
    driving_carries,
    residual_m,
    shares,
    strong_rows,
    track,
)
from executor.motion.articulation.work import (
    ARC_CLEARANCE_M,
    Swing,
    Work,
    can_let_go,
    can_step_back,
    handle_contacts,
    possible_fractions,
)
from executor.motion.grasping.grasps import handle_goals
from executor.motion.planning.candidates import HandGoal
from executor.motion.planning.oracle import NOTHING, Allowed, fingers_may_touch
from executor.motion.planning.paths import spread_out
from executor.motion.planning.stance import Stance, Validate, search
from executor.robot.kinematics import ARM
from oag import Primitive
from oag.task.sizes import Gripper

HOLDING_OPENING_M = 0.01  # Of each finger around a bar.
HANDLE_TURNS_RAD = (0.0, 0.2, -0.2, 0.4, -0.4)  # How far the base may face away from a handle, straight ahead first.
SIDEWAYS_TURNS_RAD = (0.8, -0.8, 0.0, 1.57, -1.57, 0.4, -0.4)
"""A base that faces along the front reaches lower with a level hand than one that faces it."""

NARROW_COST = 2.0
"""Cost in rad of joint margin for each unit of a joint's range that stays shut."""

TURNING_COST = 2.0
"""Cost in rad for a bar that turns in the fingers by all that the joint turns: it jams, and the wrist has 3 N m."""

TRACKED_BATCH = 24  # Fewer than elsewhere: each candidate costs a tracked way.
WIDE = 2
"""How many of the preferred ends are good enough to be taken at once."""

PATIENCE = 6
"""How many stances that fall short are found before one of them is taken."""

ARC_MARGIN_RAD = 0.35  # Less joint margin than this on the way costs.
COARSE = 4  # Steps at once in a first look.
CORNERS = 0.72
"""Half the diagonal of a square bar against its side, for a bar that turns in the fingers."""


def rigid_stances(work: Work, here: Array) -> Iterator[Stance[Swing]]:
    """Yields stances from which driving carries the joint to where the action says; none where driving cannot.

    Args:
        work: What is to be moved.
        here: (3,) where the base stands.
    """
    if not driving_carries(work.joint, work.T_root):
        return iter(())
    planner, object_id, joint, now = work.planner, work.object_id, work.joint, work.now
    holding = handle_contacts(object_id, work.handle) | work.riders
    fractions = possible_fractions(work)
    if not fractions:
        return iter(())

    def validate(q: Array) -> tuple[Swing, float] | None:
        for fraction in fractions:
            arc = carry_joint(q, object_id, joint, work.T_root, now, joint.position(fraction))
            if strong_rows(planner, arc, joint) < len(arc.path) or not _arc_is_free(work, arc, holding):
                continue
            if not can_let_go(planner, arc.path[-1], arc.joints[-1], holding):
                continue
            return Swing(fraction, work.handle, partial=work.partial), NARROW_COST * abs(fractions[0] - fraction)
        return None

    goals = handle_goals(work.handle, work.world.T_world_link(object_id, work.handle.link))
    return search(planner, goals, here, validate=validate, allowed=holding, turns_rad=HANDLE_TURNS_RAD)


def tracked_stances(work: Work, here: Array) -> Iterator[Stance[Swing]]:
    """Yields stances from which base and arm together carry the joint to where the action says.

    Args:
        work, here: As for `rigid_stances`.
    """
    T_link = work.world.T_world_link(work.object_id, work.handle.link)
    goals = tilted_goals(work.handle, work.T_root, T_link, facing=work.handle.outward)
    return _along_a_course(work, goals, here)


def edge_stances(work: Work, here: Array) -> Iterator[Stance[Swing]]:
    """Yields stances at the free edge of a door that folds down, whose handle may be out of reach below it.

    Args:
        work, here: As for `rigid_stances`.
    """
    opening_m = Gripper.of(work.world.scene.robot).opening_m
    edge = edge_of(work.world.assets[work.object_id], work.handle, opening_m)
    if edge is None or work.joint.kind != "revolute" or driving_carries(work.joint, work.T_root):
        return iter(())
    T_link = work.world.T_world_link(work.object_id, edge.link)
    goals = tilted_goals(edge, work.T_root, T_link, facing=work.handle.outward, tilts_deg=EDGE_TILTS_DEG)
    return _along_a_course(replace(work, handle=edge), goals, here)


def _along_a_course(work: Work, goals: list[HandGoal], here: Array) -> Iterator[Stance[Swing]]:
    fingers = fingers_may_touch(f"{work.object_id}/{work.handle.link}")
    fractions = possible_fractions(work)
    if not fractions:
        return
    stances = search(
        work.planner,
        goals,
        here,
        validate=_tracking(work, fractions, fingers),
        allowed=fingers,
        turns_rad=SIDEWAYS_TURNS_RAD,
        batch=TRACKED_BATCH,
    )
    yield from widest_first(stances, fractions)


def widest_first(stances: Iterator[Stance[Swing]], fractions: tuple[float, ...]) -> Iterator[Stance[Swing]]:
    """Yields stances as they come, but holds those that fall short back while better ones may still turn up.

    Args:
        stances: Good ones first.
        fractions: Where the joint may end, the preferred one first.
    """
    waiting: list[Stance[Swing]] = []
    for stance in stances:
        if fractions.index(stance.followup.end_fraction) < WIDE:
            yield stance
            continue
        waiting.append(stance)
        if len(waiting) >= PATIENCE:
            break
    yield from sorted(waiting, key=lambda stance: fractions.index(stance.followup.end_fraction))
    yield from stances


def _tracking(work: Work, fractions: tuple[float, ...], fingers: Allowed) -> Validate[Swing]:
    """Returns what looks for the best share of base and arm at a stance."""

    def validate(q: Array) -> tuple[Swing, float] | None:
        best: tuple[Swing, float] | None = None
        for rank, share in enumerate(shares(work.joint, work.T_root)):
            found = carried_to(work, q, share, fractions, fingers)
            if found is None:
                continue
            end, margin_rad = found
            cost = NARROW_COST * abs(fractions[0] - end) + 0.02 * rank + max(ARC_MARGIN_RAD - margin_rad, 0.0)
            cost += TURNING_COST * (1.0 - share.hold)
            if best is None or cost < best[1]:
                best = Swing(end, work.handle, "whole-body arc", share, partial=work.partial), cost
            if end == fractions[0] and share.hold == 1.0:
                break
        return best

    return validate


def push_stances(work: Work, here: Array) -> Iterator[Stance[Swing]]:
    """Yields stances from which the closed gripper pushes the panel to where the action says.

    Args:
        work, here: As for `rigid_stances`.
    """
    planner, handle = work.planner, work.handle
    asset = work.world.assets[work.object_id]
    opening = work.action.primitive is Primitive.ARTICULATE_OPEN
    panel = panel_of(asset, handle, inner=opening)
    if panel is None:
        return
    fingers = fingers_may_touch(f"{work.object_id}/{handle.link}")
    fractions = possible_fractions(work)
    if not fractions:
        return
    T_link = work.world.T_world_link(work.object_id, handle.link)
    for push in push_goals(panel, T_link, work.T_root):

        def validate(q: Array, push: Push = push) -> tuple[Swing, float] | None:
            for rank, share in enumerate(shares(work.joint, work.T_root, pushing=True)):
                found = carried_to(work, q, share, fractions, fingers, push)
                if found is not None:
                    swing = Swing(found[0], handle, "push", share, push, work.partial)
                    return swing, NARROW_COST * abs(fractions[0] - found[0]) + 0.02 * rank
            return None

        yield from search(
            planner, [push.goal], here, validate=validate, turns_rad=SIDEWAYS_TURNS_RAD, batch=TRACKED_BATCH
        )


def _arc_is_free(work: Work, arc: ArticulationPath, holding: Allowed) -> bool:
    """Decides whether a rigid arc is free; distant rows come first, which finds walls sooner."""
    with work.from_here(holding):
        return not any(
            work.planner.oracle.hits(
                arc.path[k],
                allowed=holding,
                joints=arc.joints[k],
                opening_m=HOLDING_OPENING_M,
                margin_m=ARC_CLEARANCE_M,
            )
            for k in spread_out(len(arc.path))
        )


def carried_to(
    work: Work, q: Array, share: Share, fractions: tuple[float, ...], fingers: Allowed, push: Push | None = None
) -> tuple[float, float] | None:
    """Returns the best fraction that a tracked motion gets to, free all the way, and its joint margin; or None."""
    planner, end = work.planner, work.joint.position(fractions[0])
    # Most do not get far, and long steps tell so sooner.
    for coarseness in (COARSE, 1):
        way = _tracked(work, q, share, end, push, coarseness).way
        free = min(_free_rows(work, way, fingers, push), strong_rows(planner, way, work.joint))
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
