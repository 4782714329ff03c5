"""Size adjustment: what fits the gripper stays, what does not is scaled to the aim, fixtures never."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

import llm
import oag
from llm.resize import GRASP_AIM_M, GRIPPER_LIMIT_M, scale_factor, scale_factors
from tests.llm.kitchens import SCENES

SIDES_M = st.floats(0.01, 0.5)


def thing(category: str, x_m: float, y_m: float, scale: float = 1.0) -> oag.SceneObject:
    """Returns an object of that footprint."""
    return oag.SceneObject(
        "thing_0", category, category, (0, 0, 0), (1, 0, 0, 0), (x_m, y_m, 0.1), (scale, scale, scale)
    )


@pytest.mark.parametrize(("d_min_m", "factor"), [(0.07, 0.71), (0.08, 0.62), (0.06, 1.0), (0.05, 1.0), (0.135, 0.37)])
def test_the_smaller_side_decides(d_min_m: float, factor: float) -> None:
    assert scale_factor(thing("apple", d_min_m, 0.2)) == factor
    assert scale_factor(thing("apple", 0.2, d_min_m)) == factor


@given(SIDES_M, SIDES_M, st.floats(0.3, 3.0))
def test_a_scaled_item_fits_the_gripper(x_m: float, y_m: float, scale: float) -> None:
    item = thing("apple", x_m, y_m, scale)
    factor = scale_factor(item)
    width_m = factor * min(item.extent_m[:2])
    assert width_m <= GRIPPER_LIMIT_M
    if factor != 1.0:
        # Two decimals of the factor move the width by half a percent of the item's side.
        assert width_m == pytest.approx(GRASP_AIM_M, abs=0.005 * min(item.extent_m[:2]) + 1e-9)


@given(SIDES_M, SIDES_M)
def test_fixtures_are_never_scaled(x_m: float, y_m: float) -> None:
    assert scale_factor(thing("refrigerator", x_m, y_m)) == 1.0
    assert scale_factor(thing("table", x_m, y_m)) == 1.0


def test_each_object_gets_one_factor_in_order_of_first_use() -> None:
    targets = ("refrigerator_0", "glass_0", "glass_0", "refrigerator_0")
    factors = scale_factors(targets, SCENES["kitchen_t1"])
    assert list(factors.items()) == [("refrigerator_0", 1.0), ("glass_0", 0.71)]
    assert llm.propose("put the cup into the fridge", SCENES["kitchen_t1"]).task.scales == factors
