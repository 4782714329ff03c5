"""What is in the way of a place: distances from boxes seen from above, at the heights that things share."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from executor.assets.footprint import Disc, Footprint, gaps_m, link_frame, region_frame
from executor.assets.library import asset_for, sample
from executor.geometry import rotation_z

OFFSETS = st.floats(-2.0, 2.0)
BOX = Footprint(0.3, -0.2, 0.7, 0.4, 0.15, 0.5, 0.9)


@given(x=OFFSETS, y=OFFSETS, yaw=st.floats(-math.pi, math.pi), radius=st.floats(0.0, 0.3))
def test_a_disc_is_as_far_off_as_the_nearest_point_of_a_box(x: float, y: float, yaw: float, radius: float) -> None:
    box = replace(BOX, yaw_rad=yaw)
    shares = np.linspace(-1.0, 1.0, 201)
    grid = np.stack(np.meshgrid(shares * box.half_x_m, shares * box.half_y_m), axis=-1).reshape(-1, 2)
    points = grid @ rotation_z(yaw)[:2, :2].T + [box.x_m, box.y_m]
    nearest_m = float(np.linalg.norm(points - [x, y], axis=1).min())
    gap_m = Disc(x, y, radius, 0.5, 0.9).gap_m(box)
    # A point of the grid is never nearer than the box, and farther by half of a 4 mm cell at most.
    assert nearest_m - radius - 0.003 <= gap_m <= nearest_m - radius + 1e-9


@pytest.mark.parametrize("mine", [Disc(0.3, -0.2, 0.1, 0.0, 0.0), Footprint(0.3, -0.2, 0.0, 0.1, 0.1)])
def test_only_what_shares_heights_is_in_the_way(mine: Disc | Footprint) -> None:
    others = {"box_0": BOX, "far_0": replace(BOX, x_m=3.0)}
    on_it, under_it = (replace(mine, low_m=low, high_m=low + 0.2) for low in (BOX.high_m, BOX.low_m - 0.2))
    assert not dict(gaps_m(on_it, others)) and not dict(gaps_m(under_it, others))
    beside = dict(gaps_m(replace(mine, low_m=BOX.low_m, high_m=BOX.high_m), others))
    assert list(beside) == ["box_0", "far_0"] and beside["box_0"] < 0.0 < 2.0 < beside["far_0"]


def test_the_floor_of_a_drawer_moves_with_it() -> None:
    chest = sample("cabinet_drawers", 3)
    drawer = next(region for region in asset_for(chest).regions if region.kind == "interior" and region.joint)
    shut, _ = region_frame(chest, drawer)
    ajar, half = region_frame(replace(chest, parameters={**chest.parameters, "open_fraction": 0.5}), drawer)
    joint = next(joint for joint in asset_for(chest).joints if joint.child == drawer.link)
    slid = ajar[:3, 3] - shut[:3, 3]
    assert np.linalg.norm(slid) == pytest.approx(joint.position(0.5) - joint.position(0.0))
    assert link_frame(chest, drawer.link, 0.5)[:3, 3] - link_frame(chest, drawer.link)[:3, 3] == pytest.approx(slid)
    assert tuple(half) == drawer.half_extents_m[:2]
