"""Depth of a network is put right by the camera's height, above a floor as well as above a table's top."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from executor.photo.errors import PhotoRefused
from executor.photo.geometry.level import scale_by_height
from executor.photo.geometry.observation import FloorPlane
from executor.photo.inputs.depth import Depth
from executor.photo.inputs.picture import up_in_camera

UP = up_in_camera(30.0, 0.0)
FLOOR = FloorPlane(UP, 1.5, 2.0, 30.0, 0.004)
DEPTH = Depth(np.full((4, 6), 2.0), str(Path("a network")), depth_distortion=0.02)


@settings(max_examples=20)
@given(st.floats(0.3, 3.0), st.floats(0.6, 2.5))
def test_a_floor_is_as_far_below_as_the_camera_is_high(factor: float, height_m: float) -> None:
    guessed = replace(FLOOR, height_m=height_m / factor)
    depth, floor = scale_by_height(DEPTH, guessed, height_m)
    assert depth.z_m == pytest.approx(DEPTH.z_m * factor) and depth.depth_distortion == 0.02
    assert floor.height_m == height_m and floor.above_top_m is None and "as given" in floor.source


@settings(max_examples=20)
@given(st.floats(0.5, 2.0), st.floats(0.3, 0.8))
def test_the_assumed_height_of_a_table_is_no_part_of_the_depth(factor: float, above_top_m: float) -> None:
    guessed = replace(FLOOR, height_m=above_top_m / factor + 0.74, above_top_m=above_top_m / factor)
    depth, floor = scale_by_height(DEPTH, guessed, above_top_m + 0.74)
    assert depth.z_m == pytest.approx(DEPTH.z_m * factor)
    assert floor.above_top_m == pytest.approx(above_top_m)


def test_an_absurd_factor_is_refused() -> None:
    with pytest.raises(PhotoRefused) as caught:
        scale_by_height(DEPTH, replace(FLOOR, height_m=0.2), 2.0)
    assert caught.value.kind == "scale"
