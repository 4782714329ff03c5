"""What a search has ended at is left for what costs less and is no way down from there."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from executor.assets.library import LIBRARY
from executor.photo.fitting.evidence import PixelEvidence
from executor.photo.fitting.fit import perturb_and_refine
from executor.photo.fitting.hypothesis import PoseHypothesis
from executor.photo.fitting.likelihood import Fit, Likelihood
from executor.photo.fitting.refinement import neighbouring_boxes, refit_handles
from executor.photo.fitting.starts import starts
from tests.executor.photo.test_fit import painted_around

SIZE_M = (0.6, 0.5, 0.8)
CABINET = PoseHypothesis(LIBRARY["cabinet_one_door"], 1.9, 0.0, 0.4, 0.0, SIZE_M, (("hinge", "right"),))


@pytest.mark.slow
def test_a_door_gets_its_hinge_where_a_side_was_misjudged() -> None:
    around, box = painted_around(CABINET)
    # Twelve centimetres too narrow on the side where the handle is, which so was taken for the other one.
    aside = -math.sin(CABINET.yaw_rad), math.cos(CABINET.yaw_rad)
    narrow = replace(
        CABINET,
        x_m=CABINET.x_m - 0.06 * aside[0],
        y_m=CABINET.y_m - 0.06 * aside[1],
        size_m=(0.6, 0.38, 0.8),
        parameters=(("hinge", "left"),),
    )
    begun = Fit(narrow, 0.0, (), 0.5, 0.1, 100, None)
    found = perturb_and_refine(around, box.box_px, begun, [CABINET.entry]).guess
    assert dict(found.parameters)["hinge"] == "right"
    assert found.size_m[1] == pytest.approx(0.5, abs=0.02)


def test_what_is_right_stays_as_it_is() -> None:
    around, box = painted_around(CABINET)
    right = perturb_and_refine(around, box.box_px, Fit(CABINET, 0.0, (), 1.0, 0.0, 100, None), [CABINET.entry])
    again = perturb_and_refine(around, box.box_px, right, [CABINET.entry])
    assert again is right and right.guess.size_m == pytest.approx(SIZE_M, abs=0.02)


def test_the_other_sides_stay_where_they_are_when_one_is_moved() -> None:
    def sides(guess: PoseHypothesis) -> list[float]:
        """Return how far each upright side is from the origin, along the guess's own axes."""
        c, s = math.cos(guess.yaw_rad), math.sin(guess.yaw_rad)
        x, y = c * guess.x_m + s * guess.y_m, c * guess.y_m - s * guess.x_m
        length, width, _ = guess.size_m
        return [x - length / 2, x + length / 2, y - width / 2, y + width / 2]

    before = sides(CABINET)
    moved = [
        [a for a, b in zip(sides(one), before, strict=True) if abs(a - b) > 1e-9]
        for one in neighbouring_boxes(CABINET, ())
    ]
    assert {len(one) for one in moved} == {0, 1} and sum(not one for one in moved) == 1


def test_what_is_a_little_askew_is_turned_as_what_is_beside_it_with_its_near_corner_held() -> None:
    def corner(guess: PoseHypothesis) -> float:
        return float(np.hypot(*guess.corners_m()[:, :2].T).min())

    askew = replace(CABINET, yaw_rad=CABINET.yaw_rad + 0.15)
    beside = CABINET.yaw_rad + math.pi / 2, CABINET.yaw_rad + 0.8
    turned = [one for one in neighbouring_boxes(askew, beside) if one.yaw_rad != askew.yaw_rad]
    assert {round(one.yaw_rad, 6) for one in turned} == {round(CABINET.yaw_rad, 6)}
    assert corner(turned[0]) == pytest.approx(corner(askew)) and turned[0].size_m == askew.size_m


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
