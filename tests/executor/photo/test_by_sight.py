"""Without depth: where a search begins, how far off a thing is whose foot is hidden, and what stands on nothing."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from executor.assets.library import LIBRARY
from executor.geometry import Array
from executor.photo.fitting.evidence import PixelEvidence
from executor.photo.fitting.fit import cost_among, refine_full_resolution
from executor.photo.fitting.hypothesis import PoseHypothesis, raycaster_of
from executor.photo.fitting.likelihood import Fit, Neighbourhood, in_rows, prior_cost
from executor.photo.fitting.starts import outline_starts
from executor.photo.geometry.observation import Observation
from executor.photo.inputs.annotations import Detection
from executor.photo.room.estimate import RoomEstimate, tops_of
from executor.photo.room.fitter import RoomFitter
from executor.photo.room.reconstruct import reconstruct
from tests.executor.photo.test_fit import SIZE, TABLE, seen_from_above

FRIDGE = PoseHypothesis(LIBRARY["fridge_one_door"], 2.4, -0.7, 0.2, 0.0, (0.7, 0.62, 1.3))


def monocular(*things: PoseHypothesis) -> tuple[Observation, list[Detection]]:
    """Return what a camera sees of some things, without its depths."""
    seen, boxes = seen_from_above(*things)
    return replace(seen, z_m=np.zeros_like(seen.z_m), heading_rad=things[0].yaw_rad), boxes


def nearest_m(thing: PoseHypothesis, seen: Observation, box: Detection) -> float:
    """Return how far the nearest start for a thing is from its middle."""
    begun = outline_starts(seen, box.box_px, [thing.entry], 0.0, [thing.yaw_rad])
    return min(math.dist((one.x_m, one.y_m), (thing.x_m, thing.y_m)) for one in begun)


@pytest.mark.parametrize("y_m", [-0.9, 0.0, 0.9])
def test_a_tall_thing_is_looked_for_behind_the_middle_of_its_box(y_m: float) -> None:
    thing = replace(FRIDGE, y_m=y_m)
    seen, (box,) = monocular(thing)
    assert nearest_m(thing, seen, box) < 0.1


@pytest.mark.parametrize(("x_m", "y_m"), [(0.8, 0.1), (1.9, 1.15), (1.9, -1.15)])
def test_what_a_border_cuts_is_looked_for_beyond_it(x_m: float, y_m: float) -> None:
    thing = replace(TABLE, x_m=x_m, y_m=y_m)
    seen, (box,) = monocular(thing)
    x0, _, x1, y1 = box.box_px
    assert x0 < 1.0 or x1 > SIZE[0] - 1.0 or y1 > SIZE[1] - 1.0
    assert nearest_m(thing, seen, box) < 0.16


def test_furniture_is_looked_for_as_smaller_than_usual_too() -> None:
    thing = PoseHypothesis(LIBRARY["table_round"], 0.9, 0.1, 0.0, 0.0, (0.6, 0.6, 0.5))
    seen, (box,) = monocular(thing)
    begun = outline_starts(seen, box.box_px, [thing.entry], 0.0)
    near = (one for one in begun if math.dist((one.x_m, one.y_m), (thing.x_m, thing.y_m)) < 0.1)
    assert any(one.size_m == pytest.approx(thing.size_m, abs=0.1) for one in near)


@pytest.mark.slow
def test_what_looks_otherwise_without_depth_is_fitted_again() -> None:
    seen, boxes = monocular(TABLE)
    room = RoomEstimate(lit(seen, TABLE), (), boxes, 0.0)
    fitter = RoomFitter(room)
    room.add_fit(0, Fit(replace(TABLE, x_m=3.0), 90.0, (), 1.0, 0.0, 100, None, outline_misfit=30.0))
    assert fitter.is_unlikely(0)
    fitter.fit_again(0, ())
    assert math.dist((room.fits[0].guess.x_m, room.fits[0].guess.y_m), (TABLE.x_m, TABLE.y_m)) < 0.05
    assert not fitter.is_unlikely(0)


@pytest.mark.parametrize(("bottom_m", "doubtful"), [(0.0, True), (0.8, False)])
def test_a_microwave_on_the_floor_may_be_called_wrongly(bottom_m: float, *, doubtful: bool) -> None:
    microwave = PoseHypothesis(LIBRARY["microwave_side_hinge"], 2.4, 0.0, 0.0, bottom_m, (0.4, 0.48, 0.3))
    seen, boxes = monocular(microwave)
    room = RoomEstimate(seen, (), boxes, 0.0)
    room.add_fit(0, Fit(microwave, -80.0, (), 1.0, 0.0, 100, None, outline_misfit=40.0))
    assert room.is_doubtful(0) is doubtful


@pytest.mark.slow
def test_what_was_moved_by_what_is_gone_since_is_shaken_back() -> None:
    seen, boxes = monocular(FRIDGE)
    room = RoomEstimate(lit(seen, FRIDGE), (), boxes, 0.0)
    fitter = RoomFitter(room)
    room.add_fit(0, Fit(FRIDGE, 0.0, (), 1.0, 0.0, 100, None))
    fitter.fit(0, [0.0], ())
    far = replace(FRIDGE, x_m=1.5 * FRIDGE.x_m, y_m=1.5 * FRIDGE.y_m, yaw_rad=1.0)
    room.add_fit(0, Fit(far, 0.0, (), 1.0, 0.0, 100, None))
    fitter.perturb(0)
    assert math.dist((room.fits[0].guess.x_m, room.fits[0].guess.y_m), (FRIDGE.x_m, FRIDGE.y_m)) < 0.05


@pytest.mark.slow
def test_what_hides_its_foot_is_as_far_off_as_its_edges_tell() -> None:
    before = replace(TABLE, x_m=1.6, y_m=-0.5)
    seen, boxes = monocular(FRIDGE, before)
    room = RoomEstimate(seen, (), boxes, 0.0)
    room.add_fit(1, Fit(before, 0.0, (), 1.0, 0.0, 100, None))
    (length, width, height), share = FRIDGE.size_m, 1.06
    size = (share * length, share * width, 1.5 - share * (1.5 - height))
    farther = replace(FRIDGE, x_m=share * FRIDGE.x_m, y_m=share * FRIDGE.y_m, size_m=size)
    found = refine_full_resolution(room.around(0), boxes[0].box_px, Fit(farther, 0.0, (), 1.0, 0.0, 100, None))
    assert math.dist((found.guess.x_m, found.guess.y_m), (FRIDGE.x_m, FRIDGE.y_m)) < 0.03


def outline_cost(thing: PoseHypothesis, seen: Observation, box: Detection) -> float:
    """Return what the outline of a thing costs beside its box."""
    nothing = np.full(seen.z_m.shape, np.inf), np.zeros(seen.z_m.shape, dtype=np.int32)
    return PixelEvidence.around(seen, box.box_px, *nothing, 500).box_cost(thing)


@pytest.mark.parametrize("x_m", [0.75, 2.0])
def test_a_round_thing_fills_its_box_even_where_the_border_cuts_it(x_m: float) -> None:
    round_table = PoseHypothesis(LIBRARY["table_round"], x_m, 0.2, 0.0, 0.0, (0.8, 0.8, 0.65))
    seen, (box,) = monocular(round_table)
    assert (box.box_px[3] == SIZE[1]) is (x_m < 1.0)
    assert outline_cost(round_table, seen, box) < 0.5
    assert outline_cost(replace(round_table, size_m=(0.95, 0.95, 0.65)), seen, box) > 2.0


def test_what_is_nowhere_in_the_picture_has_its_own_bounds() -> None:
    seen, _ = monocular(TABLE)
    beside = replace(TABLE, y_m=30.0)
    low, high = seen.bounds_px(beside.corners_m())
    assert high[0] < 0.0 and (low < high).all()
    assert np.isnan(seen.bounds_px(replace(TABLE, x_m=-2.0).corners_m())).any()


def lit(seen: Observation, thing: PoseHypothesis) -> Observation:
    """Return the picture of a thing with each of its faces in a light of its own."""
    body, rays = raycaster_of(thing), seen.rays.reshape(-1, 3)
    assert body is not None
    depth, face = body.render_depth(thing, seen.eye_m, rays, np.zeros(len(rays), dtype=np.int32))
    light = np.where(np.isfinite(depth), 0.6 + 0.4 * np.cos(face) ** 2, 1.0).reshape(seen.z_m.shape)
    return replace(seen, rgb=(seen.rgb * light[..., None]).astype(np.uint8))


@pytest.mark.slow
@pytest.mark.parametrize("thickness_m", [0.02, 0.044])
def test_how_thick_a_top_is_makes_it_neither_higher_nor_wider(thickness_m: float) -> None:
    bare = PoseHypothesis(LIBRARY["table_round"], 2.0, 0.1, 0.0, 0.0, (0.8, 0.8, 0.65))
    true = bare.with_parameters(top_thickness_m=thickness_m)
    seen, boxes = monocular(true)
    room = RoomEstimate(lit(seen, true), (), boxes, 0.0)
    begun = Fit(replace(bare, size_m=(0.81, 0.81, 0.645)), 0.0, (), 1.0, 0.0, 100, None)
    found = refine_full_resolution(room.around(0), boxes[0].box_px, begun).guess
    assert abs(found.size_m[2] - 0.65) < 0.003 and abs(found.size_m[1] - 0.8) < 0.01
    assert abs(float(str(dict(found.parameters)["top_thickness_m"])) - thickness_m) < 0.006


def test_without_walls_what_faces_one_way_stands_against_one() -> None:
    cabinet = PoseHypothesis(LIBRARY["cabinet_drawers"], 3.0, 0.0, 0.0, 0.0, (0.62, 0.6, 0.85))
    beside = Neighbourhood((), (cabinet,), without_depth=True)
    counter = PoseHypothesis(LIBRARY["counter_plain"], 3.0, 0.75, 0.0, 0.0, (0.62, 0.9, 0.85))
    in_row = prior_cost(counter, beside)
    assert in_row < 0.5
    assert prior_cost(replace(counter, x_m=3.5), beside) > in_row + 4.0
    assert prior_cost(replace(counter, size_m=(0.62, 0.9, 0.78)), beside) > in_row + 20.0
    assert prior_cost(replace(counter, yaw_rad=math.pi), beside) == pytest.approx(in_row), "it has no front"
    turned = replace(cabinet, y_m=0.6, yaw_rad=math.pi)
    assert prior_cost(turned, beside) > prior_cost(replace(turned, yaw_rad=0.0), beside) + 4.0, "its back is to us"
    measured = Neighbourhood((), (cabinet,))
    behind, aside = turned, replace(turned, yaw_rad=math.pi / 2 + 0.3)
    unseen_front, half_seen = (prior_cost(one, beside) - prior_cost(one, measured) for one in (behind, aside))
    assert unseen_front > half_seen + 10.0, "what is seen from straight behind is rather something else"
    assert prior_cost(replace(counter, size_m=(0.62, 0.9, 0.78)), measured) < 0.5, "what is measured may be otherwise"
    lower = replace(counter, x_m=3.4, size_m=(0.55, 0.9, 0.78))
    (aligned,) = in_rows(lower, (cabinet,))
    assert prior_cost(aligned, beside) < 0.5 and aligned.size_m == (0.62, 0.9, 0.85)
    assert not list(in_rows(counter, (cabinet,))) and not list(in_rows(TABLE, (cabinet,)))


@pytest.mark.slow
def test_what_has_legs_is_found_though_it_is_called_otherwise() -> None:
    chair = PoseHypothesis(LIBRARY["chair_wooden"], 1.9, 0.0, 0.3, 0.0, (0.42, 0.41, 0.88))
    seen, (box,) = monocular(chair)
    room = RoomEstimate(seen, (), [replace(box, label="can", category="can", provenance="detector")], 0.0)
    fitter = RoomFitter(room)
    fitter.fit(0, None, ())
    assert fitter.fit_anything(0) == "can: chair_wooden"


@pytest.mark.slow
def test_what_nothing_was_found_under_is_no_giant_on_the_floor() -> None:
    orange = PoseHypothesis(LIBRARY["orange"], 2.05, -0.05, 0.0, 0.7, (0.08, 0.08, 0.08))
    seen, (table, box) = monocular(TABLE, orange)
    without = RoomFitter(RoomEstimate(seen, (), [box], 0.0))
    assert without.fit(0, None, ()) == "orange: nothing was found that it stands on" and without.on_nothing == {0}
    room = RoomEstimate(seen, (), [table, box], 0.0)
    fitter = RoomFitter(room)
    fitter.fit(0, [0.0], ())
    assert fitter.fit(1, None, ()) == "orange: orange" and not room.is_in_air(1)
    higher = replace(TABLE, size_m=(1.0, 0.6, 0.71))
    room.fits[0] = replace(room.fits[0], guess=higher)
    assert room.is_in_air(1), "what is moved so little moves what stands on it, by sight"


@pytest.mark.parametrize(
    ("outline_misfit", "cost", "nothing"), [(1.0, 20.0, False), (9.0, 20.0, True), (1.0, 80.0, True)]
)
def test_what_hardly_looks_so_on_the_floor_stands_on_nothing(
    outline_misfit: float, cost: float, *, nothing: bool
) -> None:
    seen, boxes = monocular(TABLE)
    room = RoomEstimate(seen, (), boxes, 0.0)
    mug = PoseHypothesis(LIBRARY["mug"], 2.0, 0.0, 0.0, 0.0, (0.11, 0.08, 0.09))
    found = Fit(mug, cost, (), 1.0, 0.0, 100, None, outline_misfit=outline_misfit)
    assert room.is_on_nothing(found) is nothing
    assert not room.is_on_nothing(replace(found, guess=replace(mug, bottom_m=0.7)))
    assert room.is_on_nothing(replace(found, guess=replace(mug, size_m=(0.19, 0.14, 0.16))))


@pytest.mark.slow
def test_where_depths_are_bent_the_picture_tells_how_far_off_a_thing_is() -> None:
    seen, boxes = seen_from_above(TABLE, finer=2)
    bent = replace(seen, z_m=1.02 * seen.z_m, depth_distortion=0.02, heading_rad=TABLE.yaw_rad)
    (table,) = reconstruct(bent, boxes, ()).things
    guess = table.fit.guess
    assert guess.entry.model == "table_four_legs"
    # By its depths it is 4.4 cm farther off.
    assert math.dist((guess.x_m, guess.y_m), (TABLE.x_m, TABLE.y_m)) < 0.015


COUNTER = PoseHypothesis(LIBRARY["counter_plain"], 3.2, -0.3, 0.0, 0.0, (0.62, 0.9, 0.76))
MICROWAVE = PoseHypothesis(LIBRARY["microwave_side_hinge"], 3.2, -0.3, 0.0, 0.76, (0.45, 0.5, 0.3))


@pytest.mark.slow
def test_nothing_smaller_that_hangs_before_it_is_another_name_for_a_thing() -> None:
    nearer = PoseHypothesis(LIBRARY["table_four_legs"], 1.3, 0.36, 0.0, 0.0, (0.9, 0.6, 0.66))
    seen, (box, beside) = monocular(COUNTER, nearer)
    called = replace(box, label="refrigerator", category="refrigerator", provenance="detector")
    room = RoomEstimate(lit(lit(seen, COUNTER), nearer), (), [called, beside], 0.0)
    room.add_fit(1, Fit(nearer, -100.0, (), 1.0, 0.0, 100, None))
    fitter = RoomFitter(room)
    assert fitter.fit_anything(0, entries=[COUNTER.entry, MICROWAVE.entry]) == "refrigerator: counter_plain"
    assert not room.fits[0].alternatives


@pytest.mark.slow
def test_what_was_put_on_nothing_does_not_hide_what_it_stands_on() -> None:
    seen, (box, above) = monocular(COUNTER, MICROWAVE)
    called = replace(box, label="refrigerator", category="refrigerator", provenance="detector")
    room = RoomEstimate(lit(lit(seen, COUNTER), MICROWAVE), (), [called, above], 0.0)
    hanging = replace(MICROWAVE, x_m=2.3, y_m=-0.215, bottom_m=0.48)
    room.add_fit(1, Fit(hanging, -100.0, (), 1.0, 0.0, 100, None))
    assert room.on_nothing_but(0) == [1]
    RoomFitter(room).fit_anything(0, entries=[COUNTER.entry])
    found = room.fits[0].guess
    assert math.dist((found.x_m, found.y_m), (COUNTER.x_m, COUNTER.y_m)) < 0.05
    assert room.fits[1].guess is hanging, "and is kept"
    room.fits[1] = replace(
        room.fits[1], guess=replace(MICROWAVE, bottom_m=max(top.height_m for top in tops_of([room.fits[0]])))
    )
    assert room.on_nothing_but(0) == [1] and room.on_nothing_but(1) == []


@pytest.mark.slow
def test_a_low_shelf_is_looked_for_as_low_as_it_is_and_as_wide_as_others() -> None:
    low = PoseHypothesis(LIBRARY["shelf_open"], 3.0, 0.6, math.pi / 2, 0.0, (0.33, 0.9, 0.63), (("boards", 1),))
    seen, boxes = monocular(low)
    room = RoomEstimate(lit(seen, low), (), boxes, 0.0)
    RoomFitter(room).fit(0, [0.0], ())
    found = room.fits[0].guess
    assert found.size_m[2] == pytest.approx(0.63, abs=0.02)
    assert math.dist((found.x_m, found.y_m), (low.x_m, low.y_m)) < 0.05


def test_a_microwave_on_what_nobody_has_boxed_is_as_high_as_on_the_units_beside() -> None:
    seen, (box,) = monocular(MICROWAVE)
    unit = PoseHypothesis(LIBRARY["cabinet_two_doors"], 3.2, 1.4, 0.0, 0.0, (0.62, 0.9, 0.8))
    room = RoomEstimate(seen, (), [box], 0.0)
    room.fits[1] = Fit(unit, 0.0, (), 1.0, 0.0, 100, None)
    (height_m,) = room.heights_m(box, None)
    assert height_m == pytest.approx(0.8, abs=0.01), "and no shelf in it"
    assert room.heights_m(replace(box, category="mug"), None) == [0.0]


def test_what_is_half_in_shadow_is_of_one_colour_and_what_is_half_of_another_hue_is_not() -> None:
    seen, (box,) = monocular(COUNTER)
    seen = lit(seen, COUNTER)
    x0, y0, x1, y1 = map(int, box.box_px)
    rows = slice(y0 + 2 * (y1 - y0) // 3, y1)

    def cost(part: Array) -> float:
        rgb = seen.rgb.copy()
        rgb[rows, x0:x1] = part
        room = RoomEstimate(replace(seen, rgb=rgb), (), [box], 0.0)
        return cost_among(room.around(0), box.box_px, Fit(COUNTER, 0.0, (), 1.0, 0.0, 100, None))

    whole = seen.rgb[rows, x0:x1]
    plain, shaded, other = cost(whole), cost((0.6 * whole).astype(np.uint8)), cost(whole[..., ::-1])
    assert shaded - plain < 0.3 * (other - plain)
