"""Module 4 without a model: the factors of a plan's targets, and a refusal where one would become another thing."""

from __future__ import annotations

from collections.abc import Iterable

from llm.errors import QueryError
from oag import Scene
from oag.task.sizes import WIDEST_GRASP_M, scale_factor, too_small


def scale_factors(targets: Iterable[str], scene: Scene) -> dict[str, float]:
    """Returns the factor of each target, in the order in which they first occur.

    Args:
        targets: Target of each subtask, in order; ids may recur.
        scene: The scene that has them.
    """
    return {target: scale_factor(scene[target]) for target in targets}


def check_sizes(targets: Iterable[str], scene: Scene, query: str, understood: str) -> None:
    """Refuses to handle what fits the gripper at no size that it may be scaled to.

    Args:
        targets: Target of each subtask.
        scene: The scene that has them.
        query: The query as it was given.
        understood: What was understood of it.

    Raises:
        QueryError: Code "too-large".
    """
    for target, factor in scale_factors(targets, scene).items():
        unfit = too_small(factor)
        if unfit is not None:
            width_m = min(scene[target].extent_m[:2])
            problem = f"{target} is {width_m:.3f} m wide, the gripper takes at most {WIDEST_GRASP_M:.3f} m: it {unfit}"
            raise QueryError("too-large", query, problem, understood=understood)
