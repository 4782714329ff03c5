"""NAVIGATE_TO_TARGET and RETREAT: drive to where the flow's next actions can be done, and out of there.

At a target the stance is chosen together with the grasp and with what comes after it: an arc of the door, or a lift.
Numbers that the flow gives are kept, open ones are chosen here.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import Any, Protocol, TypeVar

import numpy as np

from bddl import atoms
from executor.assets.asset_geometry import resting_top
from executor.assets.model import Asset, Handle, Region
from executor.geometry import Array, wrap_angle
from executor.planning.articulation import ArticulationTask
from executor.planning.articulation_stances import articulation_stances, explain_failure
from executor.planning.collision import NOTHING
from executor.planning.drives import Drive, Leg, drive_to, go_home, withdraw
from executor.planning.grasps import SIDEWAYS_RAD, item_goals, rim_goals
from executor.planning.openings import (
    Purpose,
    first_item_put_inside,
    handles_to_close,
    handles_to_open,
    open_joints,
)
from executor.planning.picks import (
    HIGH_LIFTS_M,
    LIFTS_M,
    LOW_LIFTS_M,
    MOST_NAMED_BLOCKERS,
    Lift,
    Pick,
    explain_pick_failure,
    explain_rim_failure,
    in_the_way,
)
from executor.planning.place_lookahead import PlacementLookahead
from executor.planning.planner import MOVES
from executor.planning.stances import HandGoal, Stance
from executor.planning.standing_up import standing_up_goals
from executor.planning.whereabouts import handles_of, regions_next_to, regions_of
from executor.records import Failure, FailureKind
from executor.sim.world import World
from executor.skills.push import push_search, pushes
from executor.skills.session import Session, StepResult
from executor.skills.upright import sets_upright
from executor.skills.way_out import WayOut, is_out, pulled_rad
from executor.system.effort import Obstructed
from oag import Action, Primitive, SimpleTask
from oag.measurements import RetreatMeasured, TargetDrive, TooWide, Unplanned
from oag.model.scene import UPRIGHT_DEG
from oag.sizes import Gripper

CANDIDATES = 6
"""How many stances or placements are tried for a free path before giving up."""

LOOKED_AT = 30
ARTICULATIONS_LOOKED_AT = 12
"""How many choices are examined for one that stands elsewhere; each of a door costs a check of its whole motion."""

ELSEWHERE_M = 0.25  # Places nearer to each other share their paths.
DRIVE_SPEED = 1.0  # Of the limits: nothing is near.
ARM_SPEED = 1.0
_ROUNDING_M = 1e-6
Step = tuple[int, Action]
"""An action and its index in the flow."""

RETREAT_SPEED = 0.9  # A little slower, near to what was let go of.


def next_of(session: Session, *primitives: Primitive) -> Step | None:
    """Return the next action of one of some kinds with its step index, the running step included, or None."""
    for index in range(session.step, len(session.flow)):
        if session.flow[index].primitive in primitives:
            return index, session.flow[index]
    return None


def moves_after(session: Session, primitive: Primitive) -> list[Step]:
    """Return the unbroken run of parameterised moves after the next action of a kind, with step indices."""
    found = next_of(session, primitive)
    later = [] if found is None else list(enumerate(session.flow))[found[0] + 1 :]
    return list(itertools.takewhile(lambda step: step[1].primitive in MOVES, later))


def support_of(subtask: SimpleTask) -> str:
    """Return the id of what a subtask's target is put on or in; its own where the subtask names none."""
    return subtask.support_goal or subtask.support_init or subtask.target


