"""What a policy is told in numbers: the robot from its own base, and things and handles from the base and the hand.

All of it follows from what the environment observes and data sets keep (`executor.datasets.formats.observations`), so
that training and evaluation see the same. Arrays have one row a moment.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from executor.datasets.formats.observations import HANDLE, HANDLES, THING, THINGS
from executor.policies.seen.surroundings import surrounding_numbers
from executor.policies.settings import Sees

Numbers = NDArray[np.float32]

ROBOT_NUMBERS, THING_NUMBERS, HANDLE_NUMBERS = 17, 18, 7
OWN_NUMBERS = 11

_OPENING = 7  # Behind the arm's joints, or behind the hand's pose.


def state_numbers(agent: NDArray, environment: NDArray, sees: Sees, began: NDArray | None = None) -> Numbers:
    """Returns (N, F) of what is seen of the state, in m, rad and shares.

    ROBOT_NUMBERS of the robot: seven arm joints, the gripper's opening, hand position and first two axes of the hand
    from the base. THING_NUMBERS of each thing: its position and first two axes, its extent, where a hand takes it from
    the base and from the hand. HANDLE_NUMBERS of each handle: how far it is open, its bar from the base and from the
    hand. What is not there is 0. Then what room there is, where that is told (`surroundings.py`).

    Args:
        agent: (N, AGENT) the robot.
        environment: (N, ENVIRONMENT) what is around it.
        sees: Of how many things and handles to tell, and of what room.
        began: (ENVIRONMENT,) what was around it when the policy began; by default the first of those.
    """
    agent = np.asarray(agent, float)
    count = len(agent)
    to_base, hand, hand_m = _hand(agent)
    found: list[NDArray] = [robot_numbers(agent)]
    rows = np.asarray(environment[:, : THINGS * THING], float).reshape(count, THINGS, THING)
    for row in np.moveaxis(rows[:, : sees.things], 1, 0):
        there = row[:, :1]
        # A row that is not used has no quaternion.
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
    """Returns (N, ROBOT_NUMBERS), the first of `state_numbers`."""
    agent = np.asarray(agent, float)
    _, hand, hand_m = _hand(agent)
    return np.concatenate([agent[:, 3:10], agent[:, 19:20], hand_m, _axes(hand)], axis=1, dtype=np.float32)


def own_numbers(agent: NDArray) -> Numbers:
    """Returns (N, OWN_NUMBERS), the paper's proprioception: hand position (m) and quaternion x y z w, gripper, base.

    The hand is seen from the base, whose x, y (m) and yaw (rad) are in the room. Of the two quaternions that say the
    same it is the one with x + w not below 0, since hands point ahead or down, and there that sum is far from 0.
    """
    agent = np.asarray(agent, float)
    _, hand, hand_m = _hand(agent)
    turn = hand.as_quat()
    turn = np.where(turn[:, :1] + turn[:, 3:] < 0.0, -turn, turn)
    return np.concatenate([hand_m, turn, agent[:, 19:20], agent[:, :3]], axis=1, dtype=np.float32)


def shown_numbers(numbers: Numbers, places: bool, things: int, handles: int) -> Numbers:
    """Returns (N, 1 + 4 * handles + 3 * things) of what is seen what shows how far a plan has come: the gripper's
    opening (m), where a hand takes each thing and then each handle, from the hand (m), and how far each handle is open.
    Without places it is the opening alone.

    Args:
        numbers: (N, F) as `state_numbers` or `own_numbers` gives them.
        places: Which of the two.
        things, handles: Of how many they tell.
    """
    found = [numbers[:, _OPENING : _OPENING + 1]]
    if places:
        begins = ROBOT_NUMBERS + THING_NUMBERS * things
        ends = [ROBOT_NUMBERS + THING_NUMBERS * (row + 1) for row in range(things)]
        ends += [begins + HANDLE_NUMBERS * (row + 1) for row in range(handles)]
        found += [numbers[:, end - 3 : end] for end in ends]
        found += [numbers[:, begins : begins + HANDLE_NUMBERS * handles : HANDLE_NUMBERS]]
    return np.concatenate(found, axis=1, dtype=np.float32)


def _hand(agent: NDArray) -> tuple[Rotation, Rotation, NDArray]:
    """Returns the turn from the room to the base, and turn and place (N, 3) of the hand from the base."""
    to_base = Rotation.from_euler("z", -agent[:, 2:3])
    return to_base, to_base * Rotation.from_quat(agent[:, 15:19]), to_base.apply(agent[:, 12:15] - _floor_m(agent))


def _floor_m(agent: NDArray) -> NDArray:
    """Returns (N, 3) the base's place on the floor."""
    return np.concatenate([agent[:, :2], np.zeros((len(agent), 1))], axis=1)


def _axes(turn: Rotation) -> NDArray:
    """Returns (N, 6) the first two axes of a turn, which no number is ambiguous or jumps in."""
    return turn.as_matrix()[:, :, :2].reshape(len(turn), 6)
