"""Things that tell of each other: what carries them, what is in another's place, and what a room does without."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from executor.assets.library import LIBRARY
from executor.photo.fitting.evidence import of_one_hue
from executor.photo.fitting.hypothesis import PoseHypothesis
from executor.photo.fitting.likelihood import Fit, Neighbourhood, prior_cost
from executor.photo.fitting.starts import high_enough
from executor.photo.inputs.annotations import Detection
from executor.photo.room.estimate import RoomEstimate, level_heights
from executor.photo.room.fitter import STOOD_OUT, RoomFitter
from executor.photo.room.reconstruct import OF_ONE_HUE, FittedRoom, FittedThing, reconstruct, refit_pairs
from executor.photo.scene import scene_of
from tests.executor.photo.test_by_sight import monocular
from tests.executor.photo.test_fit import TABLE, seen_from_above

COUNTER = PoseHypothesis(LIBRARY["counter_plain"], 2.3, -0.2, 0.1, 0.0, (0.6, 0.9, 0.8))
MICROWAVE = PoseHypothesis(LIBRARY["microwave_side_hinge"], 2.3, -0.2, 0.1, 0.8, (0.4, 0.48, 0.3))
CABINET = PoseHypothesis(LIBRARY["cabinet_two_doors"], 2.3, 0.6, 0.1, 0.0, (0.6, 0.8, 0.8))


def apart_m(guess: PoseHypothesis, other: PoseHypothesis) -> float:
    """Return how far apart two things stand."""
    return math.dist((guess.x_m, guess.y_m), (other.x_m, other.y_m))


def fit_of(guess: PoseHypothesis, explained: float = 1.0) -> Fit:
    """Return a fit of which nothing is known but what it explains."""
    return Fit(guess, 0.0, (), explained, 0.0, 100, None)


@pytest.mark.slow
def test_a_microwave_is_fitted_though_nobody_has_drawn_a_box_around_what_carries_it() -> None:
    behind = PoseHypothesis(LIBRARY["wardrobe_two_doors"], 3.6, 0.5, 0.1, 0.0, (0.6, 1.0, 1.7))
    seen, (_, *boxes) = seen_from_above(COUNTER, MICROWAVE, behind)
    room = reconstruct(seen, boxes, (), find_more=True)
    made = {thing.fit.guess.entry.category: thing for thing in room.things}
    assert set(made) == {"wardrobe", "microwave", "countertop"} and made["countertop"].detection.source == STOOD_OUT
    assert (
        apart_m(made["microwave"].fit.guess, MICROWAVE) < 0.02 and apart_m(made["countertop"].fit.guess, COUNTER) < 0.02
    )
    assert made["microwave"].fit.guess.bottom_m == pytest.approx(0.8, abs=0.005)


def test_level_surfaces_are_where_many_points_lie() -> None:
    rng = np.random.default_rng(0)
    z = np.concatenate([rng.normal(0.8, 0.004, 400), rng.normal(1.12, 0.004, 700), rng.uniform(0.1, 1.1, 1000)])
    assert level_heights(rng.normal(size=(len(z), 3)) * [1, 1, 0] + z[:, None] * [0, 0, 1]) == pytest.approx(
        [1.12, 0.8], abs=0.003
    )
    assert level_heights(np.column_stack([z, z, rng.uniform(0.1, 1.9, len(z))])) == []


def test_what_stands_across_another_is_in_its_way_as_what_stands_along_it() -> None:
    near = Neighbourhood((), (COUNTER,))
    for turned in (0.0, math.pi / 2, math.pi):
        inside = replace(CABINET, y_m=0.3, yaw_rad=COUNTER.yaw_rad + turned)
        beside = replace(CABINET, y_m=0.75, yaw_rad=COUNTER.yaw_rad + turned)
        assert prior_cost(inside, near) > prior_cost(beside, near) + 20.0


@pytest.mark.slow
def test_two_that_are_taken_for_each_other_are_fitted_anew_together() -> None:
    seen, boxes = seen_from_above(CABINET, COUNTER)
    room = RoomEstimate(seen, (), boxes, 0.0)
    fitter = RoomFitter(room)
    # The cabinet is where the counter is seen, which therefore cannot be.
    wrong = {0: replace(CABINET, y_m=0.0, size_m=(0.6, 1.0, 0.8)), 1: replace(COUNTER, y_m=-0.9)}
    for index, guess in wrong.items():
        room.add_fit(index, fit_of(guess, 0.5))
    refit_pairs(fitter, (0, 1), lambda words: None)
    assert all(apart_m(room.fits[index].guess, true) < 0.02 for index, true in enumerate((CABINET, COUNTER)))
    right = dict(room.fits)
    for index in right:
        room.add_fit(index, replace(right[index], explained=0.5))
    refit_pairs(fitter, (0, 1), lambda words: None)
    assert all(apart_m(room.fits[index].guess, right[index].guess) < 0.01 for index in right)


def test_of_two_in_each_other_the_one_that_explains_less_is_the_wrong_one() -> None:
    seen, boxes = seen_from_above(TABLE, COUNTER)
    room = RoomEstimate(seen, (), boxes, 0.0)
    room.add_fit(0, fit_of(TABLE, 0.98))
    room.add_fit(
        1, fit_of(replace(COUNTER, x_m=TABLE.x_m, y_m=TABLE.y_m, yaw_rad=TABLE.yaw_rad, size_m=(0.9, 0.9, 0.8)), 0.8)
    )
    assert not room.is_impossible(0) and room.is_impossible(1)
    assert room.doubt(1) > room.doubt(0)


def test_a_room_does_without_what_is_hardly_seen_and_cannot_be_in_it() -> None:
    seen, boxes = seen_from_above(TABLE, CABINET)
    far = replace(CABINET, x_m=4.0)
    through = PoseHypothesis(LIBRARY["wardrobe_two_doors"], 4.05, 0.62, 0.1, 0.0, (0.6, 0.9, 1.7))
    corner = Detection("wardrobe", "wardrobe", (300.0, 10.0, 320.0, 20.0), 1.0, "drawn")
    things = [(boxes[0], TABLE), (boxes[1], far), (corner, through)]
    every = FittedRoom(tuple(FittedThing(f"{one.label}_0", one, fit_of(guess)) for one, guess in things), (), ())
    assert scene_of(every, "drawn", 0.0)[1].refused
    rest, made = scene_of(every, "drawn", 0.01 * seen.z_m.size)
    assert (
        made.refused == ""
        and made.scene is not None
        and [thing.id for thing in rest.things] == ["table_0", "bottom_cabinet_0"]
    )
    alone = replace(every, things=tuple(replace(one, boxed=one.detection is not corner) for one in every.things))
    assert scene_of(alone, "drawn", 0.0)[1].refused == "", "nobody has drawn a box around it"
    assert rest.unfitted[0].detection is corner and "with it the room cannot be" in rest.unfitted[0].reason


@pytest.mark.parametrize(
    ("depth_distortion", "explained", "cost", "doubtful"),
    [(0.0, 0.6, 0.0, True), (0.02, 0.6, 0.0, False), (0.02, 0.6, 90.0, True), (0.02, 0.3, 0.0, True)],
)
def test_where_depths_are_bent_what_looks_right_is_not_doubted_for_being_elsewhere(
    depth_distortion: float, explained: float, cost: float, *, doubtful: bool
) -> None:
    seen, boxes = seen_from_above(TABLE)
    room = RoomEstimate(replace(seen, depth_distortion=depth_distortion), (), boxes, 0.0)
    room.add_fit(0, replace(fit_of(TABLE, explained), cost=cost))
    assert room.is_doubtful(0) is doubtful


@pytest.mark.parametrize("carries", [False, True])
def test_what_nobody_has_named_is_no_table_of_a_size_that_none_has_unless_something_stands_on_it(
    *, carries: bool
) -> None:
    seen, boxes = seen_from_above(TABLE)
    giant = replace(TABLE, x_m=5.0, y_m=1.5, size_m=(0.6, 2.9, 1.3))
    carton = PoseHypothesis(LIBRARY["carton"], 5.0, 1.5, 0.0, 1.3 if carries else 0.0, (0.1, 0.06, 0.14))
    room = RoomEstimate(seen, (), boxes, 0.0)
    room.add_fit(0, fit_of(carton))
    for guess in (TABLE, giant):
        room.detections.append(replace(boxes[0], source=STOOD_OUT))
        room.add_fit(len(room.detections) - 1, fit_of(guess))
    room.drop_contained_fits()
    assert list(room.fits) == ([0, 1, 2] if carries else [0, 1])


@pytest.mark.slow
def test_by_sight_a_table_without_a_box_is_found_under_what_stands_on_it() -> None:
    carton = PoseHypothesis(LIBRARY["carton"], 2.0, 0.0, 0.4, 0.7, (0.1, 0.06, 0.14))
    can = PoseHypothesis(LIBRARY["can"], 2.3, 0.25, 0.0, 0.7, (0.07, 0.07, 0.1))
    seen, (_, *boxes) = monocular(TABLE, carton, can)
    room = reconstruct(seen, boxes, (), find_more=True)
    made = {thing.detection.label: thing for thing in room.things}
    assert set(made) == {"", "box", "can"} and made[""].detection.source == OF_ONE_HUE
    assert made[""].fit.guess.entry.category in ("table", "desk") and apart_m(made[""].fit.guess, TABLE) < 0.05
    assert apart_m(made["box"].fit.guess, carton) < 0.05 and apart_m(made["can"].fit.guess, can) < 0.05


def test_what_is_of_one_hue_ends_where_it_does_and_greys_are_everywhere() -> None:
    rgb = np.full((60, 80, 3), 150, dtype=np.uint8)
    rgb[20:50, 10:60] = (160, 110, 70)
    rgb[50:55, 10:60] = (96, 66, 42)
    rgb[25:35, 30:36] = (200, 30, 30)
    piece = of_one_hue(rgb, (30.0, 25.0, 36.0, 35.0))
    assert piece is not None and piece[20:55, 10:60].all() and piece.sum() == 35 * 50
    assert of_one_hue(rgb, (65.0, 5.0, 70.0, 12.0)) is None


def test_without_depth_a_box_on_the_floor_tells_how_high_a_thing_may_be() -> None:
    seen, (box,) = monocular(CABINET)
    models = {entry.model for entry in high_enough(seen, box.box_px, [0.0])}
    assert {"cabinet_two_doors", "counter_plain", "table_four_legs"} <= models
    assert not {"mug", "red_apple", "carton"} & models
    cut = replace(box, box_px=(box.box_px[0], 0.0, box.box_px[2], box.box_px[3]))
    assert "wardrobe_two_doors" in {entry.model for entry in high_enough(seen, cut.box_px, [0.0])}
