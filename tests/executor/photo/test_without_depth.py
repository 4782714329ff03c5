"""Without depth, boxes, names and the camera's pose tell what stands on what, and every outline fills its box."""

from __future__ import annotations

import math
import warnings
from dataclasses import replace

import numpy as np
import pytest

from executor.assets.families.generic import GENERIC
from executor.assets.library import LIBRARY, asset_for
from executor.photo.fitting.hypothesis import PoseHypothesis
from executor.photo.inputs.annotations import FLOOR, WALL
from executor.photo.overlaps import resolve_overlaps
from executor.photo.room import beneath
from executor.photo.room.beneath import supports_of
from executor.photo.room.jointly import Jointly
from executor.photo.room.pieces import Piece, shapes_of
from executor.photo.room.reconstruct import FittedRoom, reconstruct
from executor.photo.scene import scene_of
from oag.model.symbols import Kind
from tests.executor.photo.test_fit import BOWL, TABLE, seen_from_above
from tests.executor.photo.test_hanging import flat, named

BOX = GENERIC["generic_box"]
MUG = PoseHypothesis(LIBRARY["cup"], 2.25, 0.3, 0.0, 0.7, (0.07, 0.07, 0.09))
CARTON = PoseHypothesis(BOX, 1.3, 0.5, 0.0, 0.0, (0.3, 0.3, 0.25))


def on_of(*things: tuple[PoseHypothesis, str]) -> list[int]:
    """Return what carries each of some things under other names, seen without depth."""
    seen, boxes = seen_from_above(*(thing for thing, _ in things))
    renamed = [box if not label else named(label, box) for box, (_, label) in zip(boxes, things, strict=True)]
    return supports_of(flat(seen), renamed)


def test_what_ends_on_a_top_is_on_it_and_what_ends_before_it_is_on_the_floor() -> None:
    assert on_of((TABLE, ""), (BOWL, ""), (MUG, ""), (CARTON, "box")) == [FLOOR, 0, 0, FLOOR]


def test_what_is_seen_below_a_top_is_on_the_floor() -> None:
    below = PoseHypothesis(BOX, 2.1, 0.1, 0.3, 0.0, (0.3, 0.5, 0.16))
    assert on_of((TABLE, ""), (below, "pillow"))[1] == FLOOR
    assert on_of((TABLE, ""), (replace(below, bottom_m=0.7), "pillow"))[1] == 0


@pytest.mark.parametrize(("label", "on"), [("tray", 1), ("keyboard", 0)])
def test_what_ends_on_an_item_is_on_it_where_things_usually_are(label: str, on: int) -> None:
    board = PoseHypothesis(BOX, 2.05, 0.1, 0.3, 0.7, (0.3, 0.4, 0.03))
    cup = replace(MUG, x_m=2.05, y_m=0.1, bottom_m=0.73)
    assert on_of((TABLE, ""), (board, label), (cup, ""))[2] == on


@pytest.mark.parametrize(
    ("label", "bottom_m", "on"), [("shelf", 1.2, WALL), ("shelf", 0.0, FLOOR), ("chair", 0.0, FLOOR)]
)
def test_a_shelf_that_would_be_far_too_large_on_the_floor_hangs(label: str, bottom_m: float, on: int) -> None:
    piece = PoseHypothesis(LIBRARY["shelf_open"], 3.2, 0.0, 0.0, bottom_m, (0.3, 0.8, 0.8))
    seen, (box,) = seen_from_above(piece)
    assert supports_of(flat(seen), [replace(box, label=label, category=label)]) == [on]


def test_a_person_decides_what_a_thing_stands_on() -> None:
    seen, boxes = seen_from_above(TABLE, BOWL)
    assert supports_of(flat(seen), [boxes[0], replace(boxes[1], on=FLOOR)]) == [FLOOR, FLOOR]


@pytest.fixture(scope="module")
def room() -> FittedRoom:
    """A table with a bowl and a mug, and a box before it."""
    seen, (table, bowl, mug, carton) = seen_from_above(TABLE, BOWL, MUG, CARTON)
    return reconstruct(flat(seen), [table, bowl, mug, named("box", carton)], ())