def regions_for(world: World, subtask: SimpleTask) -> list[Region]:
    """Return the support's regions that the goal is about: interiors for `inside`, else surfaces.

    An upright cup or can without a surface has its rim or its flat top. Interiors behind shut doors are left out while
    another one stands open: no hand gets into them.
    """
    support = support_of(subtask)
    inside = any(a.predicate == "inside" and support in a.args[1:] for a in atoms(subtask.goal))
    kind = "interior" if inside else "surface"
    regions = [region for region in world.assets[support].regions if region.kind == kind]
    stands = world.T_world_link(support)[2, 2] >= math.cos(math.radians(UPRIGHT_DEG))
    top = None if inside or not stands else resting_top(world.assets[support])
    regions = regions if top is None else [top]
    where = subtask.where
    if where is not None and where.part:
        return regions_of(world, support, regions, where)
    ways_in = {None, *(joint.name for joint in open_joints(world, support))}
    regions = [region for region in regions if region.joint in ways_in] or regions
    return regions if where is None else regions_next_to(world, subtask.target, support, regions, where)


def grip_width_m(asset: Asset) -> float:
    """Return the distance of the fingers when they hold a thing: the bar of its handle, or its own width."""
    if asset.handles:
        return asset.handles[0].thickness_m
    return asset.graspable_width_m if asset.graspable_width_m is not None else min(asset.extent_m[:2])


def fits_between(asset: Asset, gripper: Gripper) -> bool:
    """Return whether the fingers can close around all of a thing."""
    return grip_width_m(asset) <= gripper.widest_m + _ROUNDING_M


def misfit(target: str, asset: Asset, gripper: Gripper) -> Failure | None:
    """Return a failure when a thing is too wide for the gripper and has no rim to hold, else None."""
    if fits_between(asset, gripper) or asset.rim is not None:
        return None
    width_m = grip_width_m(asset)
    takes = f"the gripper opens to {gripper.opening_m * 1000:.0f} mm and takes at most {gripper.widest_m * 1000:.0f}"
    message = f"{target} is {width_m * 1000:.0f} mm wide, {takes}"
    return Failure(FailureKind.TOO_WIDE, message, (TooWide(round(width_m, 4), gripper.opening_m),))


class BaseChoice(Protocol):
    """A choice that includes a base pose."""

    @property
    def base(self) -> Array:
        """The base's pose (3,) that is driven to."""


Choice = TypeVar("Choice", bound=BaseChoice)
Planned = TypeVar("Planned")


def distinct_first(
    choices: Iterator[Choice], unreached: list[Array] | None = None, limit: int = LOOKED_AT
) -> Iterator[Choice]:
    """Yield choices in their order, but those near to an earlier base last: if that could not be reached, neither can
    they.

    Args:
        choices: Good ones first; each is asked for when the one before could not be driven to.
        unreached: Bases that no path led to before; those of the choices are added.
        limit: How many choices are examined for one that stands elsewhere.
    """
    bases = [] if unreached is None else unreached
    waiting: list[Choice] = []
    for choice in itertools.islice(choices, limit):
        base = choice.base[:2]
        if any(np.hypot(*(base - other)) < ELSEWHERE_M for other in bases):
            waiting.append(choice)
            continue
        bases.append(base)
        yield choice
    yield from waiting


def nearest_home(session: Session, plan: Callable[[], Planned], arm: Callable[[Planned], Array | None]) -> Planned:
    """Return the plan of the seed whose arm posture is nearest to home; of the episode's seed where one is tried.

    A hand gets to the same thing with the elbow on either side and the wrist turned either way, and from several
    places; random draws decide between them. As demonstrations all are equally good. But no policy can learn a choice
    that does not follow from observations, and the mean of two postures reaches nowhere. With several `session.stances`
    the same few seeds are tried in every episode, so that the choice follows from the scene.

    Args:
        session: The execution's state; the arm is at home, or holds something.
        plan: Plans by the planner's seed.
        arm: The posture (A,) that a plan has the arm take; None where planning found nothing.
    """
    if session.stances == 1:
        return plan()
    found: list[tuple[float, int, Planned]] = []
    for seed in range(session.stances):
        session.planner.reseed(seed)
        planned = plan()
        posture = arm(planned)
        away_rad = np.inf if posture is None else float(np.abs(posture - np.array(session.planner.robot.home)).sum())
        found.append((away_rad, seed, planned))
    _, seed, planned = min(found, key=lambda one: one[:2])
    session.planner.reseed(seed)
    return planned


