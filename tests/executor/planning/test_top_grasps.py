"""A mug whose ear points at the hand is taken near its top, above the ear; what is round or low is left to others."""

from __future__ import annotations

import numpy as np
import pytest

from executor.assets.library import asset_for, sample
from executor.geometry import pitch_of, rotation_z, transform
from executor.planning.grasps import BACK_M, GRIP_DEPTH_M, item_goals, top_goals
from oag.model.robots import PAPER_ROBOT


def _mug() -> tuple[float, list[tuple[float, np.ndarray]], list[tuple[float, np.ndarray]]]:
    item = sample("mug", 3)
    asset = asset_for(item.scaled(0.05 / item.extent_m[1]))
    T = transform(rotation_z(np.pi), [0.0, 0.0, 0.0])
    made = item_goals(PAPER_ROBOT.hand, asset, T), top_goals(asset, T)
    both = ([(goal.heading_rad, goal.T_world_eef) for goal in goals] for goals in made)
    return asset.extent_m[2], *both


def test_a_mug_with_its_ear_to_the_hand_has_tilted_grasps_only_near_its_top() -> None:
    height_m, usual, at_top = _mug()

    def tilted(goals: list[tuple[float, np.ndarray]]) -> list[np.ndarray]:
        # The ear is at -x, from where a hand comes whose heading is 0.
        return [T for heading, T in goals if abs(np.sin(heading)) < 0.1 < np.cos(heading) and 0.2 < pitch_of(T) < 1.2]

    assert not tilted(usual)
    assert tilted(at_top)
    for T in tilted(at_top):
        assert height_m / 2 - T[2, 3] >= GRIP_DEPTH_M - max(BACK_M)
        assert T[2, 3] > 0.0


@pytest.mark.parametrize("model", ["tumbler", "cup", "die", "half_apple"])
def test_what_is_round_or_low_has_none(model: str) -> None:
    item = sample(model, 0)
    assert not top_goals(asset_for(item.scaled(0.05 / min(item.extent_m[:2]))), np.eye(4))


def test_a_mug_that_lies_has_none() -> None:
    lying = np.array([[0.0, 0.0, 1.0, 0.0], [0.0, 1.0, 0.0, 0.0], [-1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]])
    assert not top_goals(asset_for(sample("mug", 3)), lying)
