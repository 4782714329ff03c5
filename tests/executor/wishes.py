"""Wishes of T7 by their seed, from the sentence to the physics."""

from __future__ import annotations

import executor
import llm
import oag
from executor.rollouts.rollout import Rollout
from executor.scenes.generators import any_task
from oag.sizes import Sizing


def pursued(seed: int) -> Rollout:
    """Return the rollout of a wish with the choices of its forecast, which has to be feasible."""
    wish = any_task.draw(seed)
    task = llm.propose(wish.query, wish.scene, sizing=Sizing(keep=True)).task
    found = executor.feasible(oag.compose(task, scene=wish.scene), wish.scene, seed, vary=False)
    assert found, found.reason
    graph = oag.compose(found.task, scene=wish.scene)
    return executor.rollout(graph, wish.scene, seed, vary=False, conditions=found.conditions())
