"""Choose a stance at a handle or at a panel, together with the joint's motion right after.

A level hand gets in behind a door. Into a drawer it comes from above, at a pitch at which not everything can be held:
an item in a deep drawer is below its front, and the forearm of a level hand is not. So this is decided before the pull.
"""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from executor.assets.model import Handle
from executor.geometry import Array
from executor.planning.articulation import (
    ARC_CLEARANCE_M,
    ArticulationPath,
    ArticulationTask,
    Course,
    Share,
    Swing,
    Tracked,
    can_let_go,
    can_step_back,
    carry_joint,
    course,
    driving_carries,
    first_obstruction,
    handle_contacts,
    joints_at,
    possible_fractions,
    residual_m,
    rows_within_torque,
    shares,
    track,
)
from executor.planning.collision import NOTHING, Allowed, fingers_may_touch
from executor.planning.grasps import (
    EDGE_TILTS_DEG,
    Push,
    edge_of,
    handle_goals,
    panel_of,
    push_goals,
    tilted_goals,
)
from executor.planning.openings import Serves
from executor.planning.paths import spread_out
from executor.planning.planner import Planner
from executor.planning.stances import (
    BaseCandidate,
    HandGoal,
    Stance,
    Validate,
    base_candidates,
    nearest_miss,
    search_stances,
)
from executor.records import Failure, FailureKind
from executor.sim.world import World
from executor.system.effort import CANDIDATE_S
from oag import Action, Primitive
from oag.measurements import Unplanned
from oag.primitives.table import OPEN_FRACTION
from oag.sizes import Gripper

HOLDING_OPENING_M = 0.01  # Of each finger around a bar.
HANDLE_TURNS_RAD = (0.0, 0.2, -0.2, 0.4, -0.4)  # How far the base may face away from a handle, straight ahead first.
SIDEWAYS_TURNS_RAD = (0.8, -0.8, 0.0, 1.57, -1.57, 0.4, -0.4)
"""A base that faces along the front reaches lower with a level hand than one that faces it."""

NARROW_COST = 2.0
"""Cost in rad of joint margin for each unit of a joint's range that stays shut."""

TURNING_COST = 2.0
"""Cost in rad for a bar that turns in the fingers by all that the joint turns: it jams, and the wrist has 3 N m."""

TRACKED_BATCH = 24  # Fewer than elsewhere: each candidate costs a tracked trajectory.
WIDE = 2
"""How many of the preferred ends are good enough to be taken at once."""

PATIENCE, LESS_PATIENCE = 6, 3
"""How many stances that fall short are found before one is taken; fewer where stored results need not repeat."""

ARC_MARGIN_RAD = 0.35  # Less joint margin than this on the way costs.
COARSE = 4  # Steps at once in a first look.
CORNERS = 0.72
"""Half the diagonal of a square bar against its side, for a bar that turns in the fingers."""


def rigid_stances(work: ArticulationTask, here: Array) -> Iterator[Stance[Swing]]:
    """Yield stances from which driving carries the joint to the action's end; none where driving cannot.

    Args:
        here: (B,) where the base stands.
    """
    if not driving_carries(work.joint, work.T_root):
        return iter(())
    planner, object_id, joint, now = work.planner, work.object_id, work.joint, work.now
    holding = handle_contacts(planner.robot, object_id, work.handle) | work.riders
    fractions = possible_fractions(work)
    if not fractions:
        return iter(())

    def validate(q: Array) -> tuple[Swing, float] | None:
        for fraction in fractions:
            arc = carry_joint(planner.robot, q, object_id, joint, work.T_root, now, joint.position(fraction))
            if rows_within_torque(planner, arc, joint) < len(arc.path) or not _arc_is_free(work, arc, holding):
                continue
            if not can_let_go(planner, arc.path[-1], arc.joints[-1], holding):
                continue
            return Swing(fraction, work.handle, partial=work.partial), NARROW_COST * abs(fractions[0] - fraction)
        return None

    def admits(candidate: BaseCandidate) -> bool:
        """Return whether the base has room along the smallest arc, which does not depend on the arm."""
        q, end = np.concatenate([candidate.base, planner.robot.home]), joint.position(fractions[-1])
        return _has_floor(work, carry_joint(planner.robot, q, object_id, joint, work.T_root, now, end).path[:, :3], end)

    return search_stances(
        planner,
        handle_goals(work.handle, work.world.T_world_link(object_id, work.handle.link)),
        here,
        validate=validate,
        allowed=holding,
        turns_rad=HANDLE_TURNS_RAD,
        admits=None if planner.robot.keeps_order else admits,
    )


