"""Baseline in the manner of MimicGen: one demonstration of a task, its segments transformed with their objects.

Kept from MimicGen: a demonstration is cut into segments, one per subtask, each with one reference object. In another
room each segment moves as its object has moved, with straight interpolation between segments. Everything is executed
open loop, through the environment by the paper's ten numbers. Nothing is planned, and failures are discarded: the yield
counts.

Added, since MimicGen's arms stand still: the base moves with the segment as the hand does, in the plane.

The demonstration is the executor's own, of the same family, and of T5 and T6 of the same pair of another set. Success
is the environment's: the goal has held at rest. Displaced bystanders do not count against it.

Source: MimicGen (CoRL 2023), object-centric segments, their transformation and interpolation. Own code.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from executor.bench.units import Unit
from executor.bench.work import Stopwatch
from executor.geometry import Array, heading_of, interpolate_poses, rotation_z, transform_from_quaternion, wrap_angle
from executor.rollouts.rollout import RECORD_HZ, rollout
from executor.scenes.generators.families import pair_of
from executor.sim.robot.actions import actions_between, arm_chain, joint_limits
from executor.sim.world import World
from executor.system.extras import require
from oag import Primitive, Scene, SimpleTask, compose
from oag.model.robots import Robot

ENTRY = "executor.envs:scene2demo/"
SOURCE_SEEDS = range(62_800, 62_805)
"""Seeds of demonstrations, from the development range that is never measured: the first, or another one where the
executor fails or does more than the plan has."""

DRIVE_M_S, TURN_RAD_S, HAND_M_S = 0.5, 0.8, 0.25  # Slower than planned motions: they are not checked for collisions.
WAITS_S = 5.0
_NAVIGATION = (Primitive.NAVIGATE_TO_TARGET.name, Primitive.NAVIGATE_TO_SUPPORT.name)


@dataclass(frozen=True, slots=True)
class HandPose:
    """Target of base, hand and fingers.

    Attributes:
        base: (3,) x, y [m] and yaw [rad].
        T_base_eef: (4, 4) the hand, from the base.
        opening: Opening of the fingers, as in hand actions.
    """

    base: Array
    T_base_eef: Array
    opening: float


@dataclass(frozen=True, slots=True)
class Segment:
    """Motion of a demonstration in one subtask, after its drive.

    Attributes:
        T_world_thing: (4, 4) pose of its reference object at its begin.
        moments: Targets, ten per second.
    """

    T_world_thing: Array
    moments: tuple[HandPose, ...]


class NoDemonstration(RuntimeError):
    """The executor did none of the tasks that a demonstration could be taken from."""


def source_seeds_text() -> str:
    """Describe the seeds of demonstrations."""
    return f"{SOURCE_SEEDS[0]} to {SOURCE_SEEDS[-1]}"


def reference_object(subtask: SimpleTask) -> str:
    """Return the reference object of a subtask's segment: the support of a placement, otherwise the target."""
    return subtask.support_goal or subtask.target


@lru_cache(maxsize=128)
def demonstration(family: str, index: int | None) -> tuple[Segment, ...]:
    """Return the segments of one successful demonstration.

    Raises:
        NoDemonstration: None of the first seeds gave one.
    """
    for seed in SOURCE_SEEDS:
        pair = pair_of(family, seed, index)
        done = rollout(compose(pair.task, scene=pair.scene), pair.scene, seed, vary=False)
        if not done.succeeded or done.detours:
            continue
        motion, segments = done.trajectory, []
        targets = np.asarray(motion.robot_target, dtype=float)
        for number, subtask in enumerate(pair.task.subtasks):
            steps = [step.primitive for step in done.subtasks[number].steps]
            driven = max((k for k, name in enumerate(steps) if name in _NAVIGATION), default=-1)
            rows = np.flatnonzero((motion.subtask == number) & ((motion.step > driven) | (motion.step < 0)))
            rows = rows[rows >= np.flatnonzero((motion.subtask == number) & (motion.step > driven))[0]]
            thing = reference_object(subtask)
            pose = motion.object_poses[thing][rows[0]] if thing in motion.object_poses else None
            T = _placed(pair.scene, thing) if pose is None else transform_from_quaternion(pose[:3], pose[3:])
            segments.append(Segment(T, tuple(_moments(pair.scene.robot.model, targets[rows]))))
        return tuple(segments)
    raise NoDemonstration(f"the executor did {family} {index} with none of the seeds {source_seeds_text()}")


