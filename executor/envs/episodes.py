"""Episodes of an environment: a scene with a task, drawn by seed, its start, and progress towards the goal."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np

import bddl
from bddl import Atom
from executor.assets.model import Vector
from executor.data.units import UNVARIED, DemoUnit, Origin, Variation
from executor.data.work import physics_of, prepare_unit
from executor.geometry import Array, inverse
from executor.rollouts.checkpoint import Checkpoint
from executor.rollouts.goals import PLACES, judge_at_rest, misses
from executor.rollouts.rollout import GOAL_HOLDS_S
from executor.scenes.generators.families import Family, indices_of
from executor.scenes.room import Perturbation
from executor.sim.detectors import GRIPPER, read
from executor.sim.engine import ROBOT, STANDARD, Physics
from executor.sim.robot.description import TCP_LINK
from executor.sim.world import World
from executor.skills.control import STILL_M
from oag import ObjectActionGraph, Scene, Task, compose

KEPT = 16
"""Cached episodes per process: drawing one takes a second, and evaluations reuse seeds."""


@dataclass(frozen=True, slots=True)
class DrawnEpisode:
    """Task and scene of an episode.

    Attributes:
        query: The sentence.
        graph: The composed task, with its concrete scene.
        start: Its start: the scene at rest, the robot at its place.
        physics: Physics of its world.
        unit: Its unit; None for a task in a concrete scene.
        perturbations: Target's id -> its deviation from the unperturbed scene.
    """

    query: str
    graph: ObjectActionGraph
    start: Checkpoint
    physics: Physics = STANDARD
    unit: DemoUnit | None = None
    perturbations: Mapping[str, Perturbation] = field(default_factory=dict)

    @property
    def task(self) -> Task:
        """The task that is executed, with the numbers of its plan."""
        return self.graph.task

    @property
    def scene(self) -> Scene:
        """The scene as drawn for this episode, poses and sizes included."""
        return self.graph.scene


EpisodeSource = Callable[[int, int | None], DrawnEpisode]
"""Seed and index of a pair in its set -> the episode."""


def family_source(family: Family, variation: Variation = UNVARIED, *, full_size: bool = False) -> EpisodeSource:
    """Return the source of a family's benchmark episodes.

    A set of T5 or T6 has many pairs; without an index the seed selects one.

    Args:
        family: "T1" to "T6".
        variation: Variation besides the seed's draws.
        full_size: Whether the robot is of full size.
    """

    def draw(seed: int, index: int | None) -> DrawnEpisode:
        indices = indices_of(family)
        if index is None:
            index = indices[seed % len(indices)]
        if index not in indices:
            known = "none" if indices == (None,) else ", ".join(str(number) for number in indices)
            raise ValueError(f"{family} has no index {index}; it has {known}")
        return _draw_episode(DemoUnit(Origin(family=family), seed, index, variation, full_size=full_size))

    return draw


def query_source(query: str, scene: str, variation: Variation = UNVARIED, *, full_size: bool = False) -> EpisodeSource:
    """Return the source of episodes of a sentence in a scene that the seed varies.

    Args:
        query: The sentence.
        scene: Name of a scene, or a scene's JSON file.
        variation: Variation besides the seed's draws.
        full_size: Whether the robot is of full size, whatever the scene's robot.
    """

    def draw(seed: int, index: int | None) -> DrawnEpisode:
        if index is not None:
            raise ValueError(f"a sentence has no index {index}; only T5 and T6 have")
        return _draw_episode(DemoUnit(Origin(query=query, scene=scene), seed, variation=variation, full_size=full_size))

    return draw


def task_source(
    task: Task, scene: Scene, query: str = "", physics: Physics = STANDARD, start: Checkpoint | None = None
) -> EpisodeSource:
    """Return the source of one episode, whatever the seed.

    Args:
        task: The task.
        scene: The concrete scene.
        query: The sentence; by default the task's own text.
        physics: Physics of its world.
        start: Its start; by default the scene at rest.
    """
    graph = compose(task, scene=scene)

    @lru_cache(maxsize=1)
    def only() -> DrawnEpisode:
        begins = start or Checkpoint.at_start(scene, physics=physics)
        return DrawnEpisode(query or task.detail or task.name, graph, begins, physics)

    return lambda seed, index: only()


@lru_cache(maxsize=KEPT)
def _draw_episode(unit: DemoUnit) -> DrawnEpisode:
    todo, physics = prepare_unit(unit), physics_of(unit)
    start = Checkpoint.at_start(todo.graph.scene, physics=physics)
    return DrawnEpisode(todo.query, todo.graph, start, physics, unit, todo.perturbations)


NEAR_M = 0.5
"""Decay length of nearness: at this distance it is worth a third of being there."""

_DIGITS = 5  # Things at rest tremble by less, and no detector is as precise.
_STEP_SHARE = 0.5  # Share of the next literal's value for nearness; the rest is for making it true.


@dataclass(frozen=True, slots=True)
class Progress:
    """Progress of a task.

    Attributes:
        stage: Number of subtasks that are done, or are not needed any more.
        value: From 0 to 1; the sum of an environment's rewards.
        success: Whether the goal has held, at rest, for `GOAL_HOLDS_S`.
    """

    stage: int
    value: float
    success: bool


class ProgressWatch:
    """Progress tracker of one episode.

    A subtask is done where its regressed goal holds: its own goal, with all that later subtasks need. The latest such
    subtask determines the stage, however it was reached.

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
        # Objects of the atoms: free things, things with joints, fixed things, and non-things.
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
        """Return the present progress; call it once per action."""
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
        """Evaluate an atom with the detectors; for unmoved things, reuse the last result."""
        if any(state is None for state in things):
            return read(atom, self._world).value
        states = b"".join(state for state in things if state is not None)
        before = self._as_they_were.get(atom)
        if before is None or before[0] != states:
            before = self._as_they_were[atom] = (states, read(atom, self._world).value)
        return before[1]

    def _states(self) -> dict[str, bytes | None]:
        """Return bits of the poses of things and their joints, to 10 um; None for non-things such as the gripper."""
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
        """Return the progress of a subtask, nearness included."""
        distance_m = self._distance_m(stage)
        return share + _STEP_SHARE * (1.0 - share) * float(np.exp(-distance_m / NEAR_M))

    def _distance_m(self, stage: int) -> float:
        """Return the hand's distance from its target [m]; once held, the target's distance from its place."""
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
        return hand_distance_m(world, item)

    def _rests(self, since_s: float) -> bool:
        """Decide whether nothing in the goal moved since the last look."""
        before, self._places = self._places, self._positions()
        moved_m = np.linalg.norm(self._places - before, axis=1).max(initial=0.0)
        return bool(since_s > 0.0 and moved_m <= STILL_M)

    def _positions(self) -> Array:
        return np.array([self._world.T_world_link(name)[:3, 3] for name in self._items]).reshape(-1, 3)


def hand_distance_m(world: World, object_id: str) -> float:
    """Return the distance of the point between the fingertips from what a hand can grasp of a thing [m].

    That is the nearest point on the bars of its handles, in their present poses; without handles, of its bounding box.
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
