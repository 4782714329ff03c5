"""Stances for taking hold of a thing, chosen together with what is done with it right after: lifting or an arc."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass, replace

from executor.assets.model import Asset, Handle, Joint
from executor.detectors import touching_bodies
from executor.geometry import Array, inverse
from executor.motion.articulate import OPEN_FRACTIONS, carry_joint
from executor.motion.contacts import Allowed, fingers_may_touch, held_may_touch
from executor.motion.grasps import handle_goals, item_goals
from executor.motion.moves import run_moves
from executor.motion.oracle import Carried
from executor.motion.paths import polyline
from executor.motion.planner import Planner
from executor.motion.stance import Stance, search
from executor.motion.withdraw import back_off
from executor.world import World
from oag import Action, Primitive

LIFTS_M = (0.15, 0.12, 0.10, 0.08)
"""How far an unfilled LIFT_EEF_UP lifts, the highest feasible one first."""

HOLDING_OPENING_M = 0.01
ARC_CLEARANCE_M = 0.003
HANDLE_TURNS_RAD = (0.0, 0.2, -0.2, 0.4, -0.4)
NARROW_COST = 2.0
"""Cost in rad of joint margin for each unit of a joint's range that stays shut."""


@dataclass(frozen=True, slots=True)
class Swing:
    """What an articulation subtask does after the grasp: the fraction of the joint's range it ends at."""

    end_fraction: float


@dataclass(frozen=True, slots=True)
class Lift:
    """What a picking subtask does after the grasp: its moves with all numbers filled in."""

    moves: tuple[Action, ...]


def handle_contacts(object_id: str, handle: Handle) -> Allowed:
    """Returns the contacts that holding a handle means."""
    return fingers_may_touch(f"{object_id}/{handle.link}", hand=True)


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


def articulation_stances(
    planner: Planner, world: World, object_id: str, handle: Handle, action: Action, here: Array
) -> Iterator[Stance[Swing]]:
    """Yields stances at a handle from which the joint can be carried to where the action says.

    Args:
        planner: Synchronised with the world.
        world: Where things are.
        object_id: The articulated object.
        handle: Its handle.
        action: ARTICULATE_OPEN or ARTICULATE_CLOSE, filled or not.
        here: (3,) where the base stands.
    """
    asset = world.assets[object_id]
    joint = asset.joint(handle.joint)
    now = world.joint_position(object_id, joint.name)
    T_root = world.T_world_link(object_id)
    holding = handle_contacts(object_id, handle)
    fractions = end_fractions(action, joint, joint.fraction(now))

    def validate(q: Array) -> tuple[Swing, float] | None:
        for fraction in fractions:
            arc = carry_joint(q, object_id, joint, T_root, now, joint.position(fraction))
            hit = planner.oracle.first_hit(
                arc.path, allowed=holding, joints=arc.joints, opening_m=HOLDING_OPENING_M, margin_m=ARC_CLEARANCE_M
            )
            if hit is not None:
                continue
            if not _can_let_go(planner, arc.path[-1], arc.joints[-1], holding):
                continue
            return Swing(fraction), NARROW_COST * (fractions[0] - fraction)
        return None

    goals = handle_goals(handle, world.T_world_link(object_id, handle.link))
    return search(planner, goals, here, validate=validate, allowed=holding, turns_rad=HANDLE_TURNS_RAD)


def pick_stances(
    planner: Planner, world: World, item: str, moves: tuple[Action, ...], here: Array
) -> Iterator[Stance[Lift]]:
    """Yields stances from which an item can be taken and the moves after the grasp can be made.

    Args:
        planner: Synchronised with the world.
        world: Where things are.
        item: The item's id.
        moves: The parameterised moves between the grasp and the end of the flow; unfilled lifts are chosen here.
        here: (3,) where the base stands.
    """
    asset: Asset = world.assets[item]
    T_item = world.T_world_link(item)
    resting = held_may_touch(touching_bodies(world, item))
    width_m = asset.graspable_width_m or min(asset.extent_m[:2])
    options = [
        tuple(replace(a, parameter=v) if a.parameter is None else a for a, v in zip(moves, values, strict=True))
        for values in itertools.product(*(LIFTS_M if a.parameter is None else (None,) for a in moves))
    ]

    def validate(q: Array) -> tuple[Lift, float] | None:
        planner.oracle.carried = Carried(item, inverse(planner.kinematics.forward(q)) @ T_item)
        try:
            for rank, filled in enumerate(options):
                path = run_moves(planner, q, list(filled))
                if path is None:
                    continue
                free = (
                    len(path) < 2
                    or planner.oracle.first_hit(polyline(path), allowed=resting, opening_m=width_m / 2) is None
                )
                if free:
                    return Lift(filled), 0.02 * rank
            return None
        finally:
            planner.oracle.carried = None

    goals = item_goals(asset, T_item)
    return search(planner, goals, here, validate=validate, allowed=fingers_may_touch(item))


def _can_let_go(planner: Planner, q: Array, joints: dict[tuple[str, str], float], holding: Allowed) -> bool:
    """Decides whether the hand gets away from the handle where the joint ends."""
    oracle = planner.oracle
    before = {key: oracle.joint_position(key) for key in joints}
    for key, position in joints.items():
        oracle.set_joint(key, position)
    try:
        return back_off(planner, q, allowed=holding) is not None
    finally:
        for key, position in before.items():
            oracle.set_joint(key, position)
