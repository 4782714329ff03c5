"""Searches begin where a thing may be: as small as a hand holds, open as far as it stands, round where points lie."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from executor.assets.library import LIBRARY
from executor.geometry import Array
from executor.photo.fitting.evidence import PixelEvidence
from executor.photo.fitting.fit import COARSE_PX
from executor.photo.fitting.hypothesis import PoseHypothesis
from executor.photo.fitting.likelihood import Likelihood, Neighbourhood, RatedHypothesis
from executor.photo.fitting.refinement import cheapest_openings
from executor.photo.fitting.starts import boxes_of_others, outline_starts
from executor.photo.room.estimate import RoomEstimate
from executor.photo.room.fitter import RoomFitter
from executor.photo.room.reconstruct import reconstruct
from tests.executor.photo.test_by_sight import lit
from tests.executor.photo.test_fit import BOWL, TABLE, seen_from_above


def coarse_around(index: int) -> tuple[Likelihood, Array]:
    """Return what guesses of the table or the bowl are judged by, the other one being known, and its points."""
    seen, boxes = seen_from_above(TABLE, BOWL)
    alone, _ = seen_from_above(TABLE) if index else seen_from_above(BOWL)
    known_m = np.where(alone.z_m > 0.0, alone.z_m, np.inf)
    other, nobody = np.zeros(seen.z_m.shape, dtype=np.int32), np.zeros(seen.z_m.shape, dtype=bool)
    patch = PixelEvidence.around(seen, boxes[index].box_px, known_m, other, COARSE_PX, nobody, None)
    points = seen.points_m[boxes[index].pixels(seen.size_px)]
    return Likelihood(patch, Neighbourhood(())), points[points[:, 2] > BOWL.bottom_m + 0.01]


def test_an_item_is_looked_for_as_small_as_it_is_scaled_to_the_hand() -> None:
    small = PoseHypothesis(LIBRARY["half_apple"], 2.3, 0.1, 0.0, 0.7, (0.05, 0.05, 0.024))
    seen, (box,) = seen_from_above(small)
    begun = list(outline_starts(seen, box.box_px, [small.entry], 0.7))
    nearest = min(begun, key=lambda one: abs(one.size_m[1] - 0.05))
    assert nearest.size_m == pytest.approx(small.size_m, abs=0.003)
    assert (nearest.x_m, nearest.y_m) == pytest.approx((2.3, 0.1), abs=0.03)


def test_of_what_stands_open_every_hinge_side_and_opening_is_followed() -> None:
    fridge = PoseHypothesis(LIBRARY["fridge_one_door"], 2.4, 0.2, 0.3, 0.0, (0.7, 0.6, 1.3))
    ways = [(hinge, share) for hinge in ("left", "right") for share in (0.2, 0.5)]
    rated = [
        RatedHypothesis(replace(fridge, x_m=2.0 + cost).with_parameters(hinge=hinge, open_fraction=share), cost)
        for number, (hinge, share) in enumerate(ways)
        for cost in (float(number), 9.0)
    ]
    rated += [
        RatedHypothesis(fridge.with_parameters(hinge="left", open_fraction=0.95), math.inf),  # Into a wall.
    ]
    kept = cheapest_openings(rated)
    assert [one.cost for one in kept] == [0.0, 1.0, 2.0, 3.0]
    told = [dict(one.guess.parameters) for one in kept]
    assert [(one["hinge"], one["open_fraction"]) for one in told] == ways


def test_a_bowl_is_a_rival_where_its_points_lie_and_not_as_large_as_what_it_was_called() -> None:
    coarse, points = coarse_around(1)
    (found,) = boxes_of_others(coarse, points, [BOWL.entry], BOWL.bottom_m, 100.0)
    assert (found.x_m, found.y_m, found.size_m[1]) == pytest.approx((BOWL.x_m, BOWL.y_m, BOWL.size_m[1]), abs=0.02)
    assert boxes_of_others(coarse, points[:5], [BOWL.entry], BOWL.bottom_m, 100.0) == []
    assert boxes_of_others(coarse, points, [BOWL.entry], BOWL.bottom_m, -1e4) == [], "what is far worse is no rival"


@pytest.mark.slow
def test_a_bowl_that_was_called_a_book_is_a_bowl() -> None:
    seen, boxes = seen_from_above(TABLE, BOWL)
    found = (
        reconstruct(seen, [boxes[0], replace(boxes[1], label="book", category="book", provenance="detector")], ())
        .things[1]
        .fit
    )
    assert found.guess.entry is BOWL.entry and found.guess.size_m == pytest.approx(BOWL.size_m, abs=0.01)


@pytest.mark.slow
def test_a_dresser_that_was_called_a_countertop_is_one_with_its_drawers() -> None:
    bare = PoseHypothesis(LIBRARY["cabinet_drawers"], 3.6, -0.6, 0.35, 0.0, (0.6, 0.583, 0.736))
    dresser = bare.with_parameters(drawers=2, handle_length_m=0.3)
    seen, (box,) = seen_from_above(dresser)
    room = RoomEstimate(
        lit(seen, dresser), (), [replace(box, label="countertop", category="countertop", provenance="detector")], 0.0
    )
    fitter = RoomFitter(room)
    fitter.fit(0, [0.0], ())
    assert fitter.rename(0) == "countertop: cabinet_drawers"
    assert dict(room.fits[0].guess.parameters)["drawers"] == 2
