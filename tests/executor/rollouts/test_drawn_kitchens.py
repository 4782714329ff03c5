"""Drawn kitchens that once were not mastered.

A drawer was opened for nothing (T1), a door stood as near to a cabinet as it may (T2). In T3, fingers left a
bowl through its wall (51191, 51396), or all that was looked at had the arm reach across the table under the bowl.
In T2, fingers under a shelf dragged half an apple along (51180), or no place was found for it (51076).
"""

from __future__ import annotations

import pytest

import oag
from executor.rollouts.rollout import failure_of, rollout
from executor.scenes.generators import long_horizon

pytestmark = [pytest.mark.physics, pytest.mark.slow]


KITCHENS = [
    ("T1", 50125),
    *(("T2", seed) for seed in (50026, 51076, 51180)),
    *(("T3", seed) for seed in (51191, 51322, 51383, 51396)),
]


@pytest.mark.parametrize(("family", "seed"), KITCHENS)
def test_a_drawn_kitchen_is_mastered(family: str, seed: int) -> None:
    pair = long_horizon.draw(family, seed)
    done = rollout(oag.compose(pair.task, scene=pair.scene), pair.scene, seed, vary=False)
    assert done.succeeded, failure_of(done)