def tracked_stances(work: ArticulationTask, here: Array) -> Iterator[Stance[Swing]]:
    """Yield stances from which base and arm together carry the joint to the action's end.

    Args:
        work, here: As for `rigid_stances`.
    """
    T_link = work.world.T_world_link(work.object_id, work.handle.link)
    goals = tilted_goals(work.handle, work.T_root, T_link, facing=work.handle.outward)
    return _along_a_course(work, goals, here)


def edge_stances(work: ArticulationTask, here: Array) -> Iterator[Stance[Swing]]:
    """Yield stances at the free edge of a door: its handle may be out of reach below it, or between it and a wall.

    Args:
        work, here: As for `rigid_stances`.
    """
    opening_m = Gripper.of(work.world.scene.robot).opening_m
    edge = edge_of(work.world.assets[work.object_id], work.handle, opening_m)
    upright = driving_carries(work.joint, work.T_root)
    if edge is None or work.joint.kind != "revolute" or (upright and work.planner.robot.keeps_order):
        return iter(())
    T_link = work.world.T_world_link(work.object_id, edge.link)
    tilts_deg = None if upright else EDGE_TILTS_DEG
    goals = tilted_goals(edge, work.T_root, T_link, facing=work.handle.outward, tilts_deg=tilts_deg)
    return _along_a_course(replace(work, handle=edge), goals, here)


def _along_a_course(work: ArticulationTask, goals: list[HandGoal], here: Array) -> Iterator[Stance[Swing]]:
    fingers = fingers_may_touch(work.planner.robot, f"{work.object_id}/{work.handle.link}")
    fractions = possible_fractions(work)
    if not fractions:
        return
    stances = search_stances(
        work.planner,
        goals,
        here,
        validate=_tracking(work, fractions, fingers),
        allowed=fingers,
        turns_rad=SIDEWAYS_TURNS_RAD,
        batch=TRACKED_BATCH,
    )
    patience = PATIENCE if work.planner.robot.keeps_order else LESS_PATIENCE
    yield from widest_first(stances, fractions, patience)


def widest_first(
    stances: Iterator[Stance[Swing]], fractions: tuple[float, ...], patience: int = PATIENCE
) -> Iterator[Stance[Swing]]:
    """Yield stances as they come, but hold back those that fall short while better ones may still turn up.

    Args:
        stances: Good ones first.
        fractions: Where the joint may end, the preferred one first.
        patience: How many are held back.
    """
    waiting: list[Stance[Swing]] = []
    for stance in stances:
        if fractions.index(stance.followup.end_fraction) < WIDE:
            yield stance
            continue
        waiting.append(stance)
        if len(waiting) >= patience:
            break
    yield from sorted(waiting, key=lambda stance: fractions.index(stance.followup.end_fraction))
    yield from stances


def _tracking(work: ArticulationTask, fractions: tuple[float, ...], fingers: Allowed) -> Validate[Swing]:
    """Return a validation that finds the best share of base and arm at a stance."""

    def validate(q: Array) -> tuple[Swing, float] | None:
        best: tuple[Swing, float] | None = None
        for rank, share in enumerate(shares(work.joint, work.T_root)):
            found = reachable_end(work, q, share, fractions, fingers)
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


def push_stances(work: ArticulationTask, here: Array) -> Iterator[Stance[Swing]]:
    """Yield stances from which the closed gripper pushes the panel to the action's end.

    Args:
        work, here: As for `rigid_stances`.
    """
    planner, handle = work.planner, work.handle
    asset = work.world.assets[work.object_id]
    opening = work.action.primitive is Primitive.ARTICULATE_OPEN
    panel = panel_of(asset, handle, inner=opening)
    if panel is None:
        return
    fingers = fingers_may_touch(work.planner.robot, f"{work.object_id}/{handle.link}")
    fractions = possible_fractions(work)
    if not fractions:
        return
    T_link = work.world.T_world_link(work.object_id, handle.link)
    for push in push_goals(planner.robot.hand, panel, T_link, work.T_root):

        def validate(q: Array, push: Push = push) -> tuple[Swing, float] | None:
            for rank, share in enumerate(shares(work.joint, work.T_root, pushing=True)):
                found = reachable_end(work, q, share, fractions, fingers, push)
                if found is not None:
                    swing = Swing(found[0], handle, "push", share, push, work.partial)
                    return swing, NARROW_COST * abs(fractions[0] - found[0]) + 0.02 * rank
            return None

        yield from search_stances(
            planner, [push.goal], here, validate=validate, turns_rad=SIDEWAYS_TURNS_RAD, batch=TRACKED_BATCH
        )


