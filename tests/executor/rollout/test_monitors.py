"""Bystanders must stay where they are; robots must be where they were told to be."""

from __future__ import annotations

import numpy as np
import pytest

from executor.monitors import Bystanders, stall
from executor.records import FailureKind
from tests.executor.helpers import MakeWorld, at, settle


@pytest.mark.physics
def test_a_bystander_that_moves_is_a_side_effect(make_world: MakeWorld) -> None:
    world = make_world("kitchen_t3")
    settle(world)
    watch, own = Bystanders(world, "apple_0"), Bystanders(world, "bowl_0")
    assert watch.check() is None
    moved = world.T_world_link("bowl_0") @ at(0.08, 0.0, 0.0)
    world.set_object_pose("bowl_0", moved)
    failure = watch.check()
    assert failure is not None
    assert failure.kind is FailureKind.SIDE_EFFECT
    assert failure.measurements["moved_m"] == pytest.approx(0.08, abs=1e-3)
    assert own.check() is None, "the subtask's own target may move"


def test_a_stall_says_how_far_short_it_is() -> None:
    target = np.zeros(10)
    near, far = target.copy(), target.copy()
    near[0], near[4] = 0.01, 0.01
    far[1], far[5] = 0.05, np.deg2rad(10.0)
    assert stall(near, target) is None
    failure = stall(far, target)
    assert failure is not None and failure.kind is FailureKind.STALLED
    assert failure.measurements == {"base_short_m": 0.05, "arm_short_deg": 10.0}
