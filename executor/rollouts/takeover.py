"""Go on with a plan from wherever something else, such as a policy, has brought the robot and its world.

Detectors read the present facts, which replace those of the scene's start; the rest of the plan is proved again
from them. The interrupted subtask is entered where the hand already has what that step wants: behind GRASP with its
item between the fingers, at the articulation with its handle between them, else at the beginning. In that case the
hand is emptied first, and the base slides off what it or the arm leans on.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

import bddl
from bddl import Atom, Formula, Not
from executor.geometry import Array
from executor.planning.articulation_stances import gripped_handle
from executor.planning.collision import FINGERS, NOTHING, Allowed, CollisionOracle, held_may_touch
from executor.planning.collision import GRIPPER as HAND
from executor.planning.paths import base_move
from executor.planning.picks import HIGH_LIFTS_M
from executor.planning.planner import ARM_MARGIN_M, BASE_HEADINGS_RAD
from executor.records import Rollout
from executor.rollouts.checkpoint import Checkpoint
from executor.rollouts.goals import picked_up
from executor.rollouts.rollout import Conditions, Run
from executor.sim.detectors import GRIPPER, UnknownObject, fingers_touching, read, touching_bodies
from executor.sim.engine import GROUND, ROBOT
from executor.sim.world import World
from executor.skills.session import Hand
from oag import Action, ActionFlow, ObjectActionGraph, Primitive, Scene, SimpleTask, compose
from oag.model.symbols import ARTICULATIONS

NEAR_M = 0.01
"""Distance [m]: what is this near to the hand at a takeover may stay this near while the hand leaves."""

SLIDES_M = (0.03, 0.06, 0.10)
"""Distances [m] by which the base slides off what the robot leans on, the least first."""

LEAST_LIFT_M = 0.01
"""Lift [m] of a held item that is high enough already: the plan has a lift in it."""

_OPEN_SHARE = 0.9  # Of the gripper's opening: fingers that are farther apart have let go.
_READ = ("inside", "ontop", "open")  # Predicates of plans that detectors read for any two objects.


@dataclass(frozen=True, slots=True)
class Continuation:
    """How a plan goes on.

    Attributes:
        graph: The rest of the task, in the scene as it is now.
        first_step: Index of the next step in the first subtask's flow.
    """

    graph: ObjectActionGraph
    first_step: int


def checkpoint_of(world: World, finger_target_m: float) -> Checkpoint:
    """Return the present state of a world, whoever moved it.

    Args:
        world: It has been stepped, so that contacts are known.
        finger_target_m: Target of each finger [m].
    """
    hand, q = hand_in(world), np.asarray(world.robot.get_qpos(), dtype=float)[:10]
    return Checkpoint(
        packed=world.pack(),
        # Held at its present pose, not at its target, it presses no more on what may have stopped it.
        target=tuple(float(value) for value in q),
        finger_target_m=finger_target_m,
        steps=world.steps,
        held=hand.held,
        gripped=hand.gripped,
        lifted_from=tuple(sorted(hand.lifted_from)),
        released=tuple(sorted(hand.released)),
        state_hash="",
    )


def hand_in(world: World) -> Hand:
    """Return what both fingers press on, and what the hand is so near to that leaving it is allowed to touch."""
    held = next((name for name in world.dynamic_ids if fingers_touching(world, name) == len(FINGERS)), None)
    gripped = next(
        (
            name
            for name in world.articulated_ids
            if held is None and fingers_touching(world, name) == len(FINGERS) and gripped_handle(world, name)
        ),
        None,
    )
    supports = [] if held is None else [body for body in touching_bodies(world, held) if body != ROBOT]
    return Hand(held, gripped, held_may_touch(supports) if held else NOTHING, _nearby(world))


def _nearby(world: World) -> Allowed:
    found = set()
    for contact in world.contacts({ROBOT}):
        for near, far in ((contact.a, contact.b), (contact.b, contact.a)):
            of_the_hand = near.owner == ROBOT and near.link in HAND and contact.separation_m <= NEAR_M
            if of_the_hand and far.owner not in (ROBOT, GROUND):
                found.add((near.link, far.owner if far.owner in world.dynamic_ids else f"{far.owner}/{far.link}"))
    return frozenset(found)


def continuation(graph: ObjectActionGraph, subtask: int, world: World) -> Continuation:
    """Return how a task goes on from a subtask, with the facts that the detectors read in a world.

    Args:
        graph: The whole task as it was at the start.
        subtask: Index of the one that is not done.
    """
    hand, task = hand_in(world), graph.task
    now, *later = task.subtasks[subtask:]
    flow, first_step = _enter_flow(now, hand, world)
    begun = replace(now, flow=flow, init=_read_again(now.init, world), support_init=_support(now, world))
    left = replace(task, subtasks=(begun, *later))
    return Continuation(compose(left, scene=scene_now(graph.scene, world)), first_step)


def _enter_flow(subtask: SimpleTask, hand: Hand, world: World) -> tuple[ActionFlow, int]:
    """Return the rest of a subtask's flow, and the index of the step at which the hand stands."""
    flow = subtask.flow or ()
    primitives = [action.primitive for action in flow]
    if hand.held == subtask.target and Primitive.GRASP in primitives:
        rest = flow[primitives.index(Primitive.GRASP) + 1 :]
        return tuple(_fill_lift(action, hand.held, world) for action in rest), 0
    moving = next((index for index, primitive in enumerate(primitives) if primitive in ARTICULATIONS), None)
    if hand.gripped == subtask.target and moving is not None:
        return flow, moving
    opening_m = float(np.asarray(world.robot.get_qpos(), dtype=float)[10:12].sum())
    widest_m = float(np.asarray(world.robot.get_qlimits(), dtype=float)[10:12, 1].sum())
    slid = _slide_off(world, hand)
    if hand.held == subtask.target:
        return (*slid, *flow), 0
    if slid or opening_m < _OPEN_SHARE * widest_m:
        return (Action(Primitive.UNGRASP), *slid, *flow), 0
    return flow, 0


