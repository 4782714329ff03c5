"""Observations of a policy: numbers of plan steps, free space, state features; and augmentations of demonstrations.

A step's number is its subtask and the primitive of its flow. Driving to the refrigerator and driving to the glass are
the same primitive in different subtasks, so a policy observes both. In a task of one subtask it is the primitive's
number.

State features are the robot from its own base, and things and handles from base and hand. They follow from the
environment's observations and from data sets (`executor.data.state_readers`), alike in training and evaluation. Arrays
have one row per moment.

Free space is the target's corners, the hinge of its door, and distances to the nearest things. A door turns about the
edge farther from its handle. Of two doors side by side, with adjacent handles, it is the edge on the door's own side.
The hinge is read from the state at the episode's start, and not from a door open by more than 45 degrees, as where a
correction may begin. A neighbour blocks a hand that comes from its side. A thing counts as the upright box around it,
in top view. The base is blocked by whatever it meets: furniture stands on the floor, and what stands on furniture is
within its outline. A hand is blocked by what is as high as its target. Of an open door only its body counts.

Mirroring: arm and hand are symmetric about the plane of their base and the arm's first axis. A demonstration mirrored
in the room's x axis is therefore valid in the mirrored room, and teaches hinges and approach sides twice. Physics and
planner are not asked: only motions beyond some joint's limit are left out.

Base offsets: a drive goes through free room, so from a slightly offset base the same joint targets lead back. Plain
demonstrations of drives hardly show that, since each ends to the millimetre where it should. A policy that is a hand's
width off arrives where no demonstration continues, and the arm reaches beside the thing. Neither physics nor planner is
asked: robot, hand and held things move together, all else stays.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from executor.data.episode import CLOUD
from executor.data.state_readers import HANDLE, HANDLES, THING, THINGS
from executor.learn.settings import Sees
from executor.sim.robot.actions import joint_limits
from oag import Task
from oag.model.robots import Robot
from oag.model.symbols import OPPOSITE, Primitive

Count = TypeVar("Count", int, NDArray[np.int64])

_STEPS_PER_SUBTASK = 100  # More than there are primitives.

DRIVES = (Primitive.NAVIGATE_TO_TARGET, Primitive.NAVIGATE_TO_SUPPORT)
"""Primitives that end with the base at a stance for the next primitives."""


def step_number(subtask: Count, primitive: Count) -> Count:
    """Return the number of a subtask's primitive; elementwise for arrays."""
    return _STEPS_PER_SUBTASK * subtask + primitive


def subtask_of(step: Count) -> Count:
    """Return the index of a step's subtask; elementwise for arrays."""
    return step // _STEPS_PER_SUBTASK


def primitive_of(step: int) -> Primitive:
    """Return a step's primitive.

    Raises:
        ValueError: There is none of this number.
    """
    return Primitive(step % _STEPS_PER_SUBTASK)


def plan_of(task: Task, first: int = 0) -> list[int]:
    """Return the step numbers of a task's flows, in order, from a subtask on."""
    return [
        step_number(index, action.primitive.value)
        for index, subtask in enumerate(task.subtasks)
        if index >= first
        for action in subtask.flow or ()
    ]


FAR_FROM_BASE_M, FAR_FROM_TARGET_M = 2.0, 0.4
"""Maximum distances: rooms are three or four metres wide, and a hand is 0.2 m wide."""

SIDE_BY_SIDE_M, AS_HIGH_M = 0.25, 0.1
"""Maximum distance and height difference of the handles of two doors side by side."""

_LEAST = 1e-9


def surrounding_numbers(agent: NDArray, environment: NDArray, began: NDArray, directions: int) -> NDArray[np.float64]:
    """Return (N, 10 + 2 * directions): corners and hinge of the first thing, and two rounds of distances, in m.

    The four corners (x, y in the base frame) are those of its bounding box, in the order of its own axes. The hinge (x,
    y in the base frame) is that of the first handle's door; without a handle, one of the corners. The first round
    starts at the base's middle and reaches the nearest thing; it is 0 inside one. The second starts at the first
    thing's grasp point and reaches others of its height. Either begins in the base's heading and goes
    counter-clockwise, evenly.

    Args:
        agent: (N, J + 8) the robot, see `executor.data.state_readers`.
        environment: (N, ENVIRONMENT) its surroundings.
        began: (ENVIRONMENT,) the surroundings at the policy's start.
        directions: Number of rays per round.
    """
    things = _things(environment)
    there = things[..., 0] > 0.0
    base_m, yaw_rad = np.asarray(agent[:, :2], float), np.asarray(agent[:, 2], float)
    site_m = things[:, 0, 11:14]
    as_high = np.abs(things[..., 3] - site_m[:, 2:]) < things[..., 10] / 2
    as_high[:, 0] = False
    return np.concatenate(
        [
            _corners_m(things[:, 0], base_m, yaw_rad),
            _turned(hinge_m(began) - base_m, -yaw_rad),
            _distances_m(things, there, base_m, yaw_rad, directions, FAR_FROM_BASE_M),
            _distances_m(things, there & as_high, site_m[:, :2], yaw_rad, directions, FAR_FROM_TARGET_M),
        ],
        axis=1,
    )


