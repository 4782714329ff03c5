"""Drawn kitchens that once were not mastered: a drawer opened for nothing, a door as near to a cabinet as it may be."""

from __future__ import annotations

import pytest

import oag
from executor.execution import failure_of, rollout
from executor.scenes import long_horizon

pytestmark = [pytest.mark.physics, pytest.mark.slow]


@pytest.mark.parametrize(("family", "seed"), [("T1", 50125), ("T2", 50026)])
def test_a_drawn_kitchen_is_mastered(family: str, seed: int) -> None:
    pair = long_horizon.draw(family, seed)
    done = rollout(oag.compose(pair.task, scene=pair.scene), pair.scene, seed, vary=False)
    assert done.succeeded, failure_of(done)
