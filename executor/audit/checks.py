"""What an audit checks of an episode: its end, what comes after it, its start, its states, sentence, plan and assets.

Each check yields findings, and none of them asks the detectors, the goal check or the recorder.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

import bddl
from executor.assets.library import asset_hash
from executor.audit.decision import TILT_DEG, decide, named_spots
from executor.audit.geometry import ROBOT, Snapshot
from executor.data.units import DemoUnit
from executor.geometry import pose_vector, transform_from_quaternion
from executor.sim.robot.kinematics import Kinematics
from executor.sim.world import World
from llm import QueryError
from llm.offline.lexicon import built_in
from llm.offline.planner import understand
from oag import Scene, Task, compose
from oag.sizes import Sizing

Kind = Literal[
    "unreadable",
    "record",
    "states",
    "replay",
    "asset",
    "sentence",
    "plan",
    "start-goal",
    "start-moves",
    "start-fallen",
    "start-elsewhere",
    "start-overlap",
    "false-success",
    "false-failure",
    "undecided",
    "moving",
    "unstable",
]
"""Kinds of findings; `docs/datasets.md` says what each means."""

AFTER_S = 3.0
STILL_M_S, STILL_RAD_S = 0.05, 0.5
STAYS_M = 0.03
START_HOLDS_S = 0.5
START_MOVES_M = 0.01
ELSEWHERE_M = 0.05
OVERLAP_M = 0.005
AGREES_M = 1e-4
GRAVITY_M_S2 = 9.81
SLACK_M = 0.01


@dataclass(frozen=True, slots=True)
class Finding:
    """Something of an episode that is not as its record says.

    Attributes:
        kind: What.
        text: The sentence, with the objects and the numbers.
    """

    kind: Kind
    text: str


@dataclass(frozen=True)
class Recorded:
    """What is recorded of an episode.

    Attributes:
        unit: Its unit.
        scene: Its concrete scene.
        task: Its task from the scene's start.
        meta: Its `unit.json`.
        arrays: Its samples.
        begins_midway: Whether it goes on from where a policy came to.
    """

    unit: DemoUnit
    scene: Scene
    task: Task
    meta: Mapping[str, Any]
    arrays: Mapping[str, NDArray[Any]]
    begins_midway: bool

    @property
    def states(self) -> NDArray[np.float32]:
        """(N, L) its packed states."""
        return self.arrays["packed_states"]

    def state(self, row: int) -> bytes:
        """Return a row's packed state."""
        return bytes(self.states[row].tobytes())


def end(recorded: Recorded, world: World, scene_start: bytes) -> Iterator[Finding]:
    """Decide success again: at the last state, whether it is at rest, and three seconds later.

    Args:
        recorded: The episode.
        world: A world of its scene; its state is replaced.
        scene_start: Packed state that the scene is built in.
    """
    # A takeover may begin with the thing in the hand: how high it was is of the scene's start.
    began = scene_start if recorded.begins_midway else recorded.state(0)
    first, last = Snapshot(world, began), Snapshot(world, recorded.state(-1))
    goal, scene, succeeded = recorded.task.goal, recorded.scene, recorded.meta["ended"] == "succeeded"
    spots = named_spots(recorded.task)
    found = decide(goal, scene, first, last, spots)
    words = ", ".join(found.missing)
    if found.value is None:
        yield Finding("undecided", f"no second geometry decides {words}")
        return
    if not succeeded:
        if found.value:
            failure = recorded.meta.get("failure") or {}
            why = f" ({failure.get('kind')}: {failure.get('message')})" if failure else ""
            yield Finding("false-failure", f"it is recorded as failed{why}, and its goal holds in its last state")
        return
    if not found.value:
        yield Finding("false-success", f"it is recorded as succeeded, and in its last state does not hold: {words}")
        return
    yield from _moving(goal, last)
    world.unpack(recorded.state(-1))
    for _ in range(round(AFTER_S / world.timestep_s)):
        world.step()
    later = Snapshot(world, world.pack())
    after = decide(goal, scene, first, later, spots)
    if after.value is not True:
        yield Finding("unstable", f"{AFTER_S:g} s after its end no longer holds: {', '.join(after.missing)}")
    for name, moved_m in _moved(last, later).items():
        if not moved_m <= STAYS_M:
            yield Finding("unstable", f"{name} moves by {100 * moved_m:.1f} cm in the {AFTER_S:g} s after its end")


