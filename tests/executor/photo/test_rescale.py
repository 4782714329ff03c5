"""Depths of a network, bent and of wrong scale, are put right by the floor; a floor that is not there is refused."""

from __future__ import annotations

import math

import numpy as np
import pytest

from executor.bench.photo.tracks import mono_like, noisy
from executor.geometry import Array
from executor.photo.errors import PhotoRefused
from executor.photo.geometry.level import VerticalDirection, correct_depth, scale_by_floor
from executor.photo.inputs.depth import Depth
from executor.photo.inputs.picture import Intrinsics

SIZE = (320, 240)
CAMERA = Intrinsics(280.0, 280.0, 160.0, 120.0, "drawn")
DOWN_RAD, HEIGHT_M = math.radians(30.0), 1.5
UP = np.array([0.0, -math.cos(DOWN_RAD), -math.sin(DOWN_RAD)])


@pytest.fixture(scope="module")
def true_m() -> Array:
    """A floor and a block on it, 0.6 m high, that hides a part of it."""
    down = -(CAMERA.rays(SIZE) @ UP)
    floor = np.where(down > 1e-3, HEIGHT_M / np.maximum(down, 1e-3), 0.0)
    top = (HEIGHT_M - 0.6) / np.maximum(down, 1e-3)
    depth = np.where(floor < 6.0, floor, 0.0)
    depth[60:140, 100:220] = np.where(depth[60:140, 100:220] > 0.0, top[60:140, 100:220], 0.0)
    return depth


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_the_floor_gives_scale_and_straightness(true_m: Array, seed: int) -> None:
    guessed = mono_like(true_m, np.random.default_rng(seed))
    found = scale_by_floor(Depth(guessed, "a network"), CAMERA, VerticalDirection(UP, 9), HEIGHT_M)
    on_floor = (true_m > 0.0) & (guessed > 0.0)
    on_floor[50:150, 90:230] = False
    before = np.abs(guessed / np.where(on_floor, true_m, 1.0) - 1.0)[on_floor]
    after = np.abs(found.z_m / np.where(on_floor, true_m, 1.0) - 1.0)[on_floor]
    assert np.median(after) < 0.01 < np.median(before) and "by the floor" in found.source
    block = found.z_m[70:130, 110:210] / true_m[70:130, 110:210]
    assert np.median(np.abs(block - 1.0)) < 0.04


def test_depths_in_a_unit_of_their_own_are_put_right_too(true_m: Array) -> None:
    found = scale_by_floor(Depth(true_m / 2.5, "a network"), CAMERA, VerticalDirection(UP, 9), HEIGHT_M)
    block = found.z_m[70:130, 110:210] / true_m[70:130, 110:210]
    assert np.median(block) == pytest.approx(1.0, abs=0.002)


def test_what_was_measured_is_not_bent_however_noisy(true_m: Array) -> None:
    rng = np.random.default_rng(0)
    for guessed, is_bent in ((noisy(true_m, rng), False), (mono_like(true_m, rng), True)):
        found = scale_by_floor(Depth(guessed, "a file"), CAMERA, VerticalDirection(UP, 9), HEIGHT_M)
        assert (found.depth_distortion > 0.0) is is_bent


def test_what_is_known_straightens_what_is_around_it(true_m: Array) -> None:
    bent = np.where(true_m > 0.0, true_m * 1.02, 0.0)
    known = np.where(true_m > 0.0, true_m, np.inf)
    known[90:110, 140:160] = np.inf
    straight = correct_depth(bent, known)
    there = np.s_[90:110, 140:160]
    assert np.abs(straight[there] / true_m[there] - 1.0).max() < 0.003
    assert correct_depth(bent, np.full_like(bent, np.inf)) == pytest.approx(bent)


def test_a_floor_that_is_not_there_is_refused(true_m: Array) -> None:
    wall = Depth(np.full_like(true_m, 2.0), "a network")
    with pytest.raises(PhotoRefused, match="no floor is seen"):
        scale_by_floor(wall, CAMERA, VerticalDirection(UP, 9), HEIGHT_M)
