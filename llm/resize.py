"""Module 4: the factor by which an item is scaled so that the gripper can take it.

Source: the paper's Object Size Adjustment: limit 0.06 m, aim 0.05 m, type A always 1.0.
"""

from __future__ import annotations

from collections.abc import Iterable

from oag import Scene, SceneObject

GRIPPER_LIMIT_M = 0.06
GRASP_AIM_M = 0.05


def scale_factor(thing: SceneObject) -> float:
    """Returns S, rounded to two decimals: 1.0 for fixtures and for items that fit the gripper as they are.

    Args:
        thing: The object; its size is that of its bounding box with the scale it has in the scene.
    """
    if thing.role == "A":
        return 1.0
    d_min_m = min(thing.extent_m[:2])
    return round(GRASP_AIM_M / d_min_m, 2) if d_min_m > GRIPPER_LIMIT_M else 1.0


def scale_factors(targets: Iterable[str], scene: Scene) -> dict[str, float]:
    """Returns the factor of each target, the first occurrence deciding.

    Args:
        targets: Target of each subtask, in order; ids may recur.
        scene: The scene that has them.
    """
    factors: dict[str, float] = {}
    for target in targets:
        factors.setdefault(target, scale_factor(scene[target]))
    return factors
