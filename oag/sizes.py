"""Sizes of objects and of the hand: the widest grasp, and the factor that scales an item to it.

Source: the paper's object size adjustment (module 4): aim 0.05 m, type A never scaled. Its limit is 0.06 m; here it is
the opening of the robot's gripper. Widths are drawn from a seed, and nothing loses more than two fifths of its size
(docs/departures.md). A robot of full size takes most things as they are.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from random import Random
from typing import Self

from oag.model.codec import Record
from oag.model.scene import RobotPose, Scene, SceneObject, Vector3
from oag.model.symbols import has_rim
from oag.task_definition import Task

GRIP_CLEARANCE_M = 0.003
_SPARE_M = 0.001  # Extra clearance of the fingers for a scaled object.

LEAST_SCALE = 0.6
"""Least factor: an object scaled by less would be another thing."""


@dataclass(frozen=True, slots=True)
class Gripper:
    """Widths that a robot's hand takes; the simulated robots are tested against it.

    Attributes:
        opening_m: Opening of the fingers [m]: a Panda's 0.08 m at full size.
        aim_m: The width that is aimed at where nothing is drawn, the paper's 0.05 m for its robot.
        least_m: Least width of a scaled object [m]: narrower ones would be toys.
    """

    opening_m: float
    aim_m: float
    least_m: float

    @classmethod
    def of(cls, robot: RobotPose) -> Self:
        """Return the hand of a scene's robot."""
        hand = robot.model.hand
        return cls(hand.opening_m, hand.aim_m, hand.least_m)

    @property
    def widest_m(self) -> float:
        """The widest object [m] that the fingers close around."""
        return self.opening_m - GRIP_CLEARANCE_M

    @property
    def most_m(self) -> float:
        """Largest width [m] of a scaled object: more leaves no room to close the fingers."""
        return round(self.widest_m - _SPARE_M, 4)

    @property
    def widest_scaled_m(self) -> float:
        """The widest object [m] that can be scaled to a width that the fingers close around."""
        return self.most_m / LEAST_SCALE


PAPER_GRIPPER = Gripper.of(RobotPose())
"""The hand of the paper's robot; a robot of full size takes everything that it takes."""


def farthest_m(robot: RobotPose) -> float:
    """Return how far [m] a base may move while one point stays within the arm's reach: from one side to the other."""
    return round(2 * robot.model.stretched_m, 2)


@dataclass(frozen=True, slots=True)
class Sizing:
    """Rule for the sizes of the objects that a plan handles.

    Attributes:
        seed: Seed of the widths; None for the paper's aim, as far as possible.
        keep: Whether everything keeps its size.
    """

    seed: int | None = None
    keep: bool = False

    def factor(self, thing: SceneObject, gripper: Gripper) -> float:
        """Return the factor S of an object, 1.0 where it keeps its size."""
        return 1.0 if self.keep else scale_factor(thing, gripper, self.seed)

    def unfit(self, thing: SceneObject, gripper: Gripper) -> str | None:
        """Return why the hand cannot take an object at any allowed size, in words that follow "it"; else None."""
        width_m = min(thing.extent_m[:2])
        if self.keep and thing.role == "B" and width_m > gripper.widest_m and not has_rim(thing.category):
            return "is to keep its size"
        return too_small(self.factor(thing, gripper))


def scale_factor(thing: SceneObject, gripper: Gripper, seed: int | None = None) -> float:
    """Return the factor S of the size adjustment, however small it is.

    It is 1.0 for fixtures, for items that fit the gripper, and for items too wide to be scaled that have a rim. A seed
    draws the width uniformly over the allowed range; by default the width is the aim, or near it.
    """
    width_m = min(thing.extent_m[:2])
    if thing.role != "B" or width_m <= gripper.widest_m:
        return 1.0
    low, high = max(gripper.least_m / width_m, LEAST_SCALE), gripper.most_m / width_m
    if low > high:
        return 1.0 if has_rim(thing.category) else float(f"{high:.2g}")
    if seed is None:
        return float(f"{max(gripper.aim_m / width_m, low):.2g}")
    return round(Random(f"{seed} {thing.id}").uniform(low, high), 3)


FINGER_ROOM_M = 0.04
"""Room that two fingers need together around an object that they lower into a vessel."""


def has_finger_room(thing: SceneObject, vessel: SceneObject, factor: float) -> bool:
    """Decide whether fingers can lower an item, scaled by a factor, into an item that is open at the top."""
    sides = zip(sorted(thing.extent_m[:2]), sorted(vessel.extent_m[:2]), strict=True)
    return all(factor * side + FINGER_ROOM_M < mouth for side, mouth in sides)


LEAST_TOP_M = 0.03
"""Least width of a flat top onto which things are put: what stands on less falls off with a hand's usual errors."""

LEAST_ACROSS = 0.5
"""Least width of what lies across a rim, as a share of the vessel's: a narrower thing tips into the mouth."""

TO_THE_AIM = Sizing()
"""Scale objects that are too wide to the paper's aim."""


def graspable_items(scene: Scene, sizing: Sizing) -> tuple[str, ...]:
    """Return the ids of a scene's items that its robot's hand takes, at their adjusted sizes."""
    gripper, things = Gripper.of(scene.robot), scene.objects.values()
    return tuple(thing.id for thing in things if thing.role == "B" and sizing.unfit(thing, gripper) is None)


def too_small(factor: float) -> str | None:
    """Return why an object must not be scaled by a factor, in words that follow the object's name; None if it may."""
    if factor >= LEAST_SCALE:
        return None
    return f"would be scaled by {factor:g}, and nothing is scaled by less than {LEAST_SCALE:g}"


@dataclass(frozen=True, slots=True)
class Resizing(Record):
    """One object that does not have its original size.

    Attributes:
        factors: What its size is multiplied by along its own axes.
        before_m, after_m: Size of its bounding box along its own axes [m].
    """

    object_id: str
    factors: Vector3
    before_m: Vector3
    after_m: Vector3

    @property
    def by(self) -> str:
        """The factor in words, one where it is the same along all axes."""
        different = self.factors if len(set(self.factors)) > 1 else self.factors[:1]
        return " x ".join(f"{factor:g}" for factor in different)

    def __str__(self) -> str:
        """Return the change in words."""
        sides = (" x ".join(f"{1000 * side:.0f}" for side in extent) for extent in (self.before_m, self.after_m))
        return f"{self.object_id} is scaled by {self.by}, from {' to '.join(sides)} mm"


def planned_resizings(scales: Mapping[str, float], scene: Scene) -> tuple[Resizing, ...]:
    """Return the changes of a scene's sizes by a task's factors, in order; those of unknown objects change nothing."""
    known = ((scene.objects[name], factor) for name, factor in scales.items() if name in scene.objects)
    return tuple(
        Resizing(thing.id, (factor,) * 3, thing.extent_m, thing.scaled(factor).extent_m)
        for thing, factor in known
        if factor != 1.0
    )


def resized_targets(task: Task, scene: Scene) -> tuple[Resizing, ...]:
    """Return the targets of a task that a scene has at another scale than 1."""
    targets = {subtask.target for subtask in task.subtasks}
    return tuple(change for change in scaled_objects(scene) if change.object_id in targets)


def scaled_objects(scene: Scene) -> tuple[Resizing, ...]:
    """Return the objects that a scene has at another scale than 1, such as after a task's factors were applied."""
    return tuple(
        Resizing(thing.id, thing.scale, thing.bbox_extent, thing.extent_m)
        for thing in scene.objects.values()
        if thing.scale != (1.0, 1.0, 1.0)
    )