def follow_legs(session: Session, legs: Sequence[Leg]) -> Failure | None:
    """Move along the legs of a journey; return why one ended early, or None."""
    for name, path in legs:
        speed = DRIVE_SPEED if name == "drive" else ARM_SPEED
        allowed = session.hand.lifted_from if name == "back out" else NOTHING
        failure = session.control.follow(path, speed=speed, monitor=session.monitor(allowed))
        if failure is not None:
            return failure
    return None


def retreat(session: Session, action: Action) -> StepResult:
    """Withdraw the hand from what it let go of and bring the arm home; with an item in hand only back off."""
    if session.hand.held is not None:
        return _retreat_holding(session, action)
    before = session.q
    left = leave(session)
    by, arrived_m = session.q[:2] - before[:2], session.plan.arrived_m
    plan = replace(session.plan, arrived_m=(arrived_m[0] + float(by[0]), arrived_m[1] + float(by[1])))
    return replace(left, session=replace(left.session, plan=plan), action=action)


def leave(session: Session) -> StepResult:
    """Withdraw an empty hand and bring the arm home; do nothing where it is home already or holds something."""
    action, hand = Action(Primitive.RETREAT, None), session.hand
    if hand.gripped is not None:
        message = f"the gripper holds the handle of {hand.gripped}; UNGRASP comes before the robot leaves"
        unplanned = Unplanned(gripped=hand.gripped)
        return session.done(action, failure=Failure(FailureKind.PRECONDITION, message, (unplanned,)))
    if hand.held is not None or session.is_home:
        return session.done(action, RetreatMeasured(already_home=True))
    session.sync_planner()
    plan = withdraw(session.planner, session.q, allowed=hand.released)
    if plan is None:
        near = tuple(hit.other for hit in session.planner.oracle.hits(session.q))
        message = "no free way takes the hand back from " + (", ".join(near) if near else "where it is")
        return session.done(action, failure=Failure(FailureKind.NO_PATH, message, (Unplanned(near=near),)))
    failure = session.control.follow(plan.back_off, speed=RETREAT_SPEED, monitor=session.monitor(hand.released))
    if failure is None:
        failure = session.control.follow(plan.home, speed=RETREAT_SPEED, monitor=session.monitor())
    rows = RetreatMeasured(back_off_rows=len(plan.back_off), home_rows=len(plan.home))
    return replace(session, hand=replace(hand, released=NOTHING)).done(action, rows, failure=failure)


def _retreat_holding(session: Session, action: Action) -> StepResult:
    session.sync_planner()
    path = go_home(session.planner, session.q, lambda end: is_out(session, end), pulled_rad(session))
    if path is None:
        message = f"no free way back with {session.hand.held} in the hand"
        return session.done(action, failure=Failure(FailureKind.NO_PATH, message))
    monitor = session.monitor(session.hand.lifted_from)
    return session.done(action, failure=session.control.follow(path, speed=RETREAT_SPEED, monitor=monitor))


_NOT_HELD_UP = frozenset({Primitive.RETREAT, Primitive.UNGRASP})


def navigate_to_target(session: Session, action: Action) -> StepResult:
    """Drive to a stance from which the target can be grasped, and the flow's next actions can be done."""
    left = leave(session)
    if left.failure is not None:
        return replace(left, action=action)
    planned = nearest_home(left.session, lambda: with_stance(left.session), _arm_at_target)
    return left.session.done(action, failure=planned) if isinstance(planned, Failure) else _drive(planned, action)


