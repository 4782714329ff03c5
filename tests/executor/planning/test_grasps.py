"""Where hands come from: round things from everywhere, boxes across their short side, the palm clear of deep things."""

from __future__ import annotations

import numpy as np
import pytest

from executor.assets.asset_geometry import bounds
from executor.assets.library import asset_for, sample
from executor.geometry import rotation_z, transform
from executor.planning.grasps import (
    FINGERTIPS_M,
    HOLDING_SHARE,
    ITEM_HEADINGS,
    SPARE_M,
    deep_goals,
    item_goals,
    narrowed_goals,
)
from oag import SceneObject
from oag.model.robots import LIFTED, PAPER_ROBOT
from tests.executor.helpers import scene_at_paper_size

HAND, FULL = PAPER_ROBOT.hand, LIFTED


@pytest.mark.parametrize(("scene", "item"), [("kitchen_t1", "glass_0"), ("kitchen_t3", "apple_0")])
def test_round_things_are_taken_at_their_middle_from_everywhere(scene: str, item: str) -> None:
    asset = asset_for(scene_at_paper_size(scene).objects[item])
    goals = item_goals(HAND, asset, np.eye(4))
    assert len({round(goal.heading_rad, 6) for goal in goals}) == ITEM_HEADINGS
    for goal in goals:
        # The hand's middle is on the axis, or so little before it that the fingertips still close around it.
        assert np.hypot(*goal.T_world_eef[:2, 3]) <= FINGERTIPS_M + 1e-9


def test_a_tall_thing_is_taken_from_above_near_its_top_where_the_palm_has_room() -> None:
    asset = asset_for(sample("cup", 3).scaled(0.05 / sample("cup", 3).extent_m[1]))
    radius_m, half_m = asset.extent_m[0] / 2, asset.extent_m[2] / 2
    steep = [goal for goal in item_goals(HAND, asset, np.eye(4)) if goal.T_world_eef[2, 2] < -0.6]
    assert steep
    for goal in steep:
        approach, hand = goal.T_world_eef[:3, 2], goal.T_world_eef[:3, 3]
        level = approach[:2] / np.linalg.norm(approach[:2])
        upper_edge = np.array([*(-radius_m * level), half_m])
        assert float(approach @ (upper_edge - hand)) >= -HAND.palm_room_m - 1e-9
        assert hand[2] < half_m


@pytest.mark.parametrize("model", ["plate", "half_apple", "book_lying"])
def test_fingertips_stay_off_what_a_flat_thing_lies_on(model: str) -> None:
    item = sample(model, 1)
    asset = asset_for(item.scaled(0.05 / min(item.extent_m[:2])))
    for goal in item_goals(HAND, asset, np.eye(4)):
        approach, across = goal.T_world_eef[:3, 2], goal.T_world_eef[:3, 0]
        tip_z = goal.T_world_eef[2, 3] + HAND.fingertip_m * approach[2] - HAND.finger_half_m * abs(across[2])
        assert tip_z >= -asset.extent_m[2] / 2 + 0.0015


def test_a_thin_thing_is_taken_so_steeply_that_the_tips_hold_most_of_it() -> None:
    item = sample("plate", 1)
    asset = asset_for(item.scaled(0.05 / min(item.extent_m[:2])))
    goals = sorted(item_goals(HAND, asset, np.eye(4)), key=lambda goal: goal.cost)
    for goal in goals[:ITEM_HEADINGS]:
        tips_m = goal.T_world_eef[2, 3] + HAND.fingertip_m * goal.T_world_eef[2, 2]
        assert asset.extent_m[2] / 2 - tips_m >= asset.extent_m[2] / 2


@pytest.mark.parametrize("size", [(0.22, 0.05, 0.022), (0.30, 0.04, 0.035), (0.14, 0.03, 0.012)])
def test_a_hand_before_the_end_of_a_long_low_thing_closes_around_it_and_not_above_it(
    size: tuple[float, float, float],
) -> None:
    where, upright = (0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0)
    asset = asset_for(SceneObject("box_0", "box", "generic_box", where, upright, size, (1.0, 1.0, 1.0), {}))
    goals = item_goals(FULL.hand, asset, np.eye(4))
    assert goals
    for goal in goals:
        approach = goal.T_world_eef[:3, 2]
        across_m = FULL.hand.finger_half_m * float(np.hypot(*approach[:2]))
        tips_m = goal.T_world_eef[2, 3] + FULL.hand.fingertip_m * float(approach[2]) - across_m
        assert size[2] / 2 - tips_m >= min(0.010, size[2] / 2) - 1e-9