def _moving(goal: bddl.Formula, last: Snapshot) -> Iterator[Finding]:
    named = {name for atom in bddl.atoms(goal) for name in atom.args}
    for name in sorted(named & set(last.speeds)):
        linear, angular = last.speeds[name]
        if not (linear <= STILL_M_S and angular <= STILL_RAD_S):  # So that what is no number is found, here and below.
            yield Finding("moving", f"{name} moves by {linear:.2f} m/s and {angular:.2f} rad/s in the last state")
    for name in sorted(named & set(last.joint_speeds)):
        if not last.joint_speeds[name] <= STILL_RAD_S:
            yield Finding("moving", f"a joint of {name} moves by {last.joint_speeds[name]:.2f} in the last state")


def _moved(before: Snapshot, after: Snapshot) -> dict[str, float]:
    """Return by how much [m] each free body's middle has moved."""
    return {name: float(np.linalg.norm(after.middles[name] - at)) for name, at in before.middles.items()}


def start(recorded: Recorded, world: World) -> Iterator[Finding]:
    """Check the first state: goal not true yet, everything stands, as the scene has it, apart, and stays."""
    scene, first = recorded.scene, Snapshot(world, recorded.state(0))
    if decide(recorded.task.goal, scene, first, first, named_spots(recorded.task)).value:
        yield Finding("start-goal", "its goal holds in its first state already")
    for pair, touch in first.touches.items():
        if not touch.separation_m >= -OVERLAP_M:
            names = " and ".join(sorted(pair))
            yield Finding("start-overlap", f"{names} overlap by {-1e3 * touch.separation_m:.0f} mm in its first state")
    if not recorded.begins_midway:
        yield from _as_in_the_scene(scene, first)
    world.unpack(recorded.state(0))
    for _ in range(round(START_HOLDS_S / world.timestep_s)):
        world.step()
    for name, moved_m in _moved(first, Snapshot(world, world.pack())).items():
        # What the robot holds or nudges in that time moves by it.
        if not moved_m <= START_MOVES_M and not first.is_touched(ROBOT, name):
            words = f"{name} falls, slides or is pushed out by {100 * moved_m:.1f} cm after its first state"
            yield Finding("start-moves", words)


def _as_in_the_scene(scene: Scene, first: Snapshot) -> Iterator[Finding]:
    for name in first.middles:
        thing = scene.objects[name]
        T = transform_from_quaternion(thing.position, thing.orientation)
        off_m = float(np.linalg.norm(first.poses[name][:3, 3] - T[:3, 3]))
        if not off_m <= ELSEWHERE_M:
            yield Finding("start-elsewhere", f"{name} is {100 * off_m:.0f} cm off its place in the scene at the start")
        leans_deg = float(np.degrees(np.arccos(np.clip(first.poses[name][:3, 2] @ T[:3, 2], -1.0, 1.0))))
        if not leans_deg <= TILT_DEG and not first.is_ball(name):
            yield Finding("start-fallen", f"{name} leans by {leans_deg:.0f} degrees from the scene at the start")


def states(recorded: Recorded, world: World) -> Iterator[Finding]:
    """Check that the columns are those of the states, and that nothing jumps from one sample to the next."""
    arrays, names, joints = recorded.arrays, list(recorded.meta["object_ids"]), list(recorded.meta["joint_ids"])
    count = len(recorded.states)
    if count != int(recorded.meta["samples"]) or count < 2:
        yield Finding("states", f"it has {count} states, and says {recorded.meta['samples']} samples")
        return
    bodies = {body.entity.name: body for body in world.sapien_scene.physx_system.rigid_dynamic_components}
    named = {"objects": (set(names), set(bodies)), "joints": (set(joints), set(world.articulated_ids))}
    for what, (listed, there) in named.items():
        if listed != there:
            yield Finding("states", f"its {what} and those of its scene differ: {', '.join(sorted(listed ^ there))}")
            return
    poses, speeds = np.empty((count, len(names), 3)), np.empty((count, len(names)))
    hand = Kinematics(world.robot, world.model)
    for row in range(count):
        world.unpack(recorded.state(row))
        for place, name in enumerate(names):
            poses[row, place] = bodies[name].entity.pose.p
            speeds[row, place] = np.linalg.norm(bodies[name].linear_velocity)
        for column, off in _off_columns(arrays, row, world, names, joints, hand):
            if not off <= AGREES_M:
                words = f"{column} of sample {row} is {1e3 * off:.1f} thousandths off its state"
                yield Finding("states", words)
                return
    yield from _jumps(names, arrays["time_s"], poses, speeds)