def _arm_at_target(planned: Session | Failure) -> Array | None:
    stance = planned.plan.stance if isinstance(planned, Session) else None
    return None if stance is None else np.asarray(stance.q[stance.robot.arm])


def with_stance(session: Session) -> Session | Failure:
    """Choose a stance at the target and the journey to it; return the session with both, or why there is none."""
    session.sync_planner()
    world, planner, target = session.believed, session.planner, session.subtask.target
    asset = world.assets[target]
    articulation = next_of(session, Primitive.ARTICULATE_OPEN, Primitive.ARTICULATE_CLOSE)
    pushing = push_search(session) if pushes(session.subtask) else None
    if pushing is not None:
        where = f"the place behind {target}"
        planned = adopt_first(session, lambda _: iter([pushing.stances()]))
    elif articulation is not None and asset.handles:
        action = articulation[1]
        handles = tuple(bar for bar in _handles_for(session, action) if asset.joint(bar.joint).opens)
        if not handles:
            message = f"a handle of {target} moves too little to open anything"
            return Failure(FailureKind.PRECONDITION, message, (Unplanned(target=target),))
        where = f"the handle of {target}"
        serves = _purpose(session, action).serves
        here = session.q[session.planner.robot.base]

        def swings(narrowed: bool) -> Iterator[Iterator[Stance[Any]]]:
            suits = (lambda _: True) if narrowed else serves
            return articulation_stances(planner, world, target, handles, action, here, serves=suits)

        planned = adopt_first(session, swings)
    elif asset.motion == "dynamic":
        if (failure := misfit(target, asset, session.gripper)) is not None:
            return failure
        where = target
        try:
            with planner.effort.impatient(planner.patience_s, lambda pair: _may_be_moved(session, pair)):
                planned = adopt_first(session, lambda narrowed: _picks(session, narrowed))
        except Obstructed as obstructed:
            planner.gave_up = True
            named = tuple(obstructed.met)[:MOST_NAMED_BLOCKERS]
            counted = f"{obstructed.met[named[0]]} of {obstructed.looked_at} configurations"
            message = f"no answer in the time: in the way of {target}, {named[0]} meet in {counted}"
            found = Unplanned(target=target, looked_at=obstructed.looked_at, in_the_way=named)
            return Failure(FailureKind.NO_ANSWER, message, (found,))
    else:
        message = f"{target} has no handle and is no item: the hand has nothing to go to"
        return Failure(FailureKind.PRECONDITION, message, (Unplanned(target=target),))
    if isinstance(planned, Session):
        return planned
    if planned == 0:
        if pushing is not None:
            return pushing.explain_failure()
        if articulation is not None and asset.handles:
            return explain_failure(
                ArticulationTask(planner, world, target, handles[0], articulation[1]),
                session.q[session.planner.robot.base],
            )
        if not fits_between(asset, session.gripper) and not _is_stood_up(session):
            return explain_rim_failure(planner, world, target, session.q[session.planner.robot.base])
        goals_of = standing_up_goals if _is_stood_up(session) else item_goals
        return explain_pick_failure(
            planner,
            target,
            goals_of(planner.robot.hand, asset, world.T_world_link(target)),
            session.q[session.planner.robot.base],
        )
    blockers = in_the_way(planner, session.q, world.T_world_link(target)[:2, 3])
    near = f"; on the straight way there {' and '.join(blockers)} meet" if blockers else ""
    message = f"{planned} stances reach {where}, but no free way leads to any of them{near}"
    found = Unplanned(target=target, stances_tried=planned, in_the_way=blockers)
    return Failure(FailureKind.NO_PATH, message, (found,))


def _may_be_moved(session: Session, pair: str) -> bool:
    """Decide whether two bodies that meet are a part of the robot and an item that could be moved aside."""
    items = {part.partition("/")[0] for part in pair.split()}.intersection(session.world.dynamic_ids)
    return bool(items - {session.subtask.target})


