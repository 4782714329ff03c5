"""Baseline in the manner of RoboGen without its learned skills: sampled grasps, without everything that needs a reward.

Kept from RoboGen: a point is drawn on the surface of the thing, or on the link that is to move. The hand approaches
along the surface's normal with a random roll, from 3 cm before it, by a collision-free motion. After `TRIES` draws
without one the primitive has failed. RoboGen leaves moving a joint, lifting and carrying to reinforcement learning,
with rewards that a model writes; these are left out. Its primitives are kept: grasping and releasing.

More favourable than RoboGen: the normal is that of the point itself, and the base stands where the hand is reachable.
Harder: the fingers have to close on something and hold it by friction, where RoboGen's gripper sucks.

Source: RoboGen (ICML 2024), `manipulation/gpt_primitive_api.py`: 100 tries of motion planning. Own code.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from types import MappingProxyType

import numpy as np

from benchmarks.baselines.base_stances import approach_by, drive_to_stance, stance_before
from executor.assets.asset_geometry import shape_mesh
from executor.geometry import Array, heading_of, transform
from executor.planning.articulation import Swing
from executor.planning.picks import Lift
from executor.planning.planner import MOVES
from executor.planning.stances import HandGoal
from executor.records import Failure, FailureKind
from executor.skills.library import LIBRARY, Runner
from executor.skills.navigate import leave, next_of
from executor.skills.session import Session, StepResult
from executor.system.extras import require
from oag import Action, Primitive
from oag.measurements import Unplanned

TRIES = 100  # RoboGen's.
BEFORE_M = 0.03  # RoboGen's for a Panda.
_LEVEL = 0.2  # Horizontal part of a normal; below it any heading faces the point.


def navigate_to_target(session: Session, action: Action) -> StepResult:
    """Sample grasps until a free path leads to the begin of one, and drive there."""
    left = leave(session)
    if left.failure is not None:
        return replace(left, action=action)
    session = left.session
    session.sync_planner()
    target = session.subtask.target
    articulation = next_of(session, Primitive.ARTICULATE_OPEN, Primitive.ARTICULATE_CLOSE)
    handles = session.world.assets[target].handles
    followup: Swing | Lift = Lift(())
    link = None
    if articulation is not None and handles:
        followup, link = Swing(1.0, handles[0]), handles[0].link
    for goal in _sample_hand_goals(session, link):
        stance = stance_before(session, [goal], BEFORE_M, followup)
        if stance is None:
            continue
        reached = drive_to_stance(
            replace(session, plan=replace(session.plan, stance=stance, journey=None)), stance.approach[0], action
        )
        if reached.failure is None or reached.failure.kind is not FailureKind.NO_PATH:
            return reached
    message = f"no free way leads to any of {TRIES} grasps that were drawn on {target}"
    found = Unplanned(target=target, stances_tried=TRIES)
    return session.done(action, failure=Failure(FailureKind.NO_PATH, message, (found,)))


def skip_primitive(session: Session, action: Action) -> StepResult:
    """Do nothing: RoboGen would learn this primitive."""
    return session.done(action)


LIBRARY_OF_SAMPLES: Mapping[Primitive, Runner] = MappingProxyType(
    {
        **LIBRARY,
        Primitive.NAVIGATE_TO_TARGET: navigate_to_target,
        Primitive.APPROACH: approach_by(navigate_to_target),
        Primitive.ARTICULATE_OPEN: skip_primitive,
        Primitive.ARTICULATE_CLOSE: skip_primitive,
        Primitive.NAVIGATE_TO_SUPPORT: skip_primitive,
        **{primitive: skip_primitive for primitive in MOVES},
    }
)
"""Every primitive with its runner in the manner of RoboGen."""


def _sample_hand_goals(session: Session, link: str | None) -> Iterator[HandGoal]:
    """Yield hand poses on the surface of the target, or of one of its links, drawn by the episode's seed."""
    trimesh = require("trimesh", "sim")
    world, target = session.believed, session.subtask.target
    asset, rng = world.assets[target], session.planner.rng
    chosen = next(found for found in asset.links if link in (None, found.name))
    mesh = trimesh.util.concatenate([shape_mesh(shape) for shape in chosen.shapes if shape.collides])
    T = world.T_world_link(target, chosen.name)
    points, faces = trimesh.sample.sample_surface(mesh, TRIES, seed=int(rng.integers(2**31)))
    for point, face in zip(points, faces, strict=True):
        normal = T[:3, :3] @ mesh.face_normals[face]
        place = (T @ np.array([*point, 1.0]))[:3]
        yield HandGoal(
            transform(_hand_orientation(-normal, float(rng.uniform(0.0, 2.0 * np.pi))), place),
            _approach_heading(-normal, rng),
        )


def _hand_orientation(approach_axis: Array, roll_rad: float) -> Array:
    """Return a (3, 3) hand orientation with a given approach axis, rolled about it."""
    across = np.cross(approach_axis, [1.0, 0.0, 0.0] if abs(approach_axis[0]) < 0.9 else [0.0, 1.0, 0.0])
    across /= np.linalg.norm(across)
    closing = np.cos(roll_rad) * across + np.sin(roll_rad) * np.cross(approach_axis, across)
    return np.stack([np.cross(closing, approach_axis), closing, approach_axis], axis=1)


def _approach_heading(approach_axis: Array, rng: np.random.Generator) -> float:
    """Return the heading of a pose: along its approach, or random where that is vertical."""
    level = float(np.hypot(*approach_axis[:2]))
    return heading_of(approach_axis) if level > _LEVEL else float(rng.uniform(-np.pi, np.pi))