def test_every_outline_fills_its_box_and_sizes_of_kinds_give_the_height(room: FittedRoom) -> None:
    table, bowl, mug, carton = (thing.fit for thing in room.things)
    assert min(one.in_box for one in (table, bowl, mug, carton)) > 0.75
    assert table.guess.size_m[2] == pytest.approx(0.7, abs=0.1)
    assert bowl.guess.bottom_m == mug.guess.bottom_m == pytest.approx(table.guess.size_m[2], abs=0.01)
    assert (mug.guess.x_m, mug.guess.y_m) == pytest.approx((MUG.x_m, MUG.y_m), abs=0.25)
    assert carton.guess.bottom_m == 0.0


def test_they_make_a_scene_in_which_nothing_is_moved_far(room: FittedRoom) -> None:
    found, made = scene_of(room, "drawn")
    assert made.refused == "" and made.scene is not None
    assert {"(ontop bowl_0 table_0)", "(ontop cup_0 table_0)"} <= {str(fact) for fact in made.scene.facts}
    for key, guess in found.guesses.items():
        assert math.dist(made.scene.objects[key].position[:2], (guess.x_m, guess.y_m)) < 0.03


def test_nothing_hides_what_is_seen_in_its_box() -> None:
    far = PoseHypothesis(replace(BOX, category="sofa"), 3.2, 0.0, 0.0, 0.0, (0.9, 2.6, 0.8))
    near = PoseHypothesis(BOX, 1.8, 0.1, 0.0, 0.0, (0.3, 0.3, 0.3))
    seen, (sofa, box) = seen_from_above(far, near)
    found = reconstruct(flat(seen), [sofa, named("box", box)], ())
    assert [thing.fit.in_box > 0.6 for thing in found.things] == [True, True]
    assert found.things[1].fit.guess.x_m < found.things[0].fit.guess.x_m


def test_a_lower_end_that_furniture_hides_may_be_lower() -> None:
    chair = PoseHypothesis(LIBRARY["chair_wooden"], 3.0, 0.1, 0.0, 0.0, (0.43, 0.43, 0.86))
    seen, boxes = seen_from_above(TABLE, chair)
    x0, y0, x1, _ = boxes[1].box_px
    cut = replace(boxes[1], box_px=(x0, y0, x1, boxes[0].box_px[1] + 8.0))
    behind, alone = (reconstruct(flat(seen), some, ()).things[-1].fit.guess for some in ([boxes[0], cut], [cut]))
    # Alone it ends where its box does: far off, or low.
    ends = [math.hypot(one.x_m, one.y_m) / one.size_m[2] for one in (behind, alone)]
    assert ends[0] < ends[1] - 0.1


def test_a_pose_goes_to_where_its_outline_fills_its_box() -> None:
    seen, (box,) = seen_from_above(CARTON)
    thing = named("box", box)
    problem = Jointly(flat(seen), [Piece(thing, BOX, FLOOR)])
    problem.put(0, replace(CARTON, y_m=0.3))
    assert problem.pose(0).size_m == pytest.approx(CARTON.size_m)
    problem.solve([0], 12)
    assert problem.pose(0).y_m == pytest.approx(CARTON.y_m, abs=0.03)


def test_a_step_far_off_is_no_overflow() -> None:
    seen, boxes = seen_from_above(TABLE, BOWL)
    table, bowl = (Piece(box, thing.entry, on) for box, thing, on in zip(boxes, (TABLE, BOWL), (FLOOR, 0), strict=True))
    problem = Jointly(flat(seen), [table, bowl])
    for index, guess in enumerate((TABLE, BOWL)):
        problem.put(index, guess)
    problem.X[0, 3:] = 800.0
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert np.isfinite(problem.spread_m(1)).all()
        assert max(problem.pose(0).size_m) < 25.0


def test_what_the_border_cuts_has_a_less_certain_place() -> None:
    spreads_m = []
    for x_m in (1.8, 1.3):
        seen, (box,) = seen_from_above(replace(CARTON, x_m=x_m))
        problem = Jointly(flat(seen), [Piece(named("box", box), BOX, FLOOR)])
        problem.put(0, replace(CARTON, x_m=x_m))
        spreads_m.append(problem.spread_m(0))
    (whole_m, whole_side_m), (cut_m, cut_side_m) = spreads_m
    assert 0.005 < whole_m < 0.5 * cut_m < 0.3 and 0.005 < whole_side_m < 0.8 * cut_side_m < 0.3


