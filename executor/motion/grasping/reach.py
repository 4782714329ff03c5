"""Stances for picking an item up, chosen together with the moves that are made right after."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

from executor.assets.model import Asset
from executor.geometry import Array, inverse
from executor.motion.grasping.grasps import item_goals
from executor.motion.grasping.rims import rim_goals
from executor.motion.grasping.top_grasps import top_goals
from executor.motion.planning.contacts import Allowed, fingers_may_touch, held_may_touch
from executor.motion.planning.moves import run_moves
from executor.motion.planning.oracle import Carried
from executor.motion.planning.paths import polyline
from executor.motion.planning.planner import Planner
from executor.motion.stances.candidates import CLOSE_REACHES_M, REACHES_M
from executor.motion.stances.stance import Stance, Validate, search
from executor.world.detectors import touching_bodies
from executor.world.world import World
from oag import Action

TURNS_RAD = (0.0, 0.3, -0.3)
WIDE_TURNS_RAD = (0.6, -0.6, 0.9, -0.9)
"""How far the base faces away from where the hand comes from; far only where nothing else is free."""

LIFT_CLEARANCE_M = 0.001
FINE_SHARE = 0.25
LIFTS_M = (0.15, 0.12, 0.10, 0.08, 0.05, 0.03)
"""How far an unfilled LIFT_EEF_UP lifts, the highest feasible one first."""


@dataclass(frozen=True, slots=True)
class Lift:
    """What a picking subtask does after the grasp.

    Attributes:
        moves: Its moves with all numbers filled in.
        at_rim: Whether the grasp is around the thing's wall, not around all of it.
    """

    moves: tuple[Action, ...]
    at_rim: bool = False


def pick_stances(
    planner: Planner,
    world: World,
    item: str,
    moves: tuple[Action, ...],
    here: Array,
    leads_on: Callable[[Array], bool] | None = None,
) -> Iterator[Stance[Lift]]:
    """Yields stances from which an item can be taken and the moves after the grasp can be made.

    Args:
        planner: Synchronised with the world.
        world: Where things are.
        item: The item's id.
        moves: The parameterised moves between the grasp and the end of the flow; unfilled lifts are chosen here.
        here: (3,) where the base stands.
        leads_on: Whether a hand at a pose (4, 4) can also put the item where it will have to; others come last.
    """
    asset: Asset = world.assets[item]
    goals, fingers = item_goals(asset, world.T_world_link(item)), fingers_may_touch(item)
    lift = _lifting(planner, world, item, moves, asset.graspable_width_m or min(asset.extent_m[:2]), at_rim=False)

    def lift_where(wanted: bool) -> Validate[Lift]:
        return lambda q: lift(q) if leads_on is None or leads_on(planner.kinematics.forward(q)) is wanted else None

    for validate in (lift,) if leads_on is None else (lift_where(True), lift_where(False)):
        for turns_rad in (TURNS_RAD, WIDE_TURNS_RAD):
            yield from search(planner, goals, here, validate=validate, allowed=fingers, turns_rad=turns_rad)


def rim_stances(
    planner: Planner, world: World, item: str, moves: tuple[Action, ...], here: Array
) -> Iterator[Stance[Lift]]:
    """Yields stances from which an item can be taken by its wall, if it has one, and the moves after can be made.

    Args:
        planner, world, item, moves, here: As for `pick_stances`.
    """
    rim = world.assets[item].rim
    if rim is None:
        return
    goals, fingers = rim_goals(world.assets[item], world.T_world_link(item)), fingers_may_touch(item)
    lift = _lifting(planner, world, item, moves, rim.thickness_m, at_rim=True)
    for turns_rad in (TURNS_RAD, WIDE_TURNS_RAD):
        yield from search(planner, goals, here, validate=lift, allowed=fingers, turns_rad=turns_rad)


def last_stances(
    planner: Planner, world: World, item: str, moves: tuple[Action, ...], here: Array
) -> Iterator[Stance[Lift]]:
    """Yields stances for what `pick_stances` and `rim_stances` have none for: near the item's top, or from close by.

    Args:
        planner, world, item, moves, here: As for `pick_stances`.
    """
    asset, T_item = world.assets[item], world.T_world_link(item)
    lift = _lifting(planner, world, item, moves, asset.graspable_width_m or min(asset.extent_m[:2]), at_rim=False)
    ways = (top_goals(asset, T_item), REACHES_M), (item_goals(asset, T_item), CLOSE_REACHES_M)
    for (goals, reaches_m), turns_rad in itertools.product(ways, (TURNS_RAD, WIDE_TURNS_RAD)):
        yield from search(
            planner,
            goals,
            here,
            validate=lift,
            allowed=fingers_may_touch(item),
            turns_rad=turns_rad,
            reaches_m=reaches_m,
        )


def _lifting(
    planner: Planner, world: World, item: str, moves: tuple[Action, ...], width_m: float, *, at_rim: bool
) -> Validate[Lift]:
    """Returns what decides whether an item that is held as wide as that can be lifted by the moves."""
    T_item = world.T_world_link(item)
    resting = held_may_touch(touching_bodies(world, item))
    options = [
        tuple(replace(a, parameter=v) if a.parameter is None else a for a, v in zip(moves, values, strict=True))
        for values in itertools.product(*(LIFTS_M if a.parameter is None else (None,) for a in moves))
    ]

    def lift(q: Array) -> tuple[Lift, float] | None:
        planner.oracle.carried = Carried(item, inverse(planner.kinematics.forward(q)) @ T_item)
        try:
            found = _first_lift(planner, q, options, resting, width_m / 2)
        finally:
            planner.oracle.carried = None
        return None if found is None else (Lift(found[0], at_rim), found[1])

    return lift


def _first_lift(
    planner: Planner, q: Array, options: list[tuple[Action, ...]], resting: Allowed, opening_m: float
) -> tuple[tuple[Action, ...], float] | None:
    """Returns the first of the moves that can be made from a grasp (10,), with its cost, or None."""
    for rank, filled in enumerate(options):
        path = run_moves(planner, q, list(filled))
        if path is None:
            continue
        way = polyline(path, base_share=FINE_SHARE) if len(path) > 1 else path[:0]
        if planner.oracle.first_hit(way, allowed=resting, opening_m=opening_m, margin_m=LIFT_CLEARANCE_M) is None:
            return filled, 0.02 * rank
    return None
