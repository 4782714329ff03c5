"""RETREAT, and what both navigations begin with: leave, look at the flow, choose a place, drive there."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import Protocol, TypeVar

import numpy as np

from bddl import atoms
from executor.assets.model import Asset, Region
from executor.geometry import Array
from executor.motion.articulation.doors import standing_open
from executor.motion.planning.carry import Leg
from executor.motion.planning.moves import MOVES
from executor.motion.planning.oracle import NOTHING
from executor.motion.planning.withdraw import go_home, withdraw
from executor.primitives.session import Session, StepResult
from executor.records.rollout import Failure, FailureKind
from executor.robot.description import ARM_HOME
from executor.world.world import World
from oag import Action, Primitive, SimpleTask
from oag.revision.measurements import RetreatMeasured, TooWide, Unplanned
from oag.task.sizes import Gripper

CANDIDATES = 6
"""How many stances or placements are tried for a free way before giving up."""

LOOKED_AT = 30
ARTICULATIONS_LOOKED_AT = 12
"""How many choices are looked at for one that stands elsewhere; a door's whole way is checked for each of its own."""

ELSEWHERE_M = 0.25  # Places nearer to each other share their ways.
DRIVE_SPEED = 1.0  # Of the limits: nothing is near.
ARM_SPEED = 1.0
_ROUNDING_M = 1e-6
_CORRECTING = (
    Primitive.MOVE_EEF_FORWARD,
    Primitive.MOVE_EEF_BACKWARD,
    Primitive.MOVE_EEF_LEFT,
    Primitive.MOVE_EEF_RIGHT,
)
Step = tuple[int, Action]
"""An action and its index in the flow."""

RETREAT_SPEED = 0.9  # A little slower, near to what was let go of.


def next_of(session: Session, *primitives: Primitive) -> Step | None:
    """Returns the next action of one of some kinds with its step index, the running step included, or None."""
    for index in range(session.step, len(session.flow)):
        if session.flow[index].primitive in primitives:
            return index, session.flow[index]
    return None


def moves_after(session: Session, primitive: Primitive) -> list[Step]:
    """Returns the unbroken run of parameterised moves after the next action of a kind, with step indices."""
    found = next_of(session, primitive)
    later = [] if found is None else list(enumerate(session.flow))[found[0] + 1 :]
    return list(itertools.takewhile(lambda step: step[1].primitive in MOVES, later))


def moves_before(session: Session, primitive: Primitive) -> list[Step]:
    """Returns the parameterised moves between the running step and the next action of a kind, with step indices."""
    moves: list[Step] = []
    for index in range(session.step + 1, len(session.flow)):
        if session.flow[index].primitive is primitive:
            return moves
        if session.flow[index].primitive in MOVES:
            moves.append((index, session.flow[index]))
    return []


def planned_moves(moves: list[Step]) -> list[Step]:
    """Returns the moves that planning ahead counts: all but the corrections.

    Straight sideways or forward moves of the hand between two LIFT_EEF_DOWN are corrections of the place, made over
    it. Counted in, they would be planned away: the base would stand elsewhere, and the thing end where it did before.
    """
    lowered = [place for place, (_, action) in enumerate(moves) if action.primitive is Primitive.LIFT_EEF_DOWN]
    return [
        (index, action)
        for place, (index, action) in enumerate(moves)
        if not lowered
        or not lowered[0] < place < lowered[-1]
        or action.primitive not in _CORRECTING
        or not isinstance(action.parameter, int | float)
    ]


def support_of(subtask: SimpleTask) -> str:
    """Returns the id of what a subtask's target is put on or in; its own where the subtask names none."""
    return subtask.support_goal or subtask.support_init or subtask.target


def regions_for(world: World, subtask: SimpleTask) -> list[Region]:
    """Returns the support's regions that the goal is about: interiors for `inside`, else surfaces.

    Interiors behind shut doors are left out while another one stands open: no hand gets into them.
    """
    support = support_of(subtask)
    inside = any(a.predicate == "inside" and support in a.args[1:] for a in atoms(subtask.goal))
    kind = "interior" if inside else "surface"
    regions = [region for region in world.assets[support].regions if region.kind == kind]
    ways_in = {None, *(joint.name for joint in standing_open(world, support))}
    return [region for region in regions if region.joint in ways_in] or regions


def grip_width_m(asset: Asset) -> float:
    """Returns how far apart the fingers are when they hold a thing: the bar of its handle, or its own width."""
    if asset.handles:
        return asset.handles[0].thickness_m
    return asset.graspable_width_m if asset.graspable_width_m is not None else min(asset.extent_m[:2])


def fits_between(asset: Asset, gripper: Gripper) -> bool:
    """Decides whether the fingers can close around all of a thing."""
    return grip_width_m(asset) <= gripper.widest_m + _ROUNDING_M