@pytest.mark.parametrize(
    ("label", "size_m", "model"),
    [
        ("laptop", (0.3, 0.33, 0.2), "generic_slab_with_back"),
        ("laptop", (0.22, 0.33, 0.02), "generic_box"),
        ("magazine", (0.3, 0.33, 0.2), "generic_box"),
        ("mixing bowl", (0.2, 0.2, 0.1), "generic_open_box"),
    ],
)
def test_a_box_alone_tells_whether_a_laptop_is_open_and_a_name_that_a_bowl_is(
    label: str, size_m: tuple[float, float, float], model: str
) -> None:
    seen, (_, box) = seen_from_above(TABLE, replace(CARTON, x_m=2.0, y_m=0.0, bottom_m=0.7, size_m=size_m))
    assert shapes_of(flat(seen), named(label, box))[0].model == model


def test_below_the_panel_of_a_monitor_other_things_have_their_place() -> None:
    seen, (box,) = seen_from_above(replace(CARTON, x_m=2.0))
    entry = shapes_of(flat(seen), named("monitor", box))[0]
    monitor = PoseHypothesis(entry, 2.0, 0.0, 0.0, 0.7, (0.18, 0.55, 0.45))
    asset = asset_for(monitor.as_object())
    assert asset.motion == "dynamic" and monitor.as_object().kind is Kind.ITEM
    strip = PoseHypothesis(BOX, 2.0, 0.2, 0.0, 0.7, (0.05, 0.08, 0.04))
    table = replace(TABLE, x_m=2.0)
    kept, _ = resolve_overlaps({"table": table, "monitor": monitor, "strip": strip}, ())
    assert (kept["strip"].x_m, kept["strip"].y_m) == pytest.approx((2.0, 0.2))
    neck, _ = resolve_overlaps({"table": table, "monitor": monitor, "strip": replace(strip, y_m=0.0)}, ())
    assert not np.allclose((neck["strip"].x_m, neck["strip"].y_m), (2.0, 0.0))


def test_a_toy_in_an_open_box_is_in_it_and_keeps_its_size() -> None:
    crate = PoseHypothesis(GENERIC["generic_open_box"], 1.4, 0.0, 0.0, 0.0, (0.5, 0.5, 0.2))
    toy = PoseHypothesis(BOX, 1.5, 0.05, 0.0, 0.01, (0.10, 0.07, 0.12))
    seen, (outer, inner) = seen_from_above(crate, toy)
    things = reconstruct(flat(seen), [named("cardboard box", outer), named("toy", inner)], ()).things
    assert things[1].fit.in_box > 0.6 and min(things[1].fit.guess.size_m) > 0.02


def test_a_fruit_whose_box_ends_within_a_bowls_is_in_it_and_one_of_a_cycle_is_below() -> None:
    seen, (table, bowl) = seen_from_above(TABLE, BOWL)
    x0, y0, x1, y1 = bowl.box_px
    middle, third = (x0 + x1) / 2, (x1 - x0) / 6
    fruit = replace(bowl, box_px=(middle - third, y0, middle + third, (y0 + 2 * y1) / 3))
    assert supports_of(flat(seen), [table, bowl, named("fruit", fruit)]) == [FLOOR, 0, 1]


def test_on_what_seems_to_be_on_each_other_the_larger_is_below_and_the_rest_stays(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    seen, (table,) = seen_from_above(TABLE)
    small = replace(table, box_px=(0.0, 0.0, 9.0, 9.0))
    for given, expected in (([1, 2, 1], [1, 2, FLOOR]), ([1, 0, 1], [FLOOR, 0, 1])):
        monkeypatch.setattr(beneath, "support_of", lambda _view, _things, index, given=given: given[index])
        sizes = [table, small, replace(table, box_px=(0.0, 0.0, 30.0, 30.0))]
        assert supports_of(flat(seen), sizes) == expected


def test_a_size_that_a_person_gave_is_kept() -> None:
    seen, (table,) = seen_from_above(TABLE)
    (thing,) = reconstruct(flat(seen), [replace(table, size_m=(0.8, 0.8, 0.9))], ()).things
    assert thing.fit.guess.size_m == (0.8, 0.8, 0.9)


def test_furniture_of_which_no_depth_is_measured_is_fitted_to_its_box() -> None:
    seen, (table,) = seen_from_above(TABLE)
    x0, y0, x1, y1 = (round(side) for side in table.box_px)
    z_m = seen.z_m.copy()
    z_m[max(0, y0 - 30) : y1 + 30, max(0, x0 - 30) : x1 + 30] = 0.0
    (thing,) = reconstruct(replace(seen, z_m=z_m), [table], ()).things
    assert thing.fit.in_box > 0.6
