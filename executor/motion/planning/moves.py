"""What the parameterised primitives do, as paths: a number in metres or degrees, in the robot's own frame.

Source: the paper's primitive library. "Forward" and "left" are the base's heading and its left side, for the hand
too; "up" and "down" are vertical. Turns are about the base's own axis.
"""

from __future__ import annotations

import numpy as np

from executor.geometry import Array, rotation_z
from executor.motion.planning.paths import base_move, base_turn
from executor.motion.planning.planner import LinePlan, Planner
from oag import Action, Primitive

EEF_DIRECTIONS: dict[Primitive, tuple[float, float, float]] = {
    Primitive.LIFT_EEF_UP: (0.0, 0.0, 1.0),
    Primitive.LIFT_EEF_DOWN: (0.0, 0.0, -1.0),
    Primitive.MOVE_EEF_FORWARD: (1.0, 0.0, 0.0),
    Primitive.MOVE_EEF_BACKWARD: (-1.0, 0.0, 0.0),
    Primitive.MOVE_EEF_LEFT: (0.0, 1.0, 0.0),
    Primitive.MOVE_EEF_RIGHT: (0.0, -1.0, 0.0),
}
"""Unit directions of the hand's translations in the base frame."""

BASE_HEADINGS_RAD: dict[Primitive, float] = {
    Primitive.MOVE_BASE_FORWARD: 0.0,
    Primitive.MOVE_BASE_BACKWARD: np.pi,
    Primitive.MOVE_BASE_LEFT: np.pi / 2,
    Primitive.MOVE_BASE_RIGHT: -np.pi / 2,
}
"""Headings of the base's translations, relative to where it faces."""

TURN_SIGNS: dict[Primitive, float] = {Primitive.TURN_BASE_LEFT: 1.0, Primitive.TURN_BASE_RIGHT: -1.0}
"""Counter-clockwise is positive."""

MOVES = frozenset([*EEF_DIRECTIONS, *BASE_HEADINGS_RAD, *TURN_SIGNS])
"""The primitives whose effect is a number in the robot's own frame."""


def move_path(planner: Planner, q: Array, primitive: Primitive, amount: float) -> LinePlan:
    """Returns the path (N, 10), q first, of a parameterised primitive; not checked for collisions.

    Args:
        planner: Solves the hand's straight motions.
        q: (10,) where the robot is.
        primitive: One of `MOVES`.
        amount: Metres, or degrees for turns; a negative amount goes the other way (used to plan backwards).
    """
    if primitive in EEF_DIRECTIONS:
        direction = rotation_z(float(q[2])) @ np.array(EEF_DIRECTIONS[primitive])
        T = planner.kinematics.forward(q)
        T[:3, 3] += amount * direction
        return planner.line(q, T)
    if primitive in BASE_HEADINGS_RAD:
        return LinePlan(base_move(q, amount, float(q[2]) + BASE_HEADINGS_RAD[primitive]), 0.0)
    return LinePlan(base_turn(q, TURN_SIGNS[primitive] * np.deg2rad(amount)), 0.0)


def run_moves(planner: Planner, q: Array, moves: list[Action]) -> Array | None:
    """Returns the waypoints (N, 10), q first, of filled moves one after another, or None when one is out of reach."""
    path = q[None]
    for action in moves:
        amount = action.parameter
        if not isinstance(amount, float | int):
            raise ValueError(f"{action.primitive.name} has no number to run")
        step = move_path(planner, path[-1], action.primitive, float(amount)).path
        if step is None:
            return None
        path = np.concatenate([path, step[1:]])
    return path


def undo_moves(planner: Planner, q: Array, moves: list[Action]) -> Array | None:
    """Returns the configuration (10,) from which filled moves lead to q, or None when there is none within reach."""
    for action in reversed(moves):
        amount = action.parameter
        if not isinstance(amount, float | int):
            raise ValueError(f"{action.primitive.name} has no number to undo")
        step = move_path(planner, q, action.primitive, -float(amount)).path
        if step is None:
            return None
        q = step[-1]
    return q
