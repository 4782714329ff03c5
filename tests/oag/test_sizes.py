"""Sizes: what fits the gripper stays, what does not is scaled to the aim, fixtures never, and nothing by too much."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

import oag
from oag.task.sizes import GRASP_AIM_M, LEAST_SCALE, WIDEST_GRASP_M, Resizing, resized, resizings, scale_factor
from tests.oag.paper import scene, task_json

SIDES_M = st.floats(0.01, 0.5)


def thing(category: str, x_m: float, y_m: float, scale: float = 1.0) -> oag.SceneObject:
    """Returns an object of that footprint."""
    return oag.SceneObject(
        "thing_0", category, category, (0, 0, 0), (1, 0, 0, 0), (x_m, y_m, 0.1), (scale, scale, scale)
    )


@pytest.mark.parametrize(
    ("d_min_m", "factor"), [(0.07, 0.71), (0.08, 0.62), (0.06, 0.83), (0.053, 1.0), (0.05, 1.0), (0.135, 0.37)]
)
def test_the_smaller_side_decides(d_min_m: float, factor: float) -> None:
    assert scale_factor(thing("apple", d_min_m, 0.2)) == factor
    assert scale_factor(thing("apple", 0.2, d_min_m)) == factor


@given(SIDES_M, SIDES_M, st.floats(0.3, 3.0))
def test_a_scaled_item_fits_the_gripper(x_m: float, y_m: float, scale: float) -> None:
    item = thing("apple", x_m, y_m, scale)
    factor = scale_factor(item)
    width_m = factor * min(item.extent_m[:2])
    if factor < LEAST_SCALE:
        assert min(item.extent_m[:2]) > 0.2
        return
    assert width_m <= WIDEST_GRASP_M
    if factor != 1.0:
        # Two decimals of the factor move the width by half a percent of the item's side.
        assert width_m == pytest.approx(GRASP_AIM_M, abs=0.005 * min(item.extent_m[:2]) + 1e-9)


@given(SIDES_M, SIDES_M)
def test_fixtures_are_never_scaled(x_m: float, y_m: float) -> None:
    assert scale_factor(thing("refrigerator", x_m, y_m)) == 1.0
    assert scale_factor(thing("table", x_m, y_m)) == 1.0


def put_glass(width_m: float, scales: dict[str, float]) -> oag.Report:
    """Returns what is decided of T1 with a glass of that width."""
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
    assert put_glass(width_m, {"glass_0": scale_factor(report.scene["glass_0"])})


def test_the_widest_that_the_gripper_takes_is_proved_as_it_is() -> None:
    assert put_glass(WIDEST_GRASP_M, {})


@pytest.mark.parametrize(("width_m", "factor"), [(5.0, 0.01), (0.07, 0.2), (0.07, 0.2499)])
def test_nothing_is_made_into_another_thing(width_m: float, factor: float) -> None:
    (error,) = put_glass(width_m, {"glass_0": factor}).errors
    assert (error.code, error.place) == ("task/size", "scales")
    assert f"scaled by {factor:g}, and nothing is scaled by less than 0.25" in error.message


def test_a_quarter_is_allowed() -> None:
    assert put_glass(0.2, {"glass_0": LEAST_SCALE})


def test_a_scale_that_is_not_allowed_is_not_offered() -> None:
    report = put_glass(5.0, {})
    assert [error.code for error in report.errors] == ["task/size"]
    assert "nothing is scaled by less than 0.25" in (report.errors[0].hint or "")
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
    (found,) = resizings({"nothing_0": 0.5, "glass_0": 0.5}, scene("T1"))
    assert resized(scene("T1").with_scales({"glass_0": 0.5})) == (found,)
    assert found == Resizing("glass_0", (0.5, 0.5, 0.5), (0.07, 0.07, 0.12), (0.035, 0.035, 0.06))
