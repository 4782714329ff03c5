"""Things without a box are found because they stand out of the depths, and matched with the truth by their pixels."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from executor.assets.library import LIBRARY
from executor.bench.photo.score import match_things
from executor.photo.fitting.likelihood import Fit
from executor.photo.geometry.residuals import box_of, residual_segments
from executor.photo.output import visible_owners
from executor.photo.room.estimate import RoomEstimate
from executor.photo.room.fitter import STOOD_OUT, RoomFitter
from executor.photo.room.reconstruct import FittedRoom, reconstruct
from tests.executor.photo.test_fit import BOWL, TABLE, seen_from_above


@pytest.fixture(scope="module")
def alone() -> FittedRoom:
    """The table with the bowl, without any box."""
    observation, _ = seen_from_above(TABLE, BOWL)
    return reconstruct(observation, [], (), find_more=True)


def test_what_stands_out_is_found_in_pieces() -> None:
    observation, boxes = seen_from_above(TABLE, BOWL)
    down = np.maximum(-observation.rays[..., 2], 1e-6)
    floor_m = np.where(observation.rays[..., 2] < -1e-6, observation.eye_m[2] / down, np.inf)
    largest, *_ = residual_segments(observation, floor_m)
    assert np.allclose(box_of(largest), boxes[0].box_px, atol=4.0)
    assert residual_segments(observation, observation.z_m) == []


def test_holes_cut_nothing_small_to_pieces() -> None:
    glass = replace(BOWL, entry=LIBRARY["tumbler"], x_m=2.2, y_m=0.1, size_m=(0.08, 0.08, 0.14))
    observation, boxes = seen_from_above(TABLE, glass)
    table_alone, _ = seen_from_above(TABLE)
    holes = np.random.default_rng(3).random(observation.z_m.shape) < 0.1
    punctured = replace(observation, z_m=np.where(holes, 0.0, observation.z_m))
    (piece,) = residual_segments(punctured, table_alone.z_m)
    assert np.allclose(box_of(piece), boxes[1].box_px, atol=2.0)


@pytest.mark.slow
def test_a_room_is_found_without_any_box(alone: FittedRoom) -> None:
    # Nobody can tell a desk from a table of its size.
    assert [thing.fit.guess.entry.category.replace("desk", "table") for thing in alone.things] == ["table", "bowl"]
    assert {thing.detection.source for thing in alone.things} == {STOOD_OUT}


def test_a_box_without_a_thing_adopts_what_was_found_alone() -> None:
    observation, boxes = seen_from_above(TABLE)
    room = RoomEstimate(observation, (), boxes, 0.0)
    fitter = RoomFitter(room)
    assert not fitter.adopt(0)
    room.detections.append(replace(boxes[0], label="", category=None, source=STOOD_OUT))
    desk = replace(TABLE, entry=LIBRARY["desk_four_legs"])
    room.fits[1] = Fit(desk, 0.0, (), 1.0, 0.0, 100, None)
    assert fitter.adopt(0) and list(room.fits) == [0]
    assert room.fits[0].guess.entry.category == "table", "as its box is called, since nobody can tell it from a desk"


@pytest.mark.slow
def test_what_is_left_of_a_thing_is_left_out_where_that_is_fitted_around_it() -> None:
    observation, (box,) = seen_from_above(TABLE)
    room = RoomEstimate(observation, (), [], 0.0)
    RoomFitter(room).discover(lambda words: None)
    (alone,) = room.fits
    room.drop_contained_fits()
    assert list(room.fits) == [alone]
    # Each stands in the other: the smaller one is what is left.
    around, index = replace(room.fits[alone].guess, size_m=(1.2, 0.8, 0.75)), len(room.detections)
    room.detections.append(replace(box, box_px=(0.0, 0.0, 320.0, 240.0), source=STOOD_OUT))
    room.fits[index] = Fit(around, 0.0, (), 1.0, 0.0, 100, None)
    room.drop_contained_fits()
    assert list(room.fits) == [index] and "what is left of other things" in room.reasons[alone]


@pytest.mark.parametrize(
    ("beside_m", "width_m", "stays"), [(0.005, 0.07, False), (0.07, 0.07, True), (0.0, 0.12, True)]
)
def test_of_two_items_in_one_place_the_one_without_a_box_is_left_out(
    beside_m: float, width_m: float, *, stays: bool
) -> None:
    apple = replace(BOWL, entry=LIBRARY["red_apple"], size_m=(0.07, 0.07, 0.07))
    observation, boxes = seen_from_above(TABLE, apple)
    room = RoomEstimate(observation, (), boxes, 0.0)
    room.detections.append(replace(boxes[1], label="", category=None, source=STOOD_OUT))
    second = replace(apple, y_m=apple.y_m + beside_m, size_m=(width_m, width_m, 0.07))
    for index, guess in enumerate((TABLE, apple, second)):
        room.add_fit(index, Fit(guess, 0.0, (), 1.0, 0.0, 100, None))
    room.drop_contained_fits()
    assert (2 in room.fits) is stays and 1 in room.fits


@pytest.mark.slow
def test_what_stood_on_something_that_is_lower_by_now_is_in_the_air() -> None:
    observation, boxes = seen_from_above(TABLE, BOWL)
    room = RoomEstimate(observation, (), boxes, 0.0)
    fitter = RoomFitter(room)
    fitter.fit(0, [0.0], ())
    fitter.fit(1, None, ())
    assert not room.is_in_air(0) and not room.is_in_air(1)
    room.fits[0] = replace(room.fits[0], guess=replace(room.fits[0].guess, size_m=(1.0, 0.6, 0.55)))
    assert not room.is_in_air(0) and room.is_in_air(1)


def test_what_was_found_alone_stands_for_what_it_covers(alone: FittedRoom) -> None:
    observation, _ = seen_from_above(TABLE, BOWL)
    shown = visible_owners(observation, {"table_7": TABLE, "bowl_7": BOWL})
    masks = {"table_7": shown == 0, "bowl_7": shown == 1}
    found, invented = match_things(masks, {}, SimpleNamespace(found=alone, observation=observation))  # type: ignore[arg-type]
    assert [found[name] for name in ("table_7", "bowl_7")] == [thing.id for thing in alone.things] and invented == ()
