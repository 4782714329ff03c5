"""How far a task has come, as a number that rises, and whether it is done."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

import bddl
from bddl import Atom
from executor.assets.model import Vector
from executor.geometry import Array, inverse
from executor.primitives.control import STILL_M
from executor.robot.description import TCP_LINK
from executor.rollouts.judge import PLACES, judge_at_rest, misses
from executor.rollouts.running import GOAL_HOLDS_S
from executor.world.detectors import GRIPPER, read
from executor.world.engine import ROBOT
from executor.world.world import World
from oag import ObjectActionGraph

NEAR_M = 0.5
"""Distance over which nearness counts: at this far it is worth a third of what being there is."""

_DIGITS = 5  # What lies still trembles by less, and no detector looks as closely.
_STEP_SHARE = 0.5  # Of what the next literal is worth, that being near may earn; the rest is for making it true.


@dataclass(frozen=True, slots=True)
class Progress:
    """How far a task has come.

    Attributes:
        stage: How many of its subtasks are done, or need not be done any more.
        value: From 0 to 1; what an environment's rewards add up to.
        success: Whether the goal has held, at rest, for `GOAL_HOLDS_S`.
    """

    stage: int
    value: float
    success: bool


class ProgressWatch:
    """Follows one episode.

    A subtask counts as done where its regressed goal holds: what it is for, with all that later subtasks need. The
    latest such subtask says where the task stands, whatever way it got there.

    Args:
        graph: The composed task.
        world: Where things are.
    """

    def __init__(self, graph: ObjectActionGraph, world: World) -> None:
        self._task, self._world = graph.task, world
        categories = {object_id: thing.category for object_id, thing in world.scene.objects.items()}
        goals = graph.verify().regressed_goals
        self._measures = [bddl.GoalProgress(goal, categories) for goal in (*goals[:-1], graph.task.goal)]
        named = {name for atom in self._measures[-1].atoms for name in atom.args}
        self._items = [name for name in world.dynamic_ids if name in named]
        self._atoms = tuple(dict.fromkeys(atom for measure in self._measures for atom in measure.atoms))
        # What the atoms are about: things that move freely, that have joints, that stand fast, and what is no thing.
        about = dict.fromkeys(name for atom in self._atoms for name in atom.args)
        self._free = [name for name in about if name in world.dynamic_ids]
        self._jointed = {
            name: [joint.name for joint in world.assets[name].joints] for name in about if name in world.articulated_ids
        }
        self._fixed = {name: b"" if name in world.assets else None for name in about}
        self._as_they_were: dict[Atom, tuple[bytes, bool | None]] = {}
        self._known: dict[Atom, bool | None] = {}
        self._shares = [measure(self._known.get) for measure in self._measures]
        self._held_s = 0.0
        self._looked_s = world.time_s
        self._places = self._positions()

    def look(self) -> Progress:
        """Returns how far the task has come by now; call it once an action."""
        count = len(self._measures)
        states = self._states()
        known = {atom: self._read(atom, [states[name] for name in atom.args]) for atom in self._atoms}
        if known != self._known:
            self._known, self._shares = known, [measure(known.get) for measure in self._measures]
        shares = self._shares
        stage = next((index + 1 for index in reversed(range(count)) if shares[index] == 1.0), 0)
        since_s, self._looked_s = self._world.time_s - self._looked_s, self._world.time_s
        if stage == count and self._rests(since_s) and self._reached():
            self._held_s += since_s
        else:
            self._held_s = 0.0
        value = 1.0 if stage == count else (stage + self._share(stage, shares[stage])) / count
        return Progress(stage, value, self._held_s >= GOAL_HOLDS_S - 1e-9)

    def _read(self, atom: Atom, things: list[bytes | None]) -> bool | None:
        """Returns what the detectors say of an atom; of things that have not moved, what they said before."""
        if any(state is None for state in things):
            return read(atom, self._world).value
        states = b"".join(state for state in things if state is not None)
        before = self._as_they_were.get(atom)
        if before is None or before[0] != states:
            before = self._as_they_were[atom] = (states, read(atom, self._world).value)
        return before[1]

    def _states(self) -> dict[str, bytes | None]:
        """Returns bits that say where things and their joints are, to 10 um; None for no thing, such as the gripper."""
        world = self._world
        states: dict[str, bytes | None] = dict(self._fixed)
        if self._free:
            places = np.round(world.root_poses(self._free), _DIGITS)
            states |= {name: place.tobytes() for name, place in zip(self._free, places, strict=True)}
        for name, joints in self._jointed.items():
            states[name] = np.array([world.joint_position(name, joint) for joint in joints]).round(_DIGITS).tobytes()
        return states

    def _reached(self) -> bool:
        return all(reading.satisfied for reading in judge_at_rest(self._task.goal, self._world))

    def _share(self, stage: int, share: float) -> float:
        """Returns how far a subtask has come, nearness included."""
        distance_m = self._distance_m(stage)
        return share + _STEP_SHARE * (1.0 - share) * float(np.exp(-distance_m / NEAR_M))

    def _distance_m(self, stage: int) -> float:
        """How far the hand is from what it is to take; once it has it, how far that is from its place."""
        subtask, world = self._task.subtasks[stage], self._world
        item = subtask.target
        held = Atom("inside", (item, GRIPPER))
        if item in world.dynamic_ids and (self._known[held] if held in self._known else read(held, world).value):
            wanted = [
                literal.atom
                for literal in bddl.literals(subtask.goal) or ()
                if literal.value and literal.atom.predicate in PLACES and literal.atom.args[0] == item
            ]
            yaw_rad = float(world.robot.get_qpos()[2])
            return min((miss.distance_m for miss in misses(wanted, world, yaw_rad)), default=0.0)
        return hand_off_m(world, item)

    def _rests(self, since_s: float) -> bool:
        """Decides whether nothing that the goal is about moved since the last look."""
        before, self._places = self._places, self._positions()
        moved_m = np.linalg.norm(self._places - before, axis=1).max(initial=0.0)
        return bool(since_s > 0.0 and moved_m <= STILL_M)

    def _positions(self) -> Array:
        return np.array([self._world.T_world_link(name)[:3, 3] for name in self._items]).reshape(-1, 3)


def hand_off_m(world: World, object_id: str) -> float:
    """Returns how far the point between the fingertips is from what a hand can take of a thing.

    That is the nearest point on the bars of its handles, wherever they are now, and where it has none, the nearest one
    of the box along its own axes.
    """
    asset, hand = world.assets[object_id], world.T_world_link(ROBOT, TCP_LINK)[:3, 3]

    def off_m(link: str | None, middle_m: Vector, axes: Array, half_m: Array) -> float:
        local = (inverse(world.T_world_link(object_id, link)) @ np.array([*hand, 1.0]))[:3] - middle_m
        return float(np.linalg.norm(local - np.clip(axes @ local, -half_m, half_m) @ axes))

    if not asset.handles:
        return off_m(None, (0.0, 0.0, 0.0), np.eye(3), np.asarray(asset.extent_m) / 2)
    return min(
        off_m(handle.link, handle.position_m, np.array([handle.axis]), np.array([handle.length_m / 2]))
        for handle in asset.handles
    )
