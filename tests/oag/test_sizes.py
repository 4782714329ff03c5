"""Sizes: what fits the gripper stays, what does not is scaled until it does, fixtures never, nothing by too much."""

from __future__ import annotations

from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

import oag
from oag.model.scene import RobotPose
from oag.sizes import (
    LEAST_SCALE,
    PAPER_GRIPPER,
    Gripper,
    Resizing,
    Sizing,
    graspable_items,
    planned_resizings,
    scale_factor,
    scaled_objects,
)
from tests.oag.paper import scene, task_json

SIDES_M = st.floats(0.01, 0.5)


def thing(category: str, x_m: float, y_m: float, scale: float = 1.0) -> oag.SceneObject:
    """Return an object of that footprint."""
    return oag.SceneObject(
        "thing_0", category, category, (0, 0, 0), (1, 0, 0, 0), (x_m, y_m, 0.1), (scale, scale, scale)
    )


@pytest.mark.parametrize(
    ("d_min_m", "factor"),
    [(0.07, 0.71), (0.08, 0.62), (0.06, 0.83), (0.053, 1.0), (0.05, 1.0), (0.085, 0.6), (0.135, 0.39)],
)
def test_the_smaller_side_decides(d_min_m: float, factor: float) -> None:
    assert scale_factor(thing("apple", d_min_m, 0.2), PAPER_GRIPPER) == factor
    assert scale_factor(thing("apple", 0.2, d_min_m), PAPER_GRIPPER) == factor


@given(SIDES_M, SIDES_M, st.floats(0.3, 3.0))
def test_a_scaled_item_fits_the_gripper(x_m: float, y_m: float, scale: float) -> None:
    item = thing("apple", x_m, y_m, scale)
    factor = scale_factor(item, PAPER_GRIPPER)
    width_m = factor * min(item.extent_m[:2])
    if factor < LEAST_SCALE:
        assert min(item.extent_m[:2]) > 0.99 * PAPER_GRIPPER.widest_scaled_m
        return
    assert width_m <= PAPER_GRIPPER.widest_m
    if factor > LEAST_SCALE and factor != 1.0:
        # Two decimals of the factor move the width by half a percent of the item's side.
        assert width_m == pytest.approx(PAPER_GRIPPER.aim_m, abs=0.005 * min(item.extent_m[:2]) + 1e-9)


@given(st.floats(PAPER_GRIPPER.widest_m + 1e-6, PAPER_GRIPPER.widest_scaled_m - 1e-6), st.integers(0, 2**31))
def test_what_is_drawn_is_between_both_bounds_and_again_the_same(width_m: float, seed: int) -> None:
    item = thing("apple", width_m, 0.2)
    factor = Sizing(seed).factor(item, PAPER_GRIPPER)
    assert LEAST_SCALE <= factor < 1.0
    low_m, high_m = PAPER_GRIPPER.least_m, PAPER_GRIPPER.most_m
    assert low_m - 1e-4 <= factor * width_m <= high_m + 1e-4
    assert Sizing(seed).factor(item, PAPER_GRIPPER) == factor and Sizing(seed).unfit(item, PAPER_GRIPPER) is None


@pytest.mark.parametrize(("width_m", "low_m"), [(0.058, 0.035), (0.08, 0.048)])
def test_widths_are_drawn_all_over_what_fits(width_m: float, low_m: float) -> None:
    """Three fifths of the larger thing's size are more than the narrowest width."""
    widths_m = [Sizing(seed).factor(thing("apple", width_m, 0.2), PAPER_GRIPPER) * width_m for seed in range(200)]
    spread_m = PAPER_GRIPPER.most_m - low_m
    assert min(widths_m) < low_m + 0.05 * spread_m and max(widths_m) > PAPER_GRIPPER.most_m - 0.05 * spread_m
    assert len(set(widths_m)) > 20


def test_what_is_to_keep_its_size_keeps_it_and_fits_or_does_not() -> None:
    keep, apple, cup = Sizing(3, keep=True), thing("apple", 0.07, 0.07), thing("cup", 0.07, 0.07)
    assert keep.factor(apple, PAPER_GRIPPER) == keep.factor(cup, PAPER_GRIPPER) == 1.0
    assert keep.unfit(apple, PAPER_GRIPPER) == "is to keep its size"
    assert keep.unfit(cup, PAPER_GRIPPER) is None, "it is held by its rim"
    assert keep.unfit(thing("apple", 0.05, 0.05), PAPER_GRIPPER) is None


def test_what_is_too_wide_to_be_scaled_keeps_its_size_where_it_has_a_rim() -> None:
    assert Sizing(1).factor(thing("bowl", 0.15, 0.15), PAPER_GRIPPER) == 1.0
    assert Sizing(1).unfit(thing("bowl", 0.15, 0.15), PAPER_GRIPPER) is None
    assert "nothing is scaled by less than 0.6" in (Sizing(1).unfit(thing("plate", 0.2, 0.2), PAPER_GRIPPER) or "")
    things = {
        f"{name}_0": thing(name, side_m, side_m) for name, side_m in (("plate", 0.2), ("bowl", 0.15), ("table", 0.9))
    }
    things = {key: replace(one, id=key) for key, one in things.items()}
    assert graspable_items(oag.Scene("", RobotPose(), things), Sizing()) == ("bowl_0",)