def misfit(target: str, asset: Asset, gripper: Gripper) -> Failure | None:
    """Returns a failure when a thing is too wide for the gripper and has no rim to be held by, else None."""
    if fits_between(asset, gripper) or asset.rim is not None:
        return None
    width_m = grip_width_m(asset)
    takes = f"the gripper opens to {gripper.opening_m * 1000:.0f} mm and takes at most {gripper.widest_m * 1000:.0f}"
    message = f"{target} is {width_m * 1000:.0f} mm wide, {takes}"
    return Failure(FailureKind.TOO_WIDE, message, (TooWide(round(width_m, 4), gripper.opening_m),))


class BaseChoice(Protocol):
    """Something that has the base stand somewhere."""

    @property
    def base(self) -> Array:
        """The base's pose (3,) that is driven to."""


Choice = TypeVar("Choice", bound=BaseChoice)
Planned = TypeVar("Planned")


def elsewhere_first(
    choices: Iterator[Choice], unreached: list[Array] | None = None, looked_at: int = LOOKED_AT
) -> Iterator[Choice]:
    """Yields choices in their order, but those near to an earlier one last: where no way led to that, none leads there.

    Args:
        choices: Good ones first; each is asked for when the one before could not be driven to.
        unreached: Bases that no way led to before; those of the choices are added.
        looked_at: How many choices are looked at for one that stands elsewhere.
    """
    bases = [] if unreached is None else unreached
    waiting: list[Choice] = []
    for choice in itertools.islice(choices, looked_at):
        base = choice.base[:2]
        if any(np.hypot(*(base - other)) < ELSEWHERE_M for other in bases):
            waiting.append(choice)
            continue
        bases.append(base)
        yield choice
    yield from waiting


def nearest_home(session: Session, plan: Callable[[], Planned], arm: Callable[[Planned], Array | None]) -> Planned:
    """Returns what planning comes to by the seed that has the arm nearest to home; by the episode's where one is tried.

    A hand gets to the same thing with the elbow on either side and the wrist turned either way, and from several
    places; which of them is taken, draws decide. A demonstration is as good with each; but what follows from nothing
    that is seen, no policy can learn, and the mean of two postures reaches nowhere. With several `session.stances` the
    same few seeds are tried in every episode, so that the choice follows from how things stand.

    Args:
        session: How the execution stands; the arm is at home, or holds something.
        plan: Plans by the planner's seed.
        arm: The posture (7,) that a plan has the arm take; None where planning found nothing.
    """
    if session.stances == 1:
        return plan()
    found: list[tuple[float, int, Planned]] = []
    for seed in range(session.stances):
        session.planner.reseed(seed)
        planned = plan()
        posture = arm(planned)
        away_rad = np.inf if posture is None else float(np.abs(posture - np.array(ARM_HOME)).sum())
        found.append((away_rad, seed, planned))
    _, seed, planned = min(found, key=lambda one: one[:2])
    session.planner.reseed(seed)
    return planned


def follow_legs(session: Session, legs: Sequence[Leg]) -> Failure | None:
    """Moves along the legs of a journey; returns why one ended early, or None."""
    for name, path in legs:
        speed = DRIVE_SPEED if name == "drive" else ARM_SPEED
        allowed = session.hand.lifted_from if name == "back out" else NOTHING
        failure = session.control.follow(path, speed=speed, monitor=session.monitor(allowed))
        if failure is not None:
            return failure
    return None


def retreat(session: Session, action: Action) -> StepResult:
    """Takes the hand away from what it let go of and brings the arm home; with an item in hand it only backs off."""
    if session.hand.held is not None:
        return _retreat_holding(session, action)
    before = session.q
    left = leave(session)
    by, arrived_m = session.q[:2] - before[:2], session.plan.arrived_m
    plan = replace(session.plan, arrived_m=(arrived_m[0] + float(by[0]), arrived_m[1] + float(by[1])))
    return replace(left, session=replace(left.session, plan=plan), action=action)


def leave(session: Session) -> StepResult:
    """Withdraws an empty hand and brings the arm home; nothing moves where it is home already or holds something."""
    action, hand = Action(Primitive.RETREAT, None), session.hand
    if hand.gripped is not None:
        message = f"the gripper holds the handle of {hand.gripped}; UNGRASP comes before the robot leaves"
        unplanned = Unplanned(gripped=hand.gripped)
        return session.done(action, failure=Failure(FailureKind.PRECONDITION, message, (unplanned,)))
    if hand.held is not None or session.is_home:
        return session.done(action, RetreatMeasured(already_home=True))
    session.look()
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
    session.look()
    path = go_home(session.planner, session.q)
    if path is None:
        message = f"no free way back with {session.hand.held} in the hand"
        return session.done(action, failure=Failure(FailureKind.NO_PATH, message))
    monitor = session.monitor(session.hand.lifted_from)
    return session.done(action, failure=session.control.follow(path, speed=RETREAT_SPEED, monitor=monitor))