def _arc_is_free(work: ArticulationTask, arc: ArticulationPath, holding: Allowed) -> bool:
    """Return whether a rigid arc is free; distant rows come first, which finds walls sooner."""
    with work.leaving_start(holding):
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


def reachable_end(
    work: ArticulationTask,
    q: Array,
    share: Share,
    fractions: tuple[float, ...],
    fingers: Allowed,
    push: Push | None = None,
) -> tuple[float, float] | None:
    """Return the best end fraction of a tracked motion that is free throughout, and its joint margin; or None."""
    planner, end = work.planner, work.joint.position(fractions[0])
    if not _floor_allows(work, q, share, fractions[-1], push):
        return None
    # Most do not get far, and long steps find that sooner.
    for coarseness in (COARSE, 1):
        trajectory = _tracked(work, q, share, end, push, coarseness).trajectory
        free = _clear_rows(work, trajectory, fingers, push)
        if free < _rows_to(work, fractions[-1], trajectory):
            return None
    for fraction in fractions:
        rows, taken = _rows_to(work, fraction, trajectory), trajectory
        if rows > free:
            continue
        if push is not None and fraction != fractions[0] and not planner.robot.keeps_order:
            # A hand presses more and more until its end, so that a shorter push is no part of a longer one.
            tracked = _tracked(work, q, share, work.joint.position(fraction), push, 1)
            taken, rows = tracked.trajectory, len(tracked.trajectory.path)
            if not tracked.complete or _clear_rows(work, taken, fingers, push) < rows:
                continue
        last, joints = taken.path[rows - 1], taken.joints[rows - 1]
        leaves = can_step_back(planner, last, joints, fingers) if push else can_let_go(planner, last, joints, fingers)
        if leaves:
            return fraction, planner.kinematics.margin(taken.path[:rows, planner.robot.arm])
    return None


def _floor_allows(work: ArticulationTask, q: Array, share: Share, fraction: float, push: Push | None) -> bool:
    """Return whether the base can go along to a fraction of the joint's range, before any posture is solved for."""
    if work.planner.robot.keeps_order:
        return True
    end = work.joint.position(fraction)
    return _has_floor(work, _course(work, q, share, end, push, COARSE).bases[:, :3], end)


def _has_floor(work: ArticulationTask, bases: Array, end: float) -> bool:
    """Return whether bases (N, 3) on the way to a joint's end are not within furniture.

    On the way a door that stands open moves out of the base's way, so that only where it ends excludes anything.
    """
    planner, joint = work.planner, work.joint
    planner.effort.add(CANDIDATE_S)
    if joint.fraction(work.now) <= OPEN_FRACTION:
        return not planner.floor.taken(bases).any()
    with joints_at(planner, {(work.object_id, joint.name): end}):
        return not planner.floor.taken(bases[-1:]).any()


def _rows_to(work: ArticulationTask, fraction: float, trajectory: ArticulationPath) -> int:
    """Return the number of rows up to a fraction of the joint's range; more than there are where it falls short."""
    first, last = (next(iter(row.values())) for row in (trajectory.joints[0], trajectory.joints[-1]))
    if len(trajectory.path) < 2:
        return 2
    if last == first:
        # What is asked for is how it is: a shut door that is to be closed.
        return 1
    part = (work.joint.position(fraction) - first) / (last - first)
    return 1 + round((len(trajectory.path) - 1) * part)


def _clear_rows(work: ArticulationTask, trajectory: ArticulationPath, fingers: Allowed, push: Push | None) -> int:
    """Return the number of first rows that are free and within the motors' torque."""
    return min(_free_rows(work, trajectory, fingers, push), rows_within_torque(work.planner, trajectory, work.joint))


