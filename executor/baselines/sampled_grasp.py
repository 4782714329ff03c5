"""In the manner of RoboGen without its learned skills: sampled grasps, everything that needs a reward left out.

What makes up that manner, and is kept: a point is drawn on the surface of the thing, or on the link that is to move;
the hand comes to it along the surface's normal, turned as it happens, from 3 cm before it, by a motion that is free of
collisions; after `TRIES` draws without one the primitive has failed. What RoboGen gives to reinforcement learning, by
rewards that a model writes, is left out: moving a joint, lifting, carrying to a place. Its primitives are kept:
grasping and releasing.

What is kinder here than there: the normal is that of the point itself; the base stands where the hand is reached from.
What is harder: the fingers have to close on something and hold it by friction, there they suck.

Source: RoboGen (ICML 2024), `manipulation/gpt_primitive_api.py`: 100 tries of motion planning. Own code.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from types import MappingProxyType

import numpy as np

from executor.assets.surface import surface_of
from executor.baselines.standing import go, near_by, stance_before
from executor.geometry import Array, heading_of, transform
from executor.machine.extras import require
from executor.motion.articulation.work import Swing
from executor.motion.grasping.reach import Lift
from executor.motion.planning.candidates import HandGoal
from executor.motion.planning.moves import MOVES
from executor.primitives.driving import leave, next_of
from executor.primitives.library import LIBRARY, Runner
from executor.primitives.session import Session, StepResult
from executor.records.rollout import Failure, FailureKind
from oag import Action, Primitive
from oag.revision.measurements import Unplanned

TRIES = 100  # RoboGen's.
BEFORE_M = 0.03  # RoboGen's for a Panda.
_LEVEL = 0.2  # Of a normal: what points up or down more squarely can be faced from anywhere.


def navigate_to_target(session: Session, action: Action) -> StepResult:
    """Draws grasps until a free way leads to the begin of one, and drives there."""
    left = leave(session)
    if left.failure is not None:
        return replace(left, action=action)
    session = left.session
    session.look()
    target = session.subtask.target
    articulation = next_of(session, Primitive.ARTICULATE_OPEN, Primitive.ARTICULATE_CLOSE)
    handles = session.world.assets[target].handles
    followup: Swing | Lift = Lift(())
    link = None
    if articulation is not None and handles:
        followup, link = Swing(1.0, handles[0]), handles[0].link
    for goal in _drawn(session, link):
        stance = stance_before(session, [goal], BEFORE_M, followup)
        if stance is None:
            continue
        reached = go(
            replace(session, plan=replace(session.plan, stance=stance, journey=None)), stance.approach[0], action
        )
        if reached.failure is None or reached.failure.kind is not FailureKind.NO_PATH:
            return reached
    message = f"no free way leads to any of {TRIES} grasps that were drawn on {target}"
    found = Unplanned(target=target, stances_tried=TRIES)
    return session.done(action, failure=Failure(FailureKind.NO_PATH, message, (found,)))


def left_out(session: Session, action: Action) -> StepResult:
    """Does nothing: what this does would be learned."""
    return session.done(action)


LIBRARY_OF_SAMPLES: Mapping[Primitive, Runner] = MappingProxyType(
    {
        **LIBRARY,
        Primitive.NAVIGATE_TO_TARGET: navigate_to_target,
        Primitive.APPROACH: near_by(navigate_to_target),
        Primitive.ARTICULATE_OPEN: left_out,
        Primitive.ARTICULATE_CLOSE: left_out,
        Primitive.NAVIGATE_TO_SUPPORT: left_out,
        **{primitive: left_out for primitive in MOVES},
    }
)
"""Every primitive with the function that runs it in this manner."""


def _drawn(session: Session, link: str | None) -> Iterator[HandGoal]:
    """Yields hand poses on the surface of the target, or of one of its links, drawn by the episode's seed."""
    trimesh = require("trimesh", "sim")
    world, target = session.believed, session.subtask.target
    asset, rng = world.assets[target], session.planner.rng
    chosen = next(found for found in asset.links if link in (None, found.name))
    mesh = trimesh.util.concatenate([surface_of(shape) for shape in chosen.shapes if shape.collides])
    T = world.T_world_link(target, chosen.name)
    points, faces = trimesh.sample.sample_surface(mesh, TRIES, seed=int(rng.integers(2**31)))
    for point, face in zip(points, faces, strict=True):
        normal = T[:3, :3] @ mesh.face_normals[face]
        place = (T @ np.array([*point, 1.0]))[:3]
        yield HandGoal(transform(_along(-normal, float(rng.uniform(0.0, 2.0 * np.pi))), place), _faced(-normal, rng))


def _along(approach_axis: Array, roll_rad: float) -> Array:
    """Returns a (3, 3) hand orientation with a given approach axis, rolled about it."""
    beside = np.cross(approach_axis, [1.0, 0.0, 0.0] if abs(approach_axis[0]) < 0.9 else [0.0, 1.0, 0.0])
    beside /= np.linalg.norm(beside)
    closing = np.cos(roll_rad) * beside + np.sin(roll_rad) * np.cross(approach_axis, beside)
    return np.stack([np.cross(closing, approach_axis), closing, approach_axis], axis=1)


def _faced(approach_axis: Array, rng: np.random.Generator) -> float:
    """Returns the heading from which a pose is faced: along its approach, from anywhere where that is upright."""
    level = float(np.hypot(*approach_axis[:2]))
    return heading_of(approach_axis) if level > _LEVEL else float(rng.uniform(-np.pi, np.pi))