@given(SIDES_M, SIDES_M)
def test_fixtures_are_never_scaled(x_m: float, y_m: float) -> None:
    assert scale_factor(thing("refrigerator", x_m, y_m), PAPER_GRIPPER) == 1.0
    assert scale_factor(thing("table", x_m, y_m), PAPER_GRIPPER) == 1.0


def put_glass(width_m: float, scales: dict[str, float]) -> oag.Report:
    """Return what is decided of T1 with a glass of that width."""
    kitchen = scene("T1").to_json()
    objects = kitchen["objects"]
    assert isinstance(objects, dict)
    objects["glass_0"] |= {"bbox_extent": [width_m, width_m, 0.12]}
    return oag.compose(oag.Task.from_json(task_json("T1") | {"scales": scales}, oag.Scene.from_json(kitchen))).verify()


@pytest.mark.parametrize("width_m", [0.0535, 0.057, 0.06])
def test_what_is_between_the_gripper_and_the_papers_limit_is_not_proved_at_its_own_size(width_m: float) -> None:
    report = put_glass(width_m, {})
    assert report.verdict is oag.Verdict.REFUTED
    assert [error.code for error in report.errors] == ["task/size"]
    assert report.fixes[0].kind == "change-scale" and report.fixes[0].proves
    assert put_glass(width_m, {"glass_0": scale_factor(report.scene["glass_0"], PAPER_GRIPPER)})


def test_the_widest_that_the_gripper_takes_is_proved_as_it_is() -> None:
    assert put_glass(PAPER_GRIPPER.widest_m, {})


@pytest.mark.parametrize(("width_m", "factor"), [(5.0, 0.01), (0.07, 0.2), (0.07, 0.5999)])
def test_nothing_is_made_into_another_thing(width_m: float, factor: float) -> None:
    (error,) = put_glass(width_m, {"glass_0": factor}).errors
    assert (error.code, error.place) == ("task/size", "scales")
    assert f"scaled by {factor:g}, and nothing is scaled by less than 0.6" in error.message


def test_three_fifths_are_allowed() -> None:
    assert put_glass(0.085, {"glass_0": LEAST_SCALE})


def test_a_scale_that_is_not_allowed_is_not_offered() -> None:
    report = put_glass(5.0, {})
    assert [error.code for error in report.errors] == ["task/size"]
    assert "nothing is scaled by less than 0.6" in (report.errors[0].hint or "")
    assert "change-scale" not in {fix.kind for fix in report.fixes}


def test_every_scaling_is_said_and_none_that_changes_nothing() -> None:
    report = put_glass(0.07, {"refrigerator_0": 1.0, "glass_0": 0.71})
    (note,) = [finding for finding in report.diagnostics if finding.code == "task/scaled"]
    assert note.severity == "note"
    assert note.message == "glass_0 is scaled by 0.71, from 70 x 70 x 120 to 50 x 50 x 85 mm"
    assert note.message in str(report)


def test_a_factor_for_each_axis_is_said_as_such() -> None:
    squeezed = Resizing("box_0", (1.0, 1.0, 0.5), (0.1, 0.2, 0.3), (0.1, 0.2, 0.15))
    assert str(squeezed) == "box_0 is scaled by 1 x 1 x 0.5, from 100 x 200 x 300 to 100 x 200 x 150 mm"


def test_a_resizing_has_both_sizes() -> None:
    (found,) = planned_resizings({"nothing_0": 0.5, "glass_0": 0.5}, scene("T1"))
    assert scaled_objects(scene("T1").with_scales({"glass_0": 0.5})) == (found,)
    assert found == Resizing("glass_0", (0.5, 0.5, 0.5), (0.07, 0.07, 0.12), (0.035, 0.035, 0.06))


FULL = Gripper.of(RobotPose(name="panda"))


def test_a_hand_of_full_size_takes_what_the_papers_takes_scaled() -> None:
    assert (FULL.opening_m, FULL.widest_m) == (0.08, pytest.approx(0.077))
    glass, apple = thing("water_glass", 0.07, 0.07), thing("apple", 0.085, 0.085)
    assert scale_factor(glass, FULL) == 1.0 and scale_factor(glass, PAPER_GRIPPER) == 0.71
    assert scale_factor(apple, FULL) == 0.84, "71 mm are aimed at"
    assert all(0.05 <= 0.085 * Sizing(seed).factor(apple, FULL) <= 0.0765 for seed in range(50))
    assert Sizing(keep=True).unfit(glass, FULL) is None


def test_a_plan_is_proved_for_the_robot_of_its_scene() -> None:
    kitchen = scene("T1").to_json()
    objects = kitchen["objects"]
    assert isinstance(objects, dict)
    objects["glass_0"] |= {"bbox_extent": [0.07, 0.07, 0.12]}
    plan = task_json("T1") | {"scales": {}}
    small, full = oag.Scene.from_json(kitchen), oag.Scene.from_json(kitchen).with_robot("panda")
    assert oag.compose(oag.Task.from_json(plan, small)).verify().verdict is oag.Verdict.REFUTED
    assert oag.compose(oag.Task.from_json(plan, full)).verify().verdict is oag.Verdict.PROVED
    assert oag.Scene.from_json(full.to_json()) == full and "scale" not in str(small.to_json()["robot"])
    with pytest.raises(oag.SceneError, match=r"0\.7 .*or 1"):
        oag.Scene.from_json(kitchen | {"robot": {"scale": 0.8}})