def _slide_off(world: World, hand: Hand) -> ActionFlow:
    """Return the base motion that takes the robot off what it leans on; empty where it leans on nothing.

    Motions are planned from states in which nothing but the hand touches anything. The slide is an action like
    others: it is proved, monitored and recorded with them.
    """
    q = np.asarray(world.robot.get_qpos(), dtype=float)
    with World(world.scene, oracle=True) as shown:
        oracle = CollisionOracle(shown)
        oracle.synchronize(world)
        oracle.opening_m = float(q[10:12].mean())

        def leans(at: Array, margin_m: float = 0.0) -> bool:
            hits = oracle.hits(at, margin_m=margin_m, allowed=hand.released)
            return any(hit.mover not in HAND and not hit.other.startswith(f"{ROBOT}/") for hit in hits)

        if not leans(q[:10]):
            return ()
        for distance_m, (primitive, heading_rad) in product(SLIDES_M, BASE_HEADINGS_RAD.items()):
            if not leans(base_move(q[:10], distance_m, float(q[2]) + heading_rad)[-1], ARM_MARGIN_M):
                return (Action(primitive, distance_m),)
    return ()


def _fill_lift(action: Action, held: str, world: World) -> Action:
    """Return an action with the number that navigation would have chosen for it: this hand did not navigate."""
    if action.primitive is Primitive.LIFT_EEF_UP and action.parameter is None:
        lifted_m = picked_up(Atom("inside", (held, GRIPPER)), world).measured.lifted_m or 0.0
        return replace(action, parameter=round(max(HIGH_LIFTS_M[-1] - lifted_m, LEAST_LIFT_M), 4))
    return action


def _read_again(formula: Formula, world: World) -> Formula:
    """Return the conjunction of the present truth of the atoms of a subtask's initial condition."""
    parts = [_literal(literal.atom, world) for literal in bddl.literals(formula) or ()]
    known = [part for part in parts if part is not None]
    return known[0] if len(known) == 1 else bddl.And(tuple(known)) if known else formula


def _support(subtask: SimpleTask, world: World) -> str | None:
    """Return what a subtask's target is on or in now, which may differ from its initial support."""
    if subtask.support_init is None or subtask.target not in world.dynamic_ids:
        return subtask.support_init
    others = dict.fromkeys((subtask.support_init, *world.assets))
    pairs = product(("ontop", "inside"), (name for name in others if name != subtask.target))
    return next((name for relation, name in pairs if read(Atom(relation, (subtask.target, name)), world).value), None)


def scene_now(scene: Scene, world: World) -> Scene:
    """Return the scene with the facts that the detectors read now, in place of those of its start.

    Facts that no detector decides are kept.
    """
    facts: dict[Atom, Formula] = {}
    kept: list[Formula] = []
    for fact in scene.facts:
        for literal in bddl.literals(fact) or ():
            found = _literal(literal.atom, world)
            if found is None:
                kept.append(literal.atom if literal.value else Not(literal.atom))
            else:
                facts[literal.atom] = found
    for atom in _relations(world):
        if (found := _literal(atom, world)) is not None and (not isinstance(found, Not) or atom in facts):
            facts[atom] = found
    return replace(scene, facts=(*kept, *facts.values()))


def _relations(world: World) -> Iterable[Atom]:
    """Yield the atoms that plans are about."""
    held = hand_in(world).held
    if held is not None:
        yield Atom("inside", (held, GRIPPER))  # Of two things between the fingers one is held, as hands are meant.
    for item in world.dynamic_ids:
        for relation, other in product(("ontop", "inside"), world.assets):
            if other != item:
                yield Atom(relation, (item, other))
    for fixture in world.articulated_ids:
        yield Atom("open", (fixture,))


def _literal(atom: Atom, world: World) -> Formula | None:
    """Return an atom, or its denial, as the detectors read it; None where they do not decide."""
    if atom.predicate not in _READ:
        return None
    try:
        value = read(atom, world).value
    except UnknownObject:
        return None
    return None if value is None else atom if value else Not(atom)


@dataclass(frozen=True, slots=True)
class Continued:
    """The outcome of going on with a plan.

    Attributes:
        rollout: The motion of the rest of the task; its scene is the episode's.
        how: What was left, and where it was entered.
        after: The checkpoint at the end.
    """

    rollout: Rollout
    how: Continuation
    after: Checkpoint


def continue_plan(
    graph: ObjectActionGraph,
    start: Checkpoint,
    subtask: int,
    seed: int,
    conditions: Conditions,
    *,
    only_one: bool = False,
) -> Continued:
    """Go on with a task's plan from a checkpoint that something else came to, and return the outcome.

    Args:
        graph: The whole task, in its concrete scene, as it was at the start.
        start: The present state (`checkpoint_of`).
        subtask: Index of the one that is not done.
        conditions: As for the episode.
        only_one: Whether to end after that subtask; all of the rest is proved nevertheless.

    Raises:
        PlanRefused: The rest of the plan is not proved from here; nothing was moved.
    """
    world, control = start.restore(graph.scene, lambda: None, physics=conditions.physics)
    with world:
        control.settle(world.timestep_s)  # Contacts are found by stepping.
        how = continuation(graph, subtask, world)
    run = Run(how.graph, graph.scene, seed, conditions=conditions)
    last = 1 if only_one else None
    rollout = run.from_checkpoint(start, 0, first_step=how.first_step, last=last)
    return Continued(rollout, how, run.after)
