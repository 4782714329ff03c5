"""Sizes and the gripper: how wide it takes things, the factor that brings an item to that, and how much is too much.

Source: the paper's object size adjustment (module 4): aim 0.05 m, type A never scaled. Its limit is 0.06 m; here it is
what the robot's gripper takes (docs/departures.md).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from oag.scene import Scene, SceneObject, Vector3

GRIPPER_OPENING_M = 0.056
"""How far the robot's fingers open: a Panda's 0.08 m at a scale of 0.7. The simulated robot is tested against it."""

GRIP_CLEARANCE_M = 0.003
WIDEST_GRASP_M = GRIPPER_OPENING_M - GRIP_CLEARANCE_M
"""The widest thing that the fingers close around."""

GRASP_AIM_M = 0.05
LEAST_SCALE = 0.25
"""Nothing is scaled by less: it would be another thing."""


def scale_factor(thing: SceneObject) -> float:
    """Returns the factor S of the size adjustment, rounded to two decimals, however small it is.

    It is 1.0 for fixtures and for items that fit the gripper as they are.

    Args:
        thing: The object; its size is that of its bounding box with the scale it has in the scene.
    """
    width_m = min(thing.extent_m[:2])
    return round(GRASP_AIM_M / width_m, 2) if thing.role == "B" and width_m > WIDEST_GRASP_M else 1.0


def too_small(factor: float) -> str | None:
    """Returns why an object must not be scaled by a factor, in words that follow the object's name; None if it may."""
    if factor >= LEAST_SCALE:
        return None
    return f"would be scaled by {factor:g}, and nothing is scaled by less than {LEAST_SCALE:g}"


@dataclass(frozen=True, slots=True)
class Resizing:
    """One object that a task scales.

    Attributes:
        object_id: Its id.
        factor: What its size is multiplied by.
        before_m, after_m: Size of its bounding box along its own axes.
    """

    object_id: str
    factor: float
    before_m: Vector3
    after_m: Vector3

    def __str__(self) -> str:
        """Returns the change in words."""
        sides = (" x ".join(f"{1000 * side:.0f}" for side in extent) for extent in (self.before_m, self.after_m))
        return f"{self.object_id} is scaled by {self.factor:g}, from {' to '.join(sides)} mm"


def resizings(scales: Mapping[str, float], scene: Scene) -> tuple[Resizing, ...]:
    """Returns what changes its size, in the order of the factors; factors of 1 and of unknown objects change nothing.

    Args:
        scales: Object id -> factor, as a task has them.
        scene: The scene at its nominal sizes.
    """
    known = ((scene.objects[name], factor) for name, factor in scales.items() if name in scene.objects)
    return tuple(
        Resizing(thing.id, factor, thing.extent_m, thing.scaled(factor).extent_m)
        for thing, factor in known
        if factor != 1.0
    )
