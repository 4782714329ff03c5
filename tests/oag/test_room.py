"""What sizes and distances exclude is impossible: boxes that are placed at random are never excluded."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from oag.room import Extent, can_be_inside, can_both_be_inside

sides = st.floats(0.005, 0.6)
boxes = st.tuples(sides, sides, sides)
seeds = st.integers(0, 2**31)
# More than the wall that the rules grant to a place, and than rounding.
SPARE_M = 0.00101


def turned(thing_m: Extent, seed: int) -> np.ndarray:
    """The eight corners (8, 3) [m] of a box around the origin at a random rotation."""
    signs = np.array(np.meshgrid([-0.5, 0.5], [-0.5, 0.5], [-0.5, 0.5])).reshape(3, -1).T
    return np.asarray(Rotation.random(random_state=seed).apply(signs * np.array(thing_m)), dtype=float)


@given(boxes, seeds)
@settings(max_examples=300, deadline=None)
def test_a_box_at_any_rotation_is_in_the_box_around_it(thing_m: Extent, seed: int) -> None:
    place_m = tuple((np.ptp(turned(thing_m, seed), axis=0) + SPARE_M).tolist())
    assert can_be_inside(thing_m, place_m, open_top=False)
    assert can_be_inside(thing_m, place_m, open_top=True)


def below(corners: np.ndarray, level: float) -> np.ndarray:
    """Extreme points (N, 3) of the part of a box below a level, by cutting its twelve edges."""
    edges = [(a, b) for a in range(8) for b in range(a) if bin(a ^ b).count("1") == 1]
    low, high = (corners[list(ends)] for ends in zip(*edges, strict=True))
    share = np.divide(level - low[:, 2], high[:, 2] - low[:, 2], where=low[:, 2] != high[:, 2], out=np.full(12, -1.0))
    cut = ((share >= 0) & (share <= 1))[:, None]
    points = np.where(cut, low + share[:, None] * (high - low), low)[cut[:, 0]]
    return np.concatenate([corners[corners[:, 2] <= level], points])


@given(boxes, seeds, st.floats(0.0, 1.0))
@settings(max_examples=300, deadline=None)
def test_a_box_that_sticks_out_of_a_vessel_is_in_it(thing_m: Extent, seed: int, share: float) -> None:
    """The vessel is around the part of the box that is below its rim, which is at its middle or higher."""
    corners = turned(thing_m, seed)
    rim = share * float(corners[:, 2].max())
    wide, deep, _ = (np.ptp(below(corners, rim), axis=0) + SPARE_M).tolist()
    height = rim - float(corners[:, 2].min()) + SPARE_M
    assert can_be_inside(thing_m, (wide, deep, height), open_top=True)


@given(boxes, boxes, seeds, st.floats(0.0, 1.0), st.floats(0.0, 1.0), st.sampled_from([0, 1, 2]))
@settings(max_examples=300, deadline=None)
def test_two_boxes_next_to_or_on_each_other_are_in_the_vessel_around_both(
    one_m: Extent, two_m: Extent, seed: int, along: float, across: float, axis: int
) -> None:
    one, two = turned(one_m, seed), turned(two_m, seed + 1)
    one, two = one - one.min(axis=0), two - two.min(axis=0)
    shift = np.array([along, across, 0.5]) * np.ptp(one, axis=0)
    shift[axis] = np.ptp(one, axis=0)[axis]
    both = np.concatenate([one, two + np.where(np.arange(3) == 2, shift * (axis == 2), shift)])
    place_m = tuple((np.ptp(both, axis=0) + SPARE_M).tolist())
    assert can_both_be_inside(one_m, two_m, place_m)
    assert can_both_be_inside(two_m, one_m, place_m)


@pytest.mark.parametrize(
    ("thing_m", "place_m", "open_top", "fits"),
    [
        ((0.20, 0.04, 0.02), (0.112, 0.08, 0.09), True, True),
        ((0.50, 0.05, 0.05), (0.45, 0.40, 0.30), False, True),
        ((0.14, 0.14, 0.07), (0.08, 0.08, 0.10), True, False),
        ((0.05, 0.05, 0.25), (0.05, 0.05, 0.05), False, False),
        ((0.05, 0.05, 0.25), (0.08, 0.08, 0.08), False, False),
        ((0.05, 0.05, 0.25), (0.06, 0.06, 0.08), True, False),
        ((0.07, 0.07, 0.07), (0.07, 0.07, 0.07), True, False),
        ((0.30, 0.30, 0.01), (0.40, 0.20, 0.10), False, False),
    ],
)
def test_boxes_that_go_in_and_boxes_that_do_not(thing_m: Extent, place_m: Extent, open_top: bool, fits: bool) -> None:
    assert can_be_inside(thing_m, place_m, open_top=open_top) is fits


def test_two_glasses_do_not_go_into_a_box_for_one() -> None:
    glass_m = (0.05, 0.05, 0.12)
    assert not can_both_be_inside(glass_m, glass_m, (0.058, 0.058, 0.08))
    assert can_both_be_inside(glass_m, glass_m, (0.11, 0.06, 0.08))
