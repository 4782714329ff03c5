"""What a search has ended at is left for what costs less and is no way down from there."""

from __future__ import annotations

import pytest

from executor.assets.library import LIBRARY
from executor.photo.fitting.evidence import PixelEvidence
from executor.photo.fitting.hypothesis import PoseHypothesis
from executor.photo.fitting.likelihood import Likelihood
from executor.photo.fitting.refinement import refit_handles
from executor.photo.fitting.starts import starts
from tests.executor.photo.test_fit import painted_around

SIZE_M = (0.6, 0.5, 0.8)
CABINET = PoseHypothesis(LIBRARY["cabinet_one_door"], 1.9, 0.0, 0.4, 0.0, SIZE_M, (("hinge", "right"),))


def test_a_short_handle_is_found_by_who_begins_with_a_long_one_on_the_other_side() -> None:
    true = PoseHypothesis(LIBRARY["fridge_one_door"], 2.0, 0.0, 0.4, 0.0, (0.7, 0.6, 1.4))
    true = true.with_parameters(hinge="left", handle_height_m=0.67, handle_length_m=0.15)
    around, box = painted_around(true)
    pixels = PixelEvidence.around(around.observation, box.box_px, around.other_m, around.other, 5000)
    fine = Likelihood(pixels, around.near)
    begun = true.with_parameters(hinge="right", handle_height_m=0.75, handle_length_m=0.30)
    found = dict(refit_handles(fine, fine.rated(begun)).guess.parameters)
    assert found["hinge"] == "left"
    assert found["handle_height_m"] == pytest.approx(0.67, abs=0.02)
    assert found["handle_length_m"] == pytest.approx(0.15, abs=0.03)


def test_what_is_lower_than_its_model_mostly_is_begins_as_low_as_it_is_seen() -> None:
    low = PoseHypothesis(LIBRARY["shelf_open"], 2.0, 0.0, 0.0, 0.0, (0.3, 0.7, 0.47))
    assert low.entry.height.low > 0.55
    begun = starts(low.corners_m(), [low.entry], 0.0, ())
    assert any(one.size_m[2] == pytest.approx(0.47, abs=0.01) for one in begun)
