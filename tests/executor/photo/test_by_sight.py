"""Without depth: where a search begins, how far off a thing is whose foot is hidden, and what stands on nothing."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from executor.assets.library import LIBRARY
from executor.photo.fitting.body import Guess
from executor.photo.fitting.fit import sharpened
from executor.photo.fitting.likelihood import Fit
from executor.photo.fitting.starts import outline_starts
from executor.photo.inputs.annotations import Sighting
from executor.photo.room.fitter import RoomFitter
from executor.photo.room.known import KnownRoom
from executor.photo.room.reconstruct import reconstruct
from executor.photo.space.observation import Observation
from tests.executor.photo.test_fit import SIZE, TABLE, seen_from_above

FRIDGE = Guess(LIBRARY["fridge_one_door"], 2.4, -0.7, 0.2, 0.0, (0.7, 0.62, 1.3))


def by_sight(*things: Guess) -> tuple[Observation, list[Sighting]]:
    """Returns what a camera sees of some things, without its depths."""
    seen, boxes = seen_from_above(*things)
    return replace(seen, z_m=np.zeros_like(seen.z_m), heading_rad=things[0].yaw_rad), boxes


def nearest_m(thing: Guess, seen: Observation, box: Sighting) -> float:
    """Returns how far the nearest start for a thing is from its middle."""
    begun = outline_starts(seen, box.box_px, [thing.entry], 0.0, [thing.yaw_rad])
    return min(math.dist((one.x_m, one.y_m), (thing.x_m, thing.y_m)) for one in begun)


@pytest.mark.parametrize("y_m", [-0.9, 0.0, 0.9])
def test_a_tall_thing_is_looked_for_behind_the_middle_of_its_box(y_m: float) -> None:
    thing = replace(FRIDGE, y_m=y_m)
    seen, (box,) = by_sight(thing)
    assert nearest_m(thing, seen, box) < 0.1


@pytest.mark.parametrize(("x_m", "y_m"), [(0.8, 0.1), (1.9, 1.15), (1.9, -1.15)])
def test_what_a_border_cuts_is_looked_for_beyond_it(x_m: float, y_m: float) -> None:
    thing = replace(TABLE, x_m=x_m, y_m=y_m)
    seen, (box,) = by_sight(thing)
    x0, _, x1, y1 = box.box_px
    assert x0 < 1.0 or x1 > SIZE[0] - 1.0 or y1 > SIZE[1] - 1.0
    assert nearest_m(thing, seen, box) < 0.16


def test_what_hides_its_foot_is_as_far_off_as_its_edges_tell() -> None:
    before = replace(TABLE, x_m=1.6, y_m=-0.5)
    seen, boxes = by_sight(FRIDGE, before)
    room = KnownRoom(seen, (), boxes, 0.0)
    room.keep(1, Fit(before, 0.0, (), 1.0, 0.0, 100, None))
    (length, width, height), share = FRIDGE.size_m, 1.06
    size = (share * length, share * width, 1.5 - share * (1.5 - height))
    farther = replace(FRIDGE, x_m=share * FRIDGE.x_m, y_m=share * FRIDGE.y_m, size_m=size)
    found = sharpened(room.around(0), boxes[0].box_px, Fit(farther, 0.0, (), 1.0, 0.0, 100, None))
    assert math.dist((found.guess.x_m, found.guess.y_m), (FRIDGE.x_m, FRIDGE.y_m)) < 0.03


def test_what_nothing_was_found_under_is_no_giant_on_the_floor() -> None:
    orange = Guess(LIBRARY["orange"], 2.05, -0.05, 0.0, 0.7, (0.08, 0.08, 0.08))
    seen, (table, box) = by_sight(TABLE, orange)
    (left_out,) = reconstruct(seen, [box], ()).unfitted
    assert left_out.reason == "nothing was found that it stands on"
    room = KnownRoom(seen, (), [table, box], 0.0)
    fitter = RoomFitter(room)
    fitter.fit(0, [0.0], ())
    assert fitter.fit(1, None, ()) == "orange: orange" and not room.is_in_air(1)
    higher = replace(TABLE, size_m=(1.0, 0.6, 0.71))
    room.fits[0] = replace(room.fits[0], guess=higher)
    assert room.is_in_air(1), "what is moved so little moves what stands on it, by sight"


def test_where_depths_are_bent_the_picture_tells_how_far_off_a_thing_is() -> None:
    seen, boxes = seen_from_above(TABLE)
    bent = replace(seen, z_m=1.02 * seen.z_m, bend_share=0.02, heading_rad=TABLE.yaw_rad)
    (table,) = reconstruct(bent, boxes, (), alone=False).things
    guess = table.fit.guess
    assert guess.entry.model == "table_four_legs"
    # By its depths it is 4.4 cm farther off.
    assert math.dist((guess.x_m, guess.y_m), (TABLE.x_m, TABLE.y_m)) < 0.015