def _free_rows(work: ArticulationTask, trajectory: ArticulationPath, fingers: Allowed, push: Push | None) -> int:
    oracle, widest_m = work.planner.oracle, work.planner.kinematics.finger_upper_m
    holding_m = min(CORNERS * work.handle.thickness_m + 2 * ARC_CLEARANCE_M, widest_m)
    opening_m, allowed = (holding_m, NOTHING) if push is None else (0.0, fingers)
    allowed |= work.riders
    with work.leaving_start(allowed):
        for count, (q, joints) in enumerate(zip(trajectory.path, trajectory.joints, strict=True)):
            if oracle.hits(q, allowed=allowed, joints=joints, opening_m=opening_m, margin_m=ARC_CLEARANCE_M):
                return count
    return len(trajectory.path)


def _tracked(work: ArticulationTask, q: Array, share: Share, end: float, push: Push | None, coarseness: int) -> Tracked:
    return track(work.planner, q, work.object_id, work.joint, _course(work, q, share, end, push, coarseness))


def _course(
    work: ArticulationTask, q: Array, share: Share, end: float, push: Push | None, coarseness: int = 1
) -> Course:
    T_eef = work.planner.kinematics.forward(q)
    press = None if push is None else push.press
    return course(
        T_eef,
        q[work.planner.robot.base],
        work.joint,
        work.T_root,
        work.now,
        end,
        share,
        press=press,
        coarseness=coarseness,
    )


def tracked_path(work: ArticulationTask, q: Array, swing: Swing) -> tuple[Tracked, float]:
    """Return the path of a tracked motion from the hand's present pose, and how far off it stays [m].

    Args:
        q: (Q,) with the handle in the gripper, or the closed gripper at the panel.
        swing: The planned motion.
    """
    if swing.share is None:
        raise ValueError("a rigid arc is not tracked")
    along = _course(work, q, swing.share, work.joint.position(swing.end_fraction), swing.push)
    tracked = track(work.planner, q, work.object_id, work.joint, along)
    return tracked, residual_m(work.planner, tracked, along)


def motion_from_grasp(work: ArticulationTask, q: Array) -> Swing | None:
    """Return a tracked motion from the present grasp of the handle, for a grasp that was not planned for it.

    Args:
        q: (Q,) with the handle in the gripper.
    """
    fingers = fingers_may_touch(work.planner.robot, f"{work.object_id}/{work.handle.link}")
    for share in shares(work.joint, work.T_root):
        found = reachable_end(work, q, share, work.fractions, fingers)
        if found is not None:
            return Swing(found[0], work.handle, "whole-body arc", share)
    return None


Strategy = Callable[[ArticulationTask, Array], Iterator[Stance[Swing]]]
OPENING: tuple[tuple[Strategy, bool], ...] = (
    (rigid_stances, False),
    (tracked_stances, False),
    (rigid_stances, True),
    (tracked_stances, True),
    (push_stances, False),
    (push_stances, True),
)
"""Each strategy, and whether it may be partial; the rest is left to another stage."""

CLOSING: tuple[tuple[Strategy, bool], ...] = (
    (rigid_stances, False),
    (tracked_stances, False),
    (push_stances, False),
    (edge_stances, False),
    (rigid_stances, True),
    (tracked_stances, True),
    (push_stances, True),
    (edge_stances, True),
)
GOING_ON: tuple[tuple[Strategy, bool], ...] = (
    (push_stances, False),
    (rigid_stances, False),
    (tracked_stances, False),
    (push_stances, True),
)
"""For a joint that an earlier stage has moved partly."""

LOOKED_AT = 40  # Enough to find the obstacle.


