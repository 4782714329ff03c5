"""A mug is turned as its ear is seen; where it is hidden, as far between all turns that hide it as can be."""

from __future__ import annotations

import math

import numpy as np
import pytest

from executor.assets.library import LIBRARY
from executor.photo.fitting.evidence import PixelEvidence
from executor.photo.fitting.fit import fit_thing
from executor.photo.fitting.hypothesis import PoseHypothesis, Size, is_round
from executor.photo.fitting.likelihood import Likelihood, Neighbourhood
from executor.photo.fitting.refinement import orient_by_ear
from executor.photo.fitting.starts import points_of
from tests.executor.photo.test_fit import painted_around, seen_from_above

SIZE_M = (0.115, 0.08, 0.09)
EAR_M = (SIZE_M[0] - SIZE_M[1]) / 2  # From the axis of its body to the middle of its box.


def turned(yaw_rad: float, size_m: Size = SIZE_M) -> PoseHypothesis:
    """Return a mug whose body stands in one place."""
    x, y = 0.9 + EAR_M * math.cos(yaw_rad), EAR_M * math.sin(yaw_rad)
    return PoseHypothesis(LIBRARY["mug"], x, y, yaw_rad, 1.0, size_m)


def found_from(true_rad: float, start_rad: float, size_m: Size = SIZE_M) -> PoseHypothesis:
    """Return what is found of a mug that is turned one way, by who begins with another turn and size."""
    seen, boxes = seen_from_above(turned(true_rad))
    nobody = np.zeros(seen.z_m.shape, dtype=np.int32)
    fine = Likelihood(PixelEvidence.around(seen, boxes[0].box_px, seen.floor_z_m, nobody, 5000), Neighbourhood(()))
    return orient_by_ear(fine, fine.rated(turned(start_rad, size_m))).guess


@pytest.mark.parametrize("start_rad", [pytest.param(0.0, marks=pytest.mark.slow), 3.0])
def test_an_ear_that_is_seen_tells_the_turn(start_rad: float) -> None:
    found = found_from(math.pi / 2, start_rad)
    assert math.remainder(found.yaw_rad - math.pi / 2, 2 * math.pi) == pytest.approx(0.0, abs=0.1)


@pytest.mark.slow
def test_a_body_that_is_too_large_hides_no_ear() -> None:
    found = found_from(math.pi / 2, -1.0, (0.123, 0.086, 0.096))
    assert math.remainder(found.yaw_rad - math.pi / 2, 2 * math.pi) == pytest.approx(0.0, abs=0.1)
    assert found.size_m == pytest.approx(SIZE_M, abs=0.002)


def test_a_hidden_ear_is_in_the_middle_of_what_hides_it() -> None:
    # The camera is at the origin: an ear that points away from it is behind the body.
    assert abs(found_from(0.3, 0.3).yaw_rad) < 0.2


def test_a_die_has_sides_though_it_is_as_long_as_it_is_wide() -> None:
    assert [is_round(LIBRARY[model]) for model in ("plate", "can", "die", "mug")] == [True, True, False, False]
    true = PoseHypothesis(LIBRARY["die"], 1.2, 0.0, 0.35, 0.9, (0.06, 0.06, 0.06))
    around, box = painted_around(true)
    points = points_of(around.observation, box.box_px, around.other_m, around.smaller)
    found = fit_thing(around, box.box_px, [true.entry], [0.9], points)
    assert found is not None and found.guess.size_m[0] == pytest.approx(0.06, abs=0.002)
    assert abs(math.remainder(found.guess.yaw_rad - true.yaw_rad, math.pi / 2)) < 0.05
