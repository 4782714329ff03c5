"""A choice of a dry run is found again where physics has left things a little off, and nowhere else."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from executor.geometry import hand_rotation, transform
from executor.planning.choices import SAME_HAND_M, SAME_HEADING_RAD, SAME_PLACE_M, Near
from executor.planning.stances import HALF_TURN

HAND = transform(hand_rotation(0.4, 0.6), [1.0, 0.2, 0.8])
HOME = np.zeros(7)
SMALL = st.floats(-0.9, 0.9)


@given(off=st.tuples(SMALL, SMALL, SMALL, SMALL), turns=st.integers(-2, 2))
def test_a_base_that_is_a_little_off_is_the_same_one_whatever_whole_turns(
    off: tuple[float, float, float, float], turns: int
) -> None:
    chosen = np.array([1.0, -2.0, 0.5, 0.3])
    scale = np.array([SAME_PLACE_M, SAME_PLACE_M, SAME_HEADING_RAD, SAME_PLACE_M])
    near = Near(chosen, HAND, HOME)
    assert near.has_base(chosen + scale * off + [0.0, 0.0, 2 * np.pi * turns, 0.0])
    for axis in range(4):
        farther = chosen.copy()
        farther[axis] += 1.1 * scale[axis]
        assert not near.has_base(farther)


@given(off=st.tuples(SMALL, SMALL, SMALL))
def test_a_hand_is_the_same_one_with_its_fingers_turned_half_round_but_not_from_elsewhere(
    off: tuple[float, float, float],
) -> None:
    near, moved = Near(np.zeros(3), HAND, HOME), HAND.copy()
    moved[:3, 3] += np.array(off) * SAME_HAND_M / 2
    assert near.has_hand(moved) and near.has_hand(moved @ HALF_TURN)
    assert not near.has_hand(transform(hand_rotation(0.4, 1.2), HAND[:3, 3]))
    assert not near.has_hand(transform(HAND[:3, :3], HAND[:3, 3] + [0.0, 0.0, 1.1 * SAME_HAND_M]))
