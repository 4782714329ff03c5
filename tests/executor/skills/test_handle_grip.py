"""When a handle is still held: pulled along the way the fingers close, it hangs on one of them."""

from __future__ import annotations

import pytest

import executor
import llm
import oag
from executor.scenes.generators import any_task
from oag.sizes import Sizing


@pytest.mark.parametrize(
    "seed", [pytest.param(90030, id="a microwave"), pytest.param(90019, id="a refrigerator", marks=pytest.mark.slow)]
)
def test_a_door_that_is_pulled_along_the_closing_of_the_fingers_opens(seed: int) -> None:
    wish = any_task.draw(seed)
    graph = oag.compose(llm.propose(wish.query, wish.scene, sizing=Sizing(keep=True)).task, scene=wish.scene)
    found = executor.feasible(graph, wish.scene, seed, vary=False)
    assert found, found.reason
    done = executor.rollout(graph, wish.scene, seed, vary=False, conditions=found.conditions())
    assert done.succeeded, done.failure