def articulation_stances(
    planner: Planner,
    world: World,
    object_id: str,
    handles: tuple[Handle, ...],
    action: Action,
    here: Array,
    *,
    going_on: bool = False,
    serves: Serves = lambda _: True,
) -> Iterator[Iterator[Stance[Swing]]]:
    """Yield, strategy by strategy, the stances from which a joint can be moved.

    Args:
        planner: Synchronised with the world.
        handles: Those that will do, the preferred one first.
        action: ARTICULATE_OPEN or ARTICULATE_CLOSE, filled or not.
        here: (B,) where the base stands.
        going_on: Whether an earlier stage has moved the joint part of its range.
        serves: Whether a handle suits later subtasks; asked only where there are several. Others are tried last.
    """
    first = OPENING if action.primitive is Primitive.ARTICULATE_OPEN else CLOSING
    for useful in (True, False):
        for strategy, partial in GOING_ON if going_on else first:
            for handle in handles:
                if (len(handles) == 1 or serves(handle)) is not useful:
                    continue
                work = ArticulationTask(planner, world, object_id, handle, action, partial)
                if not partial or _has_a_rest(work):
                    yield strategy(work, here)


def _has_a_rest(work: ArticulationTask) -> bool:
    """Return whether a partial motion is of use: later stages can do the rest, or the flow leaves the amount open.

    What shuts not all the way is not shut.
    """
    opens = work.action.primitive is Primitive.ARTICULATE_OPEN or work.planner.robot.keeps_order
    open_amount = work.action.parameter is None and opens
    wanted = open_amount or bool(possible_fractions(replace(work, partial=False)))
    return wanted and bool(work.smaller)


def explain_failure(work: ArticulationTask, here: Array) -> Failure:
    """Return a failure: how far the hand stays off the handle and at which joint limits, or the obstacle.

    Args:
        here: (B,) where the base stands.
    """
    oracle, kinematics, handle = work.planner.oracle, work.planner.kinematics, work.handle
    T_link = work.world.T_world_link(work.object_id, handle.link)
    rigid = driving_carries(work.joint, work.T_root)
    goals = handle_goals(handle, T_link) if rigid else tilted_goals(handle, work.T_root, T_link, facing=handle.outward)
    holding = handle_contacts(work.planner.robot, work.object_id, handle)
    found = Unplanned(target=work.object_id, joint=work.joint.name)
    meets = first_obstruction(work)
    now = work.joint.fraction(work.now)
    if meets is not None and abs(meets.fraction - now) < abs(work.fractions[-1] - now):
        moving = f"{work.joint.name} of {work.object_id}"
        what = moving if meets.item is None else f"{meets.item}, which goes along with {moving},"
        message = f"{what} meets {meets.met} at {meets.fraction:.2f} of its range"
        found = replace(found, in_the_way=(meets.met,), free_to_fraction=round(meets.fraction, 2))
        return Failure(FailureKind.NO_PATH, message, (found,))
    at_grasp: Counter[str] = Counter()
    on_the_way: Counter[str] = Counter()
    out_of_reach = True
    candidates = list(itertools.islice(base_candidates(work.planner.robot, goals, here, HANDLE_TURNS_RAD), LOOKED_AT))
    for candidate in candidates:
        solutions = kinematics.solve(candidate.goal.T_world_eef, candidate.base, restarts=8)
        out_of_reach = out_of_reach and not solutions
        for solution in solutions[:1]:
            q = np.concatenate([candidate.base, solution.arm])
            hits = oracle.hits(q, opening_m=kinematics.finger_upper_m, allowed=holding)
            at_grasp.update(hit.other for hit in hits)
            if hits or not rigid:
                continue
            end = work.joint.position(work.fractions[-1])
            arc = carry_joint(work.planner.robot, q, work.object_id, work.joint, work.T_root, work.now, end)
            hit = oracle.first_hit(arc.path, allowed=holding, joints=arc.joints, opening_m=HOLDING_OPENING_M)
            on_the_way.update([f"{hit.mover} and {hit.other}"] if hit is not None else [])
    what = f"no way to move {work.joint.name} of {work.object_id}"
    if out_of_reach:
        miss = nearest_miss(kinematics, candidates)
        return Failure(FailureKind.UNREACHABLE, f"{what}: {miss.describe('its handle')}", (miss.added_to(found),))
    for when, met in (("at the handle", at_grasp), ("on the way", on_the_way)):
        if met:
            found = replace(found, in_the_way=tuple(name for name, _ in met.most_common(3)))
            return Failure(FailureKind.NO_PATH, f"{what}: {met.most_common(1)[0][0]} in the way {when}", (found,))
    message = f"{what}: the arm does not follow it from any stance that is free"
    return Failure(FailureKind.UNREACHABLE, message, (found,))