def _off_columns(
    arrays: Mapping[str, NDArray[Any]],
    row: int,
    world: World,
    names: Sequence[str],
    joints: Sequence[str],
    hand: Kinematics,
) -> Iterator[tuple[str, float]]:
    """Yield each column of a row and by how much it differs most from a world's state; NaN where it is no number."""
    qpos = np.asarray(world.robot.qpos, dtype=float)
    bends = [world.joint_position(name, joint.name) for name in joints for joint in world.assets[name].joints]
    exact = {"robot_qpos": qpos, "robot_qvel": np.asarray(world.robot.qvel), "joint_positions": np.asarray(bends)}
    for column, values in exact.items():
        yield column, float(np.abs(values - arrays[column][row]).max(initial=0.0))
    there = world.root_poses(names) if names else np.zeros((0, 7))
    placed = {"object_poses": there, "eef_pose": pose_vector(hand.forward(qpos))[None]}
    for column, values in placed.items():
        known = arrays[column][row].reshape(values.shape)
        # Of a rotation there are two quaternions.
        signs = np.where((known[:, 3:] * values[:, 3:]).sum(axis=1, keepdims=True) < 0.0, -1.0, 1.0)
        off = np.concatenate([known[:, :3] - values[:, :3], signs * known[:, 3:] - values[:, 3:]], axis=1)
        yield column, float(np.abs(off).max(initial=0.0))


def _jumps(
    names: Sequence[str], time_s: NDArray[np.float64], poses: NDArray[np.float64], speeds: NDArray[np.float64]
) -> Iterator[Finding]:
    """Yield what moves farther between two samples than its speeds and a fall explain."""
    for row, (before_s, after_s) in enumerate(pairwise(time_s.tolist())):
        span_s = after_s - before_s
        if not span_s > 0.0:
            yield Finding("states", f"time does not go on after sample {row}")
            return
        gone = np.linalg.norm(poses[row + 1] - poses[row], axis=1)
        most = speeds[row : row + 2].max(axis=0) * span_s + 0.5 * GRAVITY_M_S2 * span_s**2 + SLACK_M
        for place in np.flatnonzero(~(gone <= most)).tolist():
            words = f"{names[place]} jumps by {100 * gone[place]:.1f} cm after sample {row}"
            yield Finding("states", f"{words}; {100 * most[place]:.1f} cm are explained by its speed and a fall")
            return


def record(recorded: Recorded, version: str) -> Iterator[Finding]:
    """Check that the unit's id is that of its request."""
    if recorded.meta["id"] not in recorded.unit.ids(version):
        yield Finding("record", f"its id is {recorded.meta['id']}, that of its request {recorded.unit.id(version)}")


def sentence(recorded: Recorded) -> Iterator[Finding]:
    """Check that the sentence, read again in the recorded scene, asks for the recorded goal."""
    query, unit, scene = str(recorded.meta.get("query") or ""), recorded.unit, recorded.scene
    if unit.origin.query and unit.origin.query != query:
        yield Finding("sentence", f"{query!r} is recorded, and {unit.origin.query!r} was asked for")
    try:
        meaning = understand(query, scene, built_in(), Sizing(unit.seed, unit.keep_sizes))
    except QueryError as refusal:
        yield Finding("sentence", f"{query!r} asks for nothing in the recorded scene ({refusal.code})")
        return
    if not bddl.equivalent(recorded.task.goal, meaning.goal, scene.categories):
        asked, goal = bddl.format(meaning.goal), bddl.format(recorded.task.goal)
        yield Finding("sentence", f"{query!r} asks for {asked}, and the goal is {goal}")


def plan(recorded: Recorded, executed: Task) -> Iterator[Finding]:
    """Check that the executed plan is proved, and is the one of the recorded certificate."""
    report = compose(executed, scene=recorded.scene).verify()
    if report.certificate is None:
        yield Finding("plan", f"its plan is {report.verdict.value.lower()}, not proved")
    elif report.certificate.task_hash != recorded.meta.get("certificate"):
        yield Finding("plan", "its certificate is of another plan or goal")


def assets(recorded: Recorded) -> Iterator[Finding]:
    """Check that every asset is built as it was when the episode was recorded."""
    known: Mapping[str, str] = recorded.meta.get("assets") or {}
    if not known:
        return  # Recorded by an earlier program.
    if missing := sorted(set(recorded.scene.objects) ^ set(known)):
        yield Finding("asset", f"hashes and objects of the scene differ: {', '.join(missing)}")
    for name, thing in recorded.scene.objects.items():
        if name in known and (found := asset_hash(thing)) != known[name]:
            yield Finding("asset", f"{name} is built as {found}, and was recorded as {known[name]}")
