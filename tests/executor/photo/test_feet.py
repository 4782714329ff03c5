"""What things on furniture tell of a top that they hide, and where a box says that its thing stands."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from executor.assets.families.generic import GENERIC, SHELF
from executor.assets.library import LIBRARY
from executor.photo.fitting.hypothesis import PoseHypothesis
from executor.photo.fitting.likelihood import FOOT_USUAL, Fit, feet_cost
from executor.photo.inputs.annotations import FLOOR, Detection
from executor.photo.overlaps import resolve_overlaps
from executor.photo.room.estimate import RoomEstimate, heights_under, tops_of
from executor.photo.room.feet import apparent_supports, feet_on_boards, feet_on_furniture
from executor.photo.room.reconstruct import reconstruct
from tests.executor.photo.test_fit import seen_from_above

BOX = GENERIC["generic_box"]
DESK = PoseHypothesis(LIBRARY["desk_four_legs"], 2.0, 0.0, 0.0, 0.0, (0.6, 1.2, 0.72))
CRATES = tuple(
    PoseHypothesis(replace(BOX, category="crate"), 2.0, side, 0.0, 0.72, (0.58, 0.38, 0.25))
    for side in (-0.4, 0.0, 0.4)
)


def fit_of(guess: PoseHypothesis) -> Fit:
    """Return a certain fit."""
    return Fit(guess, 0.0, (), 1.0, 0.0, 100, None, (0.0, 0.0))


def test_what_hides_a_top_tells_its_height_and_how_far_it_reaches() -> None:
    seen, things = seen_from_above(DESK, *CRATES)
    feet = feet_on_furniture(seen, things, [FLOOR, 0, 0, 0])[0]
    assert feet.shape == (3, 3) and feet[:, 2] == pytest.approx(0.72, abs=0.03)
    assert feet_cost(DESK, feet) < FOOT_USUAL * 3
    for wrong in (
        replace(DESK, size_m=(0.6, 1.2, 0.65)),
        replace(DESK, size_m=(0.6, 0.5, 0.72)),
        replace(DESK, x_m=2.4),
    ):
        assert feet_cost(wrong, feet) > FOOT_USUAL * 3
    # What has no top carries nothing, though it is as large.
    open_box = replace(DESK, entry=replace(GENERIC["generic_open_box"], category="desk"))
    assert feet_cost(open_box, feet) > FOOT_USUAL * 3
    # What has boards has many tops.
    shelf = PoseHypothesis(LIBRARY["shelf_open"], 2.0, 0.0, 0.0, 0.0, (0.3, 0.8, 1.5))
    assert feet_cost(shelf, feet) == feet_cost(DESK, np.zeros((0, 3))) == 0.0


def test_a_top_that_is_seen_tells_more_than_what_is_on_it_and_so_do_three_things_than_one() -> None:
    cans = tuple(PoseHypothesis(LIBRARY["can"], 1.9, side, 0.0, 0.72, (0.07, 0.07, 0.12)) for side in (-0.4, 0.0, 0.4))
    seen, things = seen_from_above(DESK, *cans)
    assert feet_on_furniture(seen, things, [FLOOR, 0, 0, 0]) == {}
    hidden, boxes = seen_from_above(DESK, *CRATES)
    assert feet_on_furniture(hidden, boxes, [FLOOR, 0, FLOOR, FLOOR]) == {}


def test_what_ends_behind_a_mat_is_on_the_desk_and_what_ends_in_its_box_is_on_the_mat() -> None:
    mat = PoseHypothesis(replace(BOX, category="desk_mat"), 1.9, 0.0, 0.0, 0.72, (0.3, 0.6, 0.02))
    behind = PoseHypothesis(LIBRARY["can"], 2.12, 0.0, 0.0, 0.72, (0.07, 0.07, 0.12))
    on_it = replace(behind, x_m=1.85, bottom_m=0.74)
    seen, things = seen_from_above(DESK, mat, behind, on_it)
    things[1] = replace(things[1], label="desk mat", category="desk_mat")
    room = RoomEstimate(seen, (), things, 0.0)
    assert room.is_on_floor(0) and not room.is_on_floor(1)
    for index, guess in enumerate((DESK, mat)):
        room.add_fit(index, fit_of(guess))
    rng = np.random.default_rng(0)
    near = [rng.normal((1.95, 0.0, 0.745), 0.002, (50, 3)), rng.normal((1.85, 0.0, 0.745), 0.002, (50, 3))]
    heights = [room.heights_m(things[index], points)[0] for index, points in zip((2, 3), near, strict=True)]
    assert heights == pytest.approx([0.72, 0.74], abs=0.003)


def test_what_hangs_over_the_edge_of_a_top_at_its_height_is_on_it() -> None:
    jacket = PoseHypothesis(replace(BOX, category="jacket"), 1.60, 0.0, 0.0, 0.70, (0.02, 0.3, 0.4))
    seen, things = seen_from_above(DESK, jacket)
    room = RoomEstimate(seen, (), things, 0.0, {}, apparent_supports(seen, things))
    room.add_fit(0, fit_of(DESK))
    points = np.random.default_rng(0).uniform((1.55, -0.1, 0.66), (1.6, 0.1, 1.0), (80, 3))
    low_m = float(np.percentile(points[:, 2], 5.0))
    assert heights_under(points, tops_of([DESK])) == pytest.approx([low_m], abs=1e-4)
    assert room.heights_m(things[1], points) == pytest.approx([0.72], abs=0.003)
    # Near misses: it ends far below the top, or its box ends elsewhere.
    low = points - (0.0, 0.0, 0.3)
    assert room.heights_m(things[1], low) == pytest.approx([low_m - 0.3], abs=1e-4)
    elsewhere = RoomEstimate(seen, (), things, 0.0, {}, [FLOOR, FLOOR])
    elsewhere.add_fit(0, fit_of(DESK))
    assert elsewhere.heights_m(things[1], points) == pytest.approx([low_m], abs=1e-4)


THIN = PoseHypothesis(LIBRARY["shelf_open"], 2.2, 0.0, 0.0, 0.0, (0.28, 0.8, 1.2), (("boards", 2),))
ODD = replace(THIN, entry=replace(GENERIC[SHELF], category="shelf"), parameters=()).with_parameters(
    board_0_share=0.25, board_1_share=0.7
)


@pytest.mark.parametrize(("shelf", "model"), [(ODD, SHELF), (THIN, "shelf_open")])
def test_a_shelf_has_boards_where_things_on_it_end_unless_a_model_has_them_there(
    shelf: PoseHypothesis, model: str
) -> None:
    _, *levels_m = sorted({round(top.height_m, 4) for top in tops_of([shelf])})[:3]
    can = PoseHypothesis(LIBRARY["can"], 2.12, 0.0, 0.0, 0.0, (0.066, 0.066, 0.12))
    cans = [replace(can, y_m=y_m, bottom_m=levels_m[row]) for y_m, row in ((-0.2, 0), (0.2, 0), (0.05, 1))]
    seen, (box, *boxes) = seen_from_above(shelf, *cans)
    room = reconstruct(seen, [replace(box, label="bookshelf"), *boxes], ())
    assert room.things[0].fit.guess.entry.model == model
    tops_m = [top.height_m for top in tops_of([room.things[0].fit.guess])]
    assert all(min(abs(top_m - level_m) for top_m in tops_m) < 0.04 for level_m in levels_m)
    settled, _ = resolve_overlaps(room.guesses, (), on=room.on, fills=room.fills)
    ends_m = [settled[thing.id].bottom_m for thing in room.things[1:]]
    assert ends_m == pytest.approx([one.bottom_m for one in cans], abs=0.04)
    # Near misses: a shelf that is on a desk itself, and what has no boards.
    ends_in = [FLOOR, 0, 0, 0]
    assert feet_on_boards(seen, [box, *boxes], ends_in)[0] == pytest.approx(
        {number: one.bottom_m for number, one in enumerate(cans, start=1)}, abs=0.03
    )
    assert feet_on_boards(seen, [box, *boxes], [3, 0, 0, FLOOR]) == {}
    assert feet_on_boards(seen, [replace(box, label="desk", category="desk"), *boxes], ends_in) == {}


def test_a_foot_is_where_a_box_ends() -> None:
    can = PoseHypothesis(LIBRARY["can"], 1.9, 0.2, 0.0, 0.72, (0.07, 0.07, 0.12))
    seen, (_, box) = seen_from_above(DESK, can)
    foot = seen.foot_m(box.box_px)
    assert foot is not None and foot == pytest.approx((1.87, 0.2, 0.72), abs=0.03)
    blind = replace(seen, z_m=np.zeros_like(seen.z_m))
    assert blind.foot_m(Detection("can", "can", box.box_px, 1.0, "me").box_px) is None