def run_one_demonstration(unit: Unit) -> dict[str, Any]:
    """Return the result of a unit that executes one transformed demonstration, in the form of any other unit's."""
    watch = Stopwatch()
    segments = demonstration(unit.family, unit.index)
    watch.lap("demonstration")
    env = _environment(unit.family)
    try:
        env.reset(seed=unit.seed, options=None if unit.index is None else {"index": unit.index})
        episode = env.episode
        watch.lap("scene")
        good, stage = False, 0
        if len(segments) == len(episode.task.subtasks):
            for action in _actions(env, segments):
                _, _, good, _, info = env.step(action.astype(np.float32))
                stage = max(stage, int(info["stage"]))
                if good:
                    break
        watch.lap("rollout")
        names = [subtask.name for subtask in episode.task.subtasks]
        # The last one also needs the task's goal, at rest.
        done = min(stage, len(names) - 1)
        reached = f"the goal has not held; {stage} of {len(names)} subtasks did at some time"
        return {
            "query": episode.query,
            "scene": episode.scene.name,
            "subtask_names": names,
            "ended": "succeeded" if good else "failed",
            "failure": None if good else {"kind": "goal-not-reached", "message": reached, "measurements": {}},
            "subtasks": [{"name": name, "succeeded": good or k < done} for k, name in enumerate(names)],
            "simulated_s": float(env.world.time_s),
            "wall_s": watch.spent_s,
        }
    finally:
        env.close()


def transform_segment(segment: Segment, T_world_thing: Array) -> list[HandPose]:
    """Transform a segment to its object's new pose: moved and turned in the plane, and raised.

    Args:
        segment: Segment of the demonstration.
        T_world_thing: (4, 4) present pose of the object.
    """
    before, now = segment.T_world_thing, T_world_thing
    turn = wrap_angle(heading_of(now[:3, 0]) - heading_of(before[:3, 0]))
    R, raised = rotation_z(turn), np.array([0.0, 0.0, now[2, 3] - before[2, 3]])
    found = []
    for moment in segment.moments:
        at = now[:2, 3] + R[:2, :2] @ (moment.base[:2] - before[:2, 3])
        T = moment.T_base_eef.copy()
        T[:3, 3] += raised
        found.append(HandPose(np.array([*at, moment.base[2] + turn]), T, moment.opening))
    return found


def action_between(before: HandPose, after: HandPose) -> Array:
    """Return the (10,) hand action from one moment to the next."""
    # Headings are on the circle: take the shorter turn.
    yaw = before.base[2] + wrap_angle(float(after.base[2] - before.base[2]))
    base, opening = np.array([[*after.base[:2], yaw]]), np.array([after.opening])
    return actions_between(before.base[None], base, before.T_base_eef[None], after.T_base_eef[None], opening)[0]


def interpolate_moments(start: HandPose, end: HandPose) -> list[HandPose]:
    """Interpolate straight between two moments, without both ends: first the base, then the hand."""
    way_m, turn = end.base[:2] - start.base[:2], wrap_angle(float(end.base[2] - start.base[2]))
    longest_s = max(float(np.hypot(*way_m)) / DRIVE_M_S, abs(turn) / TURN_RAD_S)
    found = []
    for share in np.linspace(0.0, 1.0, int(np.ceil(longest_s * RECORD_HZ)) + 1)[1:]:
        base = np.array([*(start.base[:2] + share * way_m), start.base[2] + share * turn])
        found.append(HandPose(base, start.T_base_eef, start.opening))
    base = found[-1].base if found else start.base
    step_m = HAND_M_S / RECORD_HZ
    poses = interpolate_poses(start.T_base_eef, end.T_base_eef, step_m, 4.0 * step_m)
    return found + [HandPose(base, T, start.opening) for T in poses[:-1]]


def _environment(family: str) -> Any:
    """Return the environment of a family's episodes with hand actions and without a time limit."""
    gymnasium = require("gymnasium", "gym")
    options = {"action_mode": "paper", "rate_hz": RECORD_HZ, "max_episode_steps": -1, "disable_env_checker": True}
    return gymnasium.make(f"{ENTRY}{family}-v0", **options).unwrapped


def _actions(env: Any, segments: tuple[Segment, ...]) -> Iterator[Array]:
    """Yield the hand actions of the whole task; an object's pose is read when its segment begins."""
    (now,) = _moments(env.episode.scene.robot.model, env.target[None])
    for subtask, segment in zip(env.episode.task.subtasks, segments, strict=True):
        moments = transform_segment(segment, env.world.T_world_link(reference_object(subtask)))
        for after in (*interpolate_moments(now, moments[0]), *moments):
            yield action_between(now, after)
            now = after
    for _ in range(round(WAITS_S * RECORD_HZ)):
        yield action_between(now, now)


def _moments(robot: Robot, targets: Array) -> Iterator[HandPose]:
    """Yield the moments of joint targets (N, 12)."""
    widest_m = joint_limits(robot)[-1, 1]
    for target, T in zip(targets, arm_chain(robot).forward(targets[:, robot.arm]), strict=True):
        yield HandPose(target[robot.base].copy(), T, float(target[robot.fingers].mean() / widest_m))


def _placed(scene: Scene, thing: str) -> Array:
    """Return the (4, 4) pose of a fixed thing in a scene."""
    world = World(scene)
    try:
        return world.T_world_link(thing)
    finally:
        world.close()