def _picks(session: Session, narrowed: bool) -> Iterator[Iterator[Stance[Lift]]]:
    """Yield the strategies to pick the target: around all of it where that fits, by its rim, last resorts.

    A grasp that a search is narrowed to was found to allow the placement.
    """
    world, target = session.believed, session.subtask.target
    moves = tuple(action for _, action in moves_after(session, Primitive.GRASP))
    pick = Pick(session.planner, world, target, moves, session.q[session.planner.robot.base], _lifts_m(session))
    if _is_stood_up(session):
        yield pick.standing_up_stances(None if narrowed else _standing_up_check(session))
        return
    fits = fits_between(world.assets[target], session.gripper)
    later = [action.primitive for action in session.flow[session.step :]]
    leaves = Primitive.RETREAT in later and Primitive.UNGRASP not in later and not session.planner.robot.keeps_order
    # What a search is narrowed to was found with a way out, or after the patience for one.
    leaves = leaves and pulled_rad(session) is not None and not narrowed
    way_out = WayOut(session)
    for leads_out in (way_out.leads_out, None) if leaves else (None,):
        if leads_out is None and leaves and not way_out.stuck:
            return
        pick = replace(pick, leads_out=leads_out)
        if fits:
            yield pick.stances(None if narrowed else _placement_check(session))
        yield pick.rim_stances(None if narrowed else _rim_check(session))
        if fits:
            yield pick.last_stances()
        yield pick.narrow_rim_stances()


def _lifts_m(session: Session) -> tuple[float, ...]:
    """Return the candidate lifts of the target; a small one suffices for what is put elsewhere or backed out with."""
    goes_on = any(later.target == session.subtask.target for later in session.later)
    if any(action.primitive in _NOT_HELD_UP for action in session.flow[session.step :]):
        return LOW_LIFTS_M
    return LIFTS_M if goes_on else HIGH_LIFTS_M


def _rim_check(session: Session) -> Callable[[Array], bool] | None:
    """Return a test as of `_placement_check` for hands at the target's wall; None where there is nothing to test."""
    asset = session.believed.assets[session.subtask.target]
    if session.planner.robot.keeps_order or asset.rim is None:
        return None
    T_item = session.believed.T_world_link(session.subtask.target)
    return _placement_check(session, [*rim_goals(asset, T_item), *rim_goals(asset, T_item, SIDEWAYS_RAD)])


def _is_stood_up(session: Session) -> bool:
    """Return whether the target lies and is taken to be stood up."""
    target = session.subtask.target
    return any(one.target == target and sets_upright(one) for one in (session.subtask, *session.later))


def _standing_up_check(session: Session) -> Callable[[Array], bool] | None:
    """Return a test as of `_placement_check` for hands that stand the target up."""
    world, target = session.believed, session.subtask.target
    goals = standing_up_goals(world.model.hand, world.assets[target], world.T_world_link(target))
    return _placement_check(session, goals)


def _placement_check(session: Session, goals: list[HandGoal] | None = None) -> Callable[[Array], bool] | None:
    """Return a test of hand poses for the placement of a later subtask; None where no subtask places the target."""
    world, target = session.believed, session.subtask.target
    for later in session.later:
        if later.target == target and later.support_goal in session.world.assets:
            if goals is None:
                goals = item_goals(world.model.hand, world.assets[target], world.T_world_link(target))
            regions = regions_for(session.world, later)
            lookahead = PlacementLookahead(
                session.planner,
                world,
                target,
                goals,
                later.support_goal,
                regions,
                session.q[session.planner.robot.base],
            )
            return lookahead.allows_placement
    return None


def _purpose(session: Session, action: Action) -> Purpose:
    """Return the purpose of an opening: later subtasks may put something inside."""
    world, target = session.believed, session.subtask.target
    item = (
        first_item_put_inside(world, target, session.later) if action.primitive is Primitive.ARTICULATE_OPEN else None
    )
    return Purpose(session.planner, world, target, action, item, session.q[session.planner.robot.base])


