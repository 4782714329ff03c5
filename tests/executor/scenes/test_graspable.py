"""Things that a task takes hold of fit between the fingers, adjusted or not."""

from __future__ import annotations

import numpy as np
import pytest

from executor.scenes.rooms import Room
from executor.scenes.rooms.room import HARDLY_GRASPABLE_M


def _room(seed: int) -> Room:
    return Room("room", "kitchen", np.random.default_rng(seed), 3.0, 3.0)


@pytest.mark.parametrize("model", ["half_apple", "orange", "tumbler", "cup", "bottle"])
def test_no_width_is_too_small_to_be_adjusted_and_too_large_for_the_gripper(model: str) -> None:
    for seed in range(40):
        width_m = min(_room(seed).draw(model, "thing_0", graspable=True).bbox_extent[:2])
        assert not HARDLY_GRASPABLE_M[0] < width_m < HARDLY_GRASPABLE_M[1]


def test_what_fits_is_what_the_room_draws_and_its_id_is_kept() -> None:
    plain = [_room(seed).draw("half_apple", "apple_0") for seed in range(40)]
    drawn = [_room(seed).draw("half_apple", "apple_0", graspable=True) for seed in range(40)]
    fits = [not HARDLY_GRASPABLE_M[0] < min(thing.bbox_extent[:2]) < HARDLY_GRASPABLE_M[1] for thing in plain]
    assert True in fits and False in fits
    assert [a == b for a, b in zip(plain, drawn, strict=True)] == fits
    assert {thing.id for thing in drawn} == {"apple_0"}
