"""Where things are put: on free spots, away from others, and upright whatever the tilt between the fingers."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from executor.assets.footprint import Footprint
from executor.assets.model import Region
from executor.geometry import hand_rotation, inverse, transform
from executor.planning.cargo import Carried
from executor.planning.place_search import LOW_M, fill_options, lowerings_m
from executor.planning.placements import (
    APART_M,
    DEEPEST_M,
    EDGE_M,
    HEAP_M,
    HOLLOW_DRAWS,
    HOLLOW_SHARE,
    SET_COST,
    PlacementSpot,
    spot_rng,
    spots,
    upright_pitch,
)
from oag import Action, Primitive

TABLE = Region("top", "surface", "table", (0.0, 0.0, 0.2), (0.45, 0.25, 0.2), (0.0, 0.0, 1.0))
SHELF = Region("shelf", "interior", "body", (0.0, 0.0, 0.15), (0.25, 0.27, 0.15), (-1.0, 0.0, 0.0))
BOWL = Region("hollow", "interior", "bowl", (0.0, 0.0, 0.02), (0.07, 0.07, 0.02), (0.0, 0.0, 1.0))
WIDTH_M, HEIGHT_M = 0.05, 0.10


@pytest.mark.parametrize("region", [TABLE, SHELF])
def test_spots_keep_off_what_stands_there(region: Region) -> None:
    free = spots(region, np.eye(4), WIDTH_M, np.zeros(3), height_m=HEIGHT_M)
    assert free
    first = free[0].point_m
    centre, half = first + [0.0, 0.0, 0.05], np.array([0.03, 0.03, 0.05])
    others = {"cup_1": Footprint.around(centre, half)}
    left = spots(region, np.eye(4), WIDTH_M, np.zeros(3), height_m=HEIGHT_M, others=others)
    assert left
    for spot in left:
        beyond = np.maximum(np.abs(spot.point_m - centre)[:2] - half[:2], 0.0)
        assert np.hypot(*beyond) >= WIDTH_M / 2 + APART_M
    assert [spot.cost for spot in left] == sorted(spot.cost for spot in left)


def test_what_is_above_or_below_takes_no_room() -> None:
    free = spots(SHELF, np.eye(4), WIDTH_M, np.zeros(3), height_m=HEIGHT_M)
    middles = [spot.point_m + [0.0, 0.0, off_m] for spot in free for off_m in (-0.06, 0.20)]
    others = {f"can_{k}": Footprint.around(middle, np.full(3, 0.05)) for k, middle in enumerate(middles)}
    again = spots(SHELF, np.eye(4), WIDTH_M, np.zeros(3), height_m=HEIGHT_M, others=others)
    assert [tuple(s.point_m) for s in again] == [tuple(s.point_m) for s in free]


def drawn(region: Region, seed: int) -> list[PlacementSpot]:
    """The spots that a seed draws, without those that are always there."""
    found = spots(region, np.eye(4), WIDTH_M, np.zeros(3), rng=spot_rng(seed, "cup_0", "shelf_0", region.name))
    return [spot for spot in found if spot.cost < SET_COST]


@pytest.mark.parametrize("region", [TABLE, SHELF, BOWL])
def test_spots_are_drawn_from_the_seed_and_all_over_what_fits(region: Region) -> None:
    sets = [drawn(region, seed) for seed in range(40)]
    assert all(sets)
    points = np.array([spot.point_m[:2] for some in sets for spot in some])
    least_m = WIDTH_M / 2 + (0.0 if region is BOWL else EDGE_M)
    room_m = np.array(region.half_extents_m[:2]) - least_m
    assert (np.abs(points - np.array(region.center_m[:2])) <= room_m + 1e-9).all()
    # Not on one line: what the first draws leave open is used to a good part.
    firsts = np.array([some[0].point_m[:2] for some in sets])
    # A bowl's floor rises towards its wall, where things would lie aslant.
    used = 0.2 if region is BOWL else 0.4
    assert np.ptp(firsts, axis=0).min() > used * min(2 * room_m.min(), DEEPEST_M)
    assert [tuple(s.point_m) for s in drawn(region, 7)] == [tuple(s.point_m) for s in sets[7]]
    assert tuple(sets[7][0].point_m) != tuple(sets[8][0].point_m)


def test_a_thing_lies_near_the_middle_of_a_hollow() -> None:
    for seed in range(40):
        some = drawn(BOWL, seed)
        assert 1 <= len(some) <= HOLLOW_DRAWS, "each is tried from all around"
        off_m = [float(np.hypot(*(spot.point_m[:2] - BOWL.center_m[:2]))) for spot in some]
        assert max(off_m) <= HOLLOW_SHARE * (BOWL.half_extents_m[0] - WIDTH_M / 2)


@pytest.mark.parametrize("region", [TABLE, SHELF])
def test_what_is_always_there_comes_after_what_was_drawn(region: Region) -> None:
    always = {tuple(spot.point_m) for spot in spots(region, np.eye(4), WIDTH_M, np.zeros(3))}
    found = spots(region, np.eye(4), WIDTH_M, np.zeros(3), rng=spot_rng(3, "cup_0", "shelf_0", region.name))
    places = [tuple(spot.point_m) in always for spot in found]
    assert places == sorted(places)
    assert any(places) and not all(places)


@given(st.floats(0.0, 1.5), st.floats(-0.6, 0.6), st.booleans())
def test_a_thing_that_turned_between_the_fingers_is_set_upright(pitch: float, turned: float, flip: bool) -> None:
    hand = transform(hand_rotation(0.3, pitch, flip=flip), np.zeros(3))
    upright = transform(np.eye(3), [0.0, 0.0, 0.1])
    about_fingers = Rotation.from_rotvec(turned * hand[:3, 1]).as_matrix()
    carried = Carried("thing", inverse(hand) @ transform(about_fingers @ upright[:3, :3], upright[:3, 3]))
    R = hand_rotation(1.0, upright_pitch(carried, flip=flip), flip=flip)
    np.testing.assert_allclose((R @ carried.T_eef_object[:3, :3])[2, 2], 1.0, atol=1e-9)


def test_a_hand_may_come_down_by_all_of_a_drawers_depth() -> None:
    drawer = Region("drawer", "interior", "drawer", (0.0, 0.0, 0.0), (0.25, 0.27, 0.21), (0.0, 0.0, 1.0), "slide")
    usual = lowerings_m([SHELF])
    assert lowerings_m([TABLE, BOWL]) == usual, "a table's top is not within anything, and a bowl is shallow"
    *first, deepest = lowerings_m([SHELF, drawer])
    assert tuple(first) == usual, "less is preferred"
    assert 0.42 < deepest < 0.50
    moves = Action(Primitive.MOVE_BASE_FORWARD, 0.3), Action(Primitive.LIFT_EEF_DOWN)
    assert [down.parameter for _, down in fill_options(moves, lowerings_m([drawer]))] == [*usual, deepest]
    assert lowerings_m([SHELF], 0.20) == usual, "there is room above it"
    assert lowerings_m([SHELF], 0.27) == (*usual, LOW_M)
    assert lowerings_m([SHELF], 0.29) == usual, "it does not fit"
    assert lowerings_m([TABLE, BOWL], 0.38) == usual, "nothing is above"
    given_m = Action(Primitive.LIFT_EEF_DOWN, 0.05)
    assert fill_options((given_m,), lowerings_m([drawer])) == [(given_m,)]


def test_in_a_bowl_with_something_in_it_a_place_is_found_between() -> None:
    middle = Footprint.around(np.array([0.0, 0.0, 0.03]), np.full(3, 0.018))
    rng, others = spot_rng(0, "a", "b", "hollow"), {"die_0": middle}
    found = spots(BOWL, np.eye(4), 0.04, np.zeros(3), height_m=0.04, others=others, rng=rng)
    assert found
    for spot in found:
        assert np.hypot(*np.maximum(np.abs(spot.point_m[:2]) - 0.018, 0.0)) >= 0.02 + APART_M - 1e-9
        assert np.hypot(*spot.point_m[:2]) <= 0.07 - 0.02 + 1e-9


@pytest.mark.parametrize(
    ("half_m", "to_come_m", "aside"), [(0.07, 0.045, True), (0.07, 0.0, False), (0.11, 0.045, False)]
)
def test_in_a_bowl_a_thing_leaves_room_for_what_comes_later(half_m: float, to_come_m: float, aside: bool) -> None:
    bowl = Region("hollow", "interior", "bowl", (0.0, 0.0, 0.02), (half_m, half_m, 0.02), (0.0, 0.0, 1.0))

    def found(width_m: float, to_come_m: float, others: dict[str, Footprint]) -> list[PlacementSpot]:
        rng = spot_rng(0, "die_0", "bowl_0", "hollow")
        return spots(bowl, np.eye(4), width_m, np.zeros(3), height_m=0.04, others=others, rng=rng, to_come_m=to_come_m)

    first = found(WIDTH_M, to_come_m, {})
    assert first
    if not aside:
        assert [tuple(s.point_m) for s in first] == [tuple(s.point_m) for s in found(WIDTH_M, 0.0, {})]
        return
    for spot in first:
        x, y, _ = spot.point_m
        taken = Footprint.around(np.array([x, y, 0.025]), np.full(3, WIDTH_M / 2 / np.sqrt(2)))
        assert found(to_come_m, 0.0, {"die_0": taken}), "the later thing has a place"
    middle = {"die_0": Footprint.around(np.array([0.0, 0.0, 0.025]), np.full(3, WIDTH_M / 2))}
    assert not found(to_come_m, 0.0, middle)


@pytest.mark.parametrize(("to_come_m", "heaps"), [(0.15, True), (0.0, True), (0.15, False)])
def test_what_comes_first_goes_to_the_back_of_a_compartment(to_come_m: float, heaps: bool) -> None:
    oven = Region("oven", "interior", "body", (0.0, 0.0, 0.12), (0.165, 0.164, 0.12), (-1.0, 0.0, 0.0))
    rng = spot_rng(0, "bottle_0", "oven_0", "oven")
    found = spots(oven, np.eye(4), 0.065, np.zeros(3), height_m=0.2, rng=rng, heaps=heaps, to_come_m=to_come_m)
    leaving = []
    for spot in found:
        x, y, _ = spot.point_m
        taken = {"bottle_0": Footprint.around(np.array([x, y, 0.1]), np.array([0.0325, 0.0325, 0.1]))}
        left = spots(oven, np.eye(4), 0.15, np.zeros(3), height_m=0.06, others=taken)
        leaving.append(any(one.point_m[0] < x for one in left))
    assert any(leaving) and not all(leaving)
    if to_come_m and heaps:
        assert leaving[0] and sorted(leaving, reverse=True) == leaving, "first those that leave room before them"
        return
    rng = spot_rng(0, "bottle_0", "oven_0", "oven")
    usual = spots(oven, np.eye(4), 0.065, np.zeros(3), height_m=0.2, rng=rng)
    assert [tuple(spot.point_m) for spot in found] == [tuple(spot.point_m) for spot in usual]


@pytest.mark.parametrize(("high_m", "heaps", "above"), [(0.05, True, True), (0.05, False, False), (0.10, True, False)])
def test_where_no_room_is_beside_what_lies_in_a_bowl_there_is_room_above_it(
    high_m: float, heaps: bool, above: bool
) -> None:
    lying = {"die_0": Footprint.around(np.array([0.0, 0.0, high_m / 2]), np.array([0.03, 0.03, high_m / 2]))}
    rng = spot_rng(0, "apple_0", "bowl_0", "hollow")
    found = spots(BOWL, np.eye(4), 0.07, np.zeros(3), height_m=0.03, others=lying, rng=rng, heaps=heaps)
    assert bool(found) is above, "what is as high as this stands out of the bowl"
    for spot in found:
        assert spot.point_m[2] == pytest.approx(high_m) and spot.point_m[2] <= HEAP_M


PLATE = Region("top", "surface", "plate", (0.0, 0.0, 0.05), (0.057, 0.057, 0.05), (0.0, 0.0, 1.0))


def test_beside_what_stands_on_a_plate_there_is_room_since_it_is_round() -> None:
    """The square within a plate is too small for both; on its round floor a can stands beside another one."""
    can = Footprint.around(np.array([-0.045, 0.0, 0.05]), np.array([0.03, 0.03, 0.05]))

    def beside(width_m: float, *, is_round: bool) -> list[PlacementSpot]:
        rng, others = spot_rng(0, "can_1", "plate_0", "top"), {"can_0": can}
        return spots(PLATE, np.eye(4), width_m, np.zeros(3), height_m=0.1, others=others, rng=rng, is_round=is_round)

    assert not beside(0.06, is_round=False)
    found = beside(0.06, is_round=True)
    assert found
    for spot in found:
        assert np.hypot(*spot.point_m[:2]) + 0.03 <= 0.057 * np.sqrt(2.0) + 1e-9
        assert np.hypot(*np.maximum(np.abs(spot.point_m[:2] - [-0.045, 0.0]) - 0.03, 0.0)) >= 0.03 + APART_M
    assert not beside(0.11, is_round=True)


@pytest.mark.parametrize("heaps", [True, False])
def test_an_empty_bowl_has_the_same_spots_whether_or_not_things_are_heaped(heaps: bool) -> None:
    rng = spot_rng(0, "apple_0", "bowl_0", "hollow")
    found = spots(BOWL, np.eye(4), 0.07, np.zeros(3), height_m=0.03, rng=rng, heaps=heaps)
    assert found and all(spot.point_m[2] == 0.0 for spot in found)


@pytest.mark.parametrize(("long_m", "fits"), [(0.0675, True), (0.0605, False)])
def test_two_things_that_fit_into_a_box_by_its_diagonal_alone_have_room_in_its_corners(
    long_m: float, fits: bool
) -> None:
    box = Region("hollow", "interior", "box", (0.0, 0.0, 0.034), (long_m, 0.0595, 0.034), (0.0, 0.0, 1.0))

    def found(to_come_m: float, others: dict[str, Footprint]) -> list[PlacementSpot]:
        rng = spot_rng(0, "apple_0", "box_0", "hollow")
        return spots(box, np.eye(4), 0.07, np.zeros(3), height_m=0.07, others=others, rng=rng, to_come_m=to_come_m)

    first = found(0.07, {})[0].point_m
    lying = Footprint.around(first + [0.0, 0.0, 0.035], np.array([0.024, 0.024, 0.035]))
    assert bool(np.abs(first[:2]).min() > 0.01) is fits, "in a corner"
    assert bool(found(0.0, {"apple_1": lying})) is fits
