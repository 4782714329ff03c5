"""What an environment's episodes are of: a scene with a task, drawn by seed, and where it begins."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import lru_cache

from executor.bench.units import HOUSEHOLD, Family, indices_of
from executor.datasets.units import DemoUnit, Origin
from executor.datasets.variation import UNVARIED, Variation
from executor.datasets.work import physics_of, prepared
from executor.rollouts.checkpoint import Checkpoint
from executor.scenes.rooms.room import Stray
from executor.world.physics import STANDARD, Physics
from oag import ObjectActionGraph, Scene, Task, compose

KEPT = 16
"""Episodes that a process remembers: drawing one takes a second, and evaluations come back to the same seeds."""


@dataclass(frozen=True, slots=True)
class DrawnEpisode:
    """What is to be done, and where.

    Attributes:
        query: The sentence.
        graph: The composed task, with its concrete scene.
        start: Where it begins: the scene at rest, the robot at its place.
        physics: Of its world.
        unit: What it was drawn as; None for a task in a concrete scene.
        strays: Target's id -> how it differs from what the scene has without that.
    """

    query: str
    graph: ObjectActionGraph
    start: Checkpoint
    physics: Physics = STANDARD
    unit: DemoUnit | None = None
    strays: Mapping[str, Stray] = field(default_factory=dict)

    @property
    def task(self) -> Task:
        """The task."""
        return self.graph.task

    @property
    def scene(self) -> Scene:
        """The concrete scene."""
        return self.graph.scene


Source = Callable[[int, int | None], DrawnEpisode]
"""A seed, and which pair of its set -> the episode."""


def of_family(family: Family, variation: Variation = UNVARIED, *, full_size: bool = False) -> Source:
    """Returns the source of the benchmark's episodes of a family.

    A set of T5 or T6 has many pairs; without an index the seed says which.

    Args:
        family: "T1" to "T6".
        variation: What varies beside what the seed draws.
        full_size: Whether the robot is of full size.
    """

    def draw(seed: int, index: int | None) -> DrawnEpisode:
        indices = indices_of(family) if family in HOUSEHOLD else (None,)
        if index is None:
            index = indices[seed % len(indices)]
        if index not in indices:
            known = "none" if indices == (None,) else ", ".join(str(number) for number in indices)
            raise ValueError(f"{family} has no index {index}; it has {known}")
        return _drawn(DemoUnit(Origin(family=family), seed, index, variation, full_size=full_size))

    return draw


def of_query(query: str, scene: str, variation: Variation = UNVARIED, *, full_size: bool = False) -> Source:
    """Returns the source of the episodes of a sentence in a scene, which the seed varies.

    Args:
        query: The sentence.
        scene: Name of a scene, or a scene's JSON file.
        variation: What varies beside what the seed draws.
        full_size: Whether the robot is of full size, whatever the scene has.
    """

    def draw(seed: int, index: int | None) -> DrawnEpisode:
        if index is not None:
            raise ValueError(f"a sentence has no index {index}; only T5 and T6 have")
        return _drawn(DemoUnit(Origin(query=query, scene=scene), seed, variation=variation, full_size=full_size))

    return draw


def of_task(
    task: Task, scene: Scene, query: str = "", physics: Physics = STANDARD, start: Checkpoint | None = None
) -> Source:
    """Returns the source of one episode, whatever the seed.

    Args:
        task: What is to be done.
        scene: The concrete scene.
        query: The sentence; by default what the task says of itself.
        physics: Of its world.
        start: Where it begins; by default with everything as the scene has it, at rest.
    """
    graph = compose(task, scene=scene)

    @lru_cache(maxsize=1)
    def only() -> DrawnEpisode:
        begins = start or Checkpoint.at_start(scene, physics=physics)
        return DrawnEpisode(query or task.detail or task.name, graph, begins, physics)

    return lambda seed, index: only()


@lru_cache(maxsize=KEPT)
def _drawn(unit: DemoUnit) -> DrawnEpisode:
    todo, physics = prepared(unit), physics_of(unit)
    start = Checkpoint.at_start(todo.graph.scene, physics=physics)
    return DrawnEpisode(todo.query, todo.graph, start, physics, unit, todo.strays)