def hinge_m(environment: NDArray) -> NDArray[np.float64]:
    """Return (2,) the hinge of the first handle's door in the room, as the door stands shut [m].

    Args:
        environment: (ENVIRONMENT,) the surroundings.
    """
    thing = _things(environment[None])[0, :1]
    yaw = _yaws_rad(thing[:, None], thing[:, :1] > 0.0)[0]
    half_m = thing[0, 8:10] / 2
    handles = np.asarray(environment[THINGS * THING :], float).reshape(HANDLES, HANDLE)
    bars_m = _turned(handles[:, 3:5] - thing[0, 1:3], -yaw)
    front = int(np.argmax(np.abs(bars_m[0]) / np.maximum(half_m, _LEAST)))
    side = 1 - front
    next_to = (handles[:, 0] > 0.0) & (np.abs(handles[:, 5] - handles[0, 5]) < AS_HIGH_M)
    next_to &= np.linalg.norm(bars_m - bars_m[0], axis=1) < SIDE_BY_SIDE_M
    next_to[0] = False
    other = bars_m[next_to.argmax()] - bars_m[0] if next_to.any() else bars_m[0]
    found = np.empty(2)
    found[front] = np.copysign(half_m[front], bars_m[0, front])
    found[side] = -np.copysign(half_m[side], other[side])
    return _turned(found, yaw[0]) + thing[0, 1:3]


def _corners_m(thing: NDArray, base_m: NDArray, yaw_rad: NDArray) -> NDArray[np.float64]:
    """Return (N, 8) the corners of things (N, THING) on the floor, in the base frame."""
    yaw = _yaws_rad(thing[:, None], thing[:, :1] > 0.0)[:, 0]
    signs = np.array([(1.0, 1.0), (1.0, -1.0), (-1.0, -1.0), (-1.0, 1.0)])
    corners_m = _turned(signs * thing[:, None, 8:10] / 2, yaw[:, None]) + thing[:, None, 1:3] - base_m[:, None]
    return _turned(corners_m, -yaw_rad[:, None]).reshape(len(thing), 8)


def _turned(vectors: NDArray, yaw_rad: NDArray) -> NDArray[np.float64]:
    """Rotate vectors (..., 2) by angles (...)."""
    cosine, sine = np.cos(yaw_rad), np.sin(yaw_rad)
    x, y = np.moveaxis(vectors, -1, 0)
    return np.stack([cosine * x - sine * y, sine * x + cosine * y], axis=-1)