def test_what_lies_in_a_box_is_held_steeply_along_a_wall_with_the_palm_above_it() -> None:
    apple = asset_for(sample("red_apple", 0))
    T, along_rad, wall_m = transform(rotation_z(0.7), [0.5, 0.2, 0.4]), 0.4, 0.010
    goals = deep_goals(apple, T, along_rad)
    assert goals and all(-goal.T_world_eef[2, 2] > np.sin(np.deg2rad(59.0)) for goal in goals)
    for goal in goals:
        turns = (goal.heading_rad - along_rad) / (np.pi / 2)
        assert turns == pytest.approx(round(turns)), "along a wall"
        above_m = goal.T_world_eef[2, 3] - T[2, 3]
        radius_m = apple.extent_m[2] / 2
        assert np.sqrt(radius_m**2 - above_m**2) >= HOLDING_SHARE * radius_m - 1e-9, "its sides hold"
    palm_m = max(goal.T_world_eef[2, 3] for goal in goals) + LIFTED.hand.palm_room_m
    assert palm_m > T[2, 3] + apple.extent_m[2] / 2 + wall_m, "over a wall that is higher than the apple"
    assert not deep_goals(asset_for(sample("bottle", 0)), T, along_rad), "what is tall is taken from the side"


@pytest.mark.parametrize("model", ["carton", "book_upright", "die", "mug"])
@pytest.mark.parametrize("yaw_rad", [0.0, 0.4, -1.1])
def test_fingers_close_across_what_fits_between_them(model: str, yaw_rad: float) -> None:
    asset = asset_for(sample(model, 0))
    T = transform(rotation_z(yaw_rad), [0.5, 0.2, 0.7])
    goals = item_goals(HAND, asset, T)
    assert goals
    for goal in goals:
        closing = np.abs(T[:3, :3].T @ goal.T_world_eef[:3, 1])
        width = float(closing @ asset.extent_m)
        assert width == pytest.approx(asset.graspable_width_m)


@pytest.mark.parametrize("model", ["carton", "book_upright", "die", "half_apple"])
def test_the_palm_stays_clear_of_deep_things(model: str) -> None:
    asset = asset_for(sample(model, 0))
    for goal in item_goals(HAND, asset, np.eye(4)):
        R = goal.T_world_eef[:3, :3]
        nearest = bounds(asset, R.T)[0][2]
        palm = float(R[:, 2] @ goal.T_world_eef[:3, 3]) - HAND.palm_room_m
        lift = 0.12 * asset.extent_m[2]  # Tall things are taken above their middle, at any tilt.
        assert palm <= nearest + lift + 1e-9


@pytest.mark.parametrize("seed", [0, 1, 2, 3])
def test_a_mug_is_closed_on_where_its_sides_hold_also_from_where_its_ear_is(seed: int) -> None:
    item = sample("mug", seed)
    asset = asset_for(item.scaled(0.05 / item.extent_m[1]))
    axis_m, radius_m = np.array(asset.grasp_point_m), asset.extent_m[1] / 2
    goals = item_goals(HAND, asset, np.eye(4))
    # The ear is at +x: hands come from its side as well, from above.
    assert any(goal.T_world_eef[0, 2] < 0.0 for goal in goals)
    for goal in goals:
        # From 0.72 of the radius on, the sides lean by more than what friction holds.
        assert abs(float(goal.T_world_eef[0, 3] - axis_m[0])) <= 0.72 * radius_m


def test_something_deep_is_taken_near_its_front_where_it_is_as_wide() -> None:
    asset = asset_for(sample("book_upright", 0))
    level = [goal.T_world_eef for goal in item_goals(HAND, asset, np.eye(4)) if abs(goal.T_world_eef[2, 2]) < 1e-6]
    assert level
    assert all(np.linalg.norm(T[:2, 3]) > FINGERTIPS_M for T in level)


@pytest.mark.parametrize(("width_m", "ways"), [(0.03, len(SPARE_M)), (0.076, 1), (0.08, 0)])
def test_fingers_are_open_a_little_wider_than_what_they_close_on_and_never_wider_than_they_get(
    width_m: float, ways: int
) -> None:
    goals = item_goals(FULL.hand, asset_for(sample("red_apple", 3)), np.eye(4))
    narrowed = narrowed_goals(goals, width_m, FULL.hand.opening_m / 2)
    assert len(narrowed) == ways * len(goals)
    for goal in narrowed:
        assert goal.opening_m is not None and width_m / 2 < goal.opening_m < FULL.hand.opening_m / 2
    assert all(goal.opening_m is None for goal in goals)