def _handles_for(session: Session, action: Action) -> tuple[Handle, ...]:
    """Return the handles that an articulation of the target may take, the preferred one first."""
    target, where = session.subtask.target, session.subtask.where
    named = () if where is None else handles_of(session.believed, target, where)
    if action.primitive is Primitive.ARTICULATE_CLOSE:
        # The goal wants all of it shut; the named part is shut first.
        return tuple(sorted(handles_to_close(session.believed, target), key=lambda bar: bar not in named))
    if where is not None:
        return named
    wanted = handles_to_open(session.believed, target, session.later)
    return tuple(handle for handle in wanted if (target, handle.joint) not in session.avoided) or wanted


Strategies = Callable[[bool], Iterator[Iterator[Stance[Any]]]]
"""Makes the strategies of a search, by whether it is narrowed to a choice."""


def adopt_first(session: Session, strategies: Strategies) -> Session | int:
    """Plan the first stance that a free path leads to, what the dry run chose before all others.

    Returns:
        The session with it, or the number of stances tried.
    """
    anchor = session.believed.T_world_link(session.subtask.target)
    for choice in session.kept_for_step():
        with session.planner.narrowed_to(choice, anchor):
            planned = _first_adopted(session, strategies(True))
        if isinstance(planned, Session):
            return planned
    return _first_adopted(session, strategies(False))


def _first_adopted(session: Session, strategies: Iterator[Iterator[Stance[Any]]]) -> Session | int:
    tried = 0
    unreached: list[Array] = []
    limit = LOOKED_AT if session.subtask.target in session.world.dynamic_ids else ARTICULATIONS_LOOKED_AT
    for stances in strategies:
        for stance in itertools.islice(distinct_first(stances, unreached, limit), CANDIDATES):
            tried += 1
            journey = drive_to(session.planner, session.q, stance.approach[0])
            if journey is not None:
                return _adopted(session, stance, journey)
    return tried


def _adopted(session: Session, stance: Stance[Any], journey: Drive) -> Session:
    # The journey may count the base's yaw in another turn than the stance did.
    turned = stance.turned(float(journey.end[2] - stance.approach[0, 2]))
    session.planner.choose(session.step, stance.q, session.believed.T_world_link(session.subtask.target))
    plan = replace(session.plan, stance=turned, journey=journey)
    if isinstance(stance.followup, Lift):
        plan = plan.with_numbers((step for step, _ in moves_after(session, Primitive.GRASP)), stance.followup.moves)
    return replace(session, plan=plan)


def _drive(session: Session, action: Action) -> StepResult:
    """Drive the journey's legs but the last posture change, which belongs to APPROACH."""
    journey, stance = session.plan.journey, session.plan.stance
    if journey is None or stance is None:
        raise RuntimeError("a stance must be planned before it is driven to")
    legs = journey.legs
    last = legs[-1:] if legs[-1][0] == "take up the goal posture" else ()
    start = session.q
    failure = follow_legs(session, legs[: len(legs) - len(last)])
    if failure is None:
        session.drift(start)
    measured = TargetDrive(
        base_x_m=round(float(session.q[0]), 4),
        base_y_m=round(float(session.q[1]), 4),
        base_yaw_deg=round(float(np.rad2deg(wrap_angle(float(session.q[2])))), 2),
        joint_margin_deg=round(float(np.rad2deg(stance.margin_rad)), 1),
        legs=len(journey.legs),
        suits_place=stance.followup.suits_place if isinstance(stance.followup, Lift) else None,
    )
    plan = replace(
        session.plan,
        journey=Drive(last) if last else None,
        arrived_m=(float(session.q[0]), float(session.q[1])),
        aside_m=(0.0, 0.0),
    )
    return replace(session, plan=plan).done(action, measured, failure=failure)