def _yaws_rad(things: NDArray, counts: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Return (N, K) headings of the first axes of things (N, K, THING); 0 for those that do not count."""
    quaternions = np.where(counts[..., None], things[..., 4:8], [0.0, 0.0, 0.0, 1.0])
    ahead = Rotation.from_quat(quaternions.reshape(-1, 4)).as_matrix()[:, :2, 0].reshape(*counts.shape, 2)
    return np.arctan2(ahead[..., 1], ahead[..., 0])


def _things(environment: NDArray) -> NDArray[np.float64]:
    return np.asarray(environment[:, : THINGS * THING], float).reshape(len(environment), THINGS, THING)


def _distances_m(
    things: NDArray, counts: NDArray[np.bool_], from_m: NDArray, yaw_rad: NDArray, directions: int, farthest_m: float
) -> NDArray[np.float64]:
    """Return (N, directions) distances to boxes along rays on the floor.

    Args:
        things: (N, THINGS, THING).
        counts: (N, THINGS) the visible things.
        from_m: (N, 2) starts of the rays.
        yaw_rad: (N,) heading of the first ray.
    """
    # In the axes of each box.
    yaw = _yaws_rad(things, counts)
    start_m = _turned(from_m[:, None] - things[..., 1:3], -yaw)[:, :, None]
    rays = yaw_rad[:, None, None] + 2 * np.pi * np.arange(directions) / directions - yaw[..., None]
    slope = np.stack([np.cos(rays), np.sin(rays)], axis=-1)
    slope = np.where(np.abs(slope) < _LEAST, _LEAST, slope)
    half_m = things[:, :, None, 8:10] / 2
    one, other = (-half_m - start_m) / slope, (half_m - start_m) / slope
    enters_m, leaves_m = np.minimum(one, other).max(axis=-1), np.maximum(one, other).min(axis=-1)
    meets = (enters_m <= leaves_m) & (leaves_m >= 0.0) & counts[..., None]
    return np.where(meets, np.clip(enters_m, 0.0, farthest_m), farthest_m).min(axis=1)


Numbers = NDArray[np.float32]

THING_NUMBERS, HANDLE_NUMBERS = 18, 7
OWN_NUMBERS = 11

_MORE = 10  # Numbers of the robot after its lift and arm.
_OPENING = 7  # Index after the hand's pose.


def robot_number_count(robot: Robot) -> int:
    """Return the length of `robot_numbers`."""
    return robot.movers - 3 + _MORE


def state_numbers(agent: NDArray, environment: NDArray, sees: Sees, began: NDArray | None = None) -> Numbers:
    """Return (N, F) state features, in m, rad and shares.

    The numbers of the robot: lift and arm joints, gripper opening, hand position and first two axes of the hand in the
    base frame. THING_NUMBERS of each thing: its position and first two axes, its extent, its grasp point from the base
    and from the hand. HANDLE_NUMBERS of each handle: its opening, its bar from the base and from the hand. Absent
    things are 0. Then free space, where it is observed (`surrounding_numbers`).

    Args:
        agent: (N, J + 8) the robot.
        environment: (N, ENVIRONMENT) its surroundings.
        began: (ENVIRONMENT,) the surroundings at the policy's start; by default the first of those.
    """
    agent = np.asarray(agent, float)
    count = len(agent)
    to_base, hand, hand_m = _hand(agent)
    found: list[NDArray] = [robot_numbers(agent)]
    rows = np.asarray(environment[:, : THINGS * THING], float).reshape(count, THINGS, THING)
    for row in np.moveaxis(rows[:, : sees.things], 1, 0):
        there = row[:, :1]
        # An unused row has no quaternion.
        turn = Rotation.from_quat(np.where(there > 0.0, row[:, 4:8], [0.0, 0.0, 0.0, 1.0]))
        place_m = to_base.apply(row[:, 1:4] - _floor_m(agent))
        site_m = to_base.apply(row[:, 11:14] - _floor_m(agent))
        from_hand_m = hand.inv().apply(site_m - hand_m)
        found += [there * part for part in (place_m, _axes(to_base * turn), row[:, 8:11], site_m, from_hand_m)]
    bars = np.asarray(environment[:, THINGS * THING :], float).reshape(count, HANDLES, HANDLE)
    for bar in np.moveaxis(bars[:, : sees.handles], 1, 0):
        bar_m = to_base.apply(bar[:, 3:6] - _floor_m(agent))
        found += [bar[:, :1] * part for part in (bar[:, 2:3], bar_m, hand.inv().apply(bar_m - hand_m))]
    if sees.room:
        found.append(surrounding_numbers(agent, environment, environment[0] if began is None else began, sees.room))
    return np.concatenate(found, axis=1, dtype=np.float32)


def robot_numbers(agent: NDArray) -> Numbers:
    """Return (N, `robot_number_count`), the first of `state_numbers`."""
    agent = np.asarray(agent, float)
    _, hand, hand_m = _hand(agent)
    return np.concatenate([agent[:, 3:-_MORE], agent[:, -1:], hand_m, _axes(hand)], axis=1, dtype=np.float32)


def own_numbers(agent: NDArray) -> Numbers:
    """Return (N, OWN_NUMBERS), the paper's proprioception: hand position (m) and quaternion x y z w, gripper, base.

    The hand is in the base frame, whose x, y (m) and yaw (rad) are in the room. Of the two equal quaternions it is the
    one with x + w not below 0, since hands point ahead or down, and there that sum is far from 0.
    """
    agent = np.asarray(agent, float)
    _, hand, hand_m = _hand(agent)
    turn = hand.as_quat()
    turn = np.where(turn[:, :1] + turn[:, 3:] < 0.0, -turn, turn)
    return np.concatenate([hand_m, turn, agent[:, -1:], agent[:, :3]], axis=1, dtype=np.float32)


def shown_numbers(robot: Robot, numbers: Numbers, places: bool, things: int, handles: int) -> Numbers:
    """Return (N, 1 + 4 * handles + 3 * things) progress numbers of observations.

    They are the gripper's opening (m), the grasp point of each thing and then of each handle, from the hand (m), and
    each handle's opening. Without places it is the gripper's opening alone.

    Args:
        numbers: (N, F) from `state_numbers` or `own_numbers`.
        places: Whether it is the former.
        things, handles: Their numbers of things and handles.
    """
    own = robot_number_count(robot)
    opening = own - _MORE if places else _OPENING
    found = [numbers[:, opening : opening + 1]]
    if places:
        begins = own + THING_NUMBERS * things
        ends = [own + THING_NUMBERS * (row + 1) for row in range(things)]
        ends += [begins + HANDLE_NUMBERS * (row + 1) for row in range(handles)]
        found += [numbers[:, end - 3 : end] for end in ends]
        found += [numbers[:, begins : begins + HANDLE_NUMBERS * handles : HANDLE_NUMBERS]]
    return np.concatenate(found, axis=1, dtype=np.float32)


def _hand(agent: NDArray) -> tuple[Rotation, Rotation, NDArray]:
    """Return the rotation from room to base, and rotation and position (N, 3) of the hand in the base frame."""
    to_base = Rotation.from_euler("z", -agent[:, 2:3])
    return to_base, to_base * Rotation.from_quat(agent[:, -5:-1]), to_base.apply(agent[:, -8:-5] - _floor_m(agent))


def _floor_m(agent: NDArray) -> NDArray:
    """Return (N, 3) the base's place on the floor."""
    return np.concatenate([agent[:, :2], np.zeros((len(agent), 1))], axis=1)


def _axes(turn: Rotation) -> NDArray:
    """Return (N, 6) the first two axes of a rotation, a continuous and unique representation."""
    return turn.as_matrix()[:, :, :2].reshape(len(turn), 6)


Columns = Mapping[str, NDArray]

_MIRROR_BASE = (1.0, -1.0, -1.0, 1.0)
_MIRROR_PLACE = np.array([1, -1, 1], dtype=np.float32)
_MIRROR_TURN = np.array([-1, 1, -1], dtype=np.float32)  # Signs of a rotation vector, and of a quaternion's x y z.
_MIRROR_POSE = np.concatenate([_MIRROR_PLACE, _MIRROR_TURN, [1]]).astype(np.float32)
_MIRROR_THING = np.concatenate([[1], _MIRROR_POSE, [1, 1, 1], _MIRROR_PLACE]).astype(np.float32)
_MIRROR_HANDLE = np.concatenate([[1, 1, 1], _MIRROR_PLACE]).astype(np.float32)
_MIRROR_ENVIRONMENT = np.concatenate([*[_MIRROR_THING] * THINGS, *[_MIRROR_HANDLE] * HANDLES])
_MIRROR_HAND_ACTION = np.concatenate([_MIRROR_PLACE, _MIRROR_TURN, [1, 1, -1, -1, 1]]).astype(np.float32)
_LEFTWARDS = (Primitive.MOVE_EEF_LEFT, Primitive.MOVE_BASE_LEFT, Primitive.TURN_BASE_LEFT)
_OTHER_SIDE = {one: OPPOSITE[one] for left in _LEFTWARDS for one in (left, OPPOSITE[left])}
_MIRROR_PRIMITIVES = np.array(
    [_OTHER_SIDE.get(number, number) for number in (0, *Primitive)]
)  # 0 for no running primitive.
_MIRROR_POINT = np.append(_MIRROR_PLACE, 1).astype(np.float32)


def mirror_columns(robot: Robot, columns: Columns) -> dict[str, NDArray] | None:
    """Mirror an episode's columns (`executor.data.episode`).

    None where a joint would exceed its limits, and where the arm has no mirror image.

    Args:
        columns: Columns of the episode; those that policies do not observe stay.
    """
    if not robot.mirrored:
        return None
    found = dict(columns)
    joints_count = len(robot.joint_names)
    signs = np.concatenate([np.ones(joints_count), _MIRROR_POSE, [1]]).astype(np.float32)
    agent = columns["observation.state"] * signs
    agent[:, :joints_count] = mirror_joints(robot, columns["observation.state"][:, :joints_count])
    found["observation.state"] = agent
    found["action.joint_target"] = mirror_joints(robot, columns["action.joint_target"])
    low, high = joint_limits(robot).T.astype(np.float32)
    arm = robot.arm
    for joints in (agent[:, arm], found["action.joint_target"][:, arm]):
        if (joints < low[arm]).any() or (joints > high[arm]).any():
            return None
    found["observation.environment_state"] = columns["observation.environment_state"] * _MIRROR_ENVIRONMENT
    found["action"] = columns["action"] * _MIRROR_HAND_ACTION[: columns["action"].shape[1]]
    found["primitive_index"] = _MIRROR_PRIMITIVES[columns["primitive_index"]]
    if CLOUD in columns:
        found[CLOUD] = columns[CLOUD] * _MIRROR_POINT
    return found


def mirror_joints(robot: Robot, joints: NDArray) -> NDArray:
    """Return (N, J) mirrored joints: base x, y (m), yaw (rad) and lift (m), arm (rad), fingers (m)."""
    signs = [*_MIRROR_BASE[: robot.base.stop], *(sign for sign, _ in robot.mirrored), 1.0, 1.0]
    found = joints * np.array(signs, dtype=np.float32)
    for joint, (_, offset_rad) in enumerate(robot.mirrored, start=robot.arm.start):
        if offset_rad:
            found[:, joint] += offset_rad
    return found


OFFSET_SHARE = 0.5
"""Share of a drive's moments that are offset."""

TURN_RAD_PER_M = 2.0
"""Turn of the base per metre of offset: it moves a point half a metre ahead by as much."""

_HELD_M = 0.1  # Distance from the hand to the grasp point of a held thing.


def offset_drives(
    columns: Mapping[str, NDArray],
    drives: NDArray[np.bool_],
    carries: NDArray[np.bool_],
    off_m: float,
    rng: np.random.Generator,
) -> dict[str, NDArray]:
    """Augment drive phases of an episode's columns (`executor.data.episode`) with offset base poses.

    Args:
        columns: Columns of the episode; joint targets stay, hand actions would change.
        drives, carries: (N,) moments of driving, and of driving with a held thing.
        off_m: Standard deviation along x and along y [m].
    """
    agent = np.array(columns["observation.state"], np.float64)
    rows = np.flatnonzero(drives & (rng.random(len(agent)) < OFFSET_SHARE))
    moved = rng.normal(0.0, off_m, (len(rows), 3)) * [1.0, 1.0, TURN_RAD_PER_M]
    turn = Rotation.from_euler("z", moved[:, 2:])
    base_m = np.concatenate([agent[rows, :2], np.zeros((len(rows), 1))], axis=1)
    by_m = np.concatenate([moved[:, :2], np.zeros((len(rows), 1))], axis=1)
    hand_m = agent[rows, -8:-5]
    agent[rows, :3] += moved
    agent[rows, -8:-5] = turn.apply(hand_m - base_m) + base_m + by_m
    agent[rows, -5:-1] = (turn * Rotation.from_quat(agent[rows, -5:-1])).as_quat()
    around = np.array(columns["observation.environment_state"], np.float64)
    things = around[:, : THINGS * THING].reshape(len(around), THINGS, THING)
    for thing in range(THINGS):
        rows_of_thing = things[rows, thing]
        held = (
            carries[rows]
            & (rows_of_thing[:, 0] > 0.0)
            & (np.linalg.norm(rows_of_thing[:, 11:14] - hand_m, axis=1) < _HELD_M)
        )
        if held.any():
            spun = turn[held]
            for place in (slice(1, 4), slice(11, 14)):
                things[rows[held], thing, place] = (
                    spun.apply(rows_of_thing[held, place] - base_m[held]) + (base_m + by_m)[held]
                )
            things[rows[held], thing, 4:8] = (spun * Rotation.from_quat(rows_of_thing[held, 4:8])).as_quat()
    return {
        **columns,
        "observation.state": agent.astype(np.float32),
        "observation.environment_state": around.astype(np.float32),
    }
