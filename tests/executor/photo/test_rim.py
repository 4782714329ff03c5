"""A round rim tells how a picture is tilted and how far off a table is."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from executor.geometry import Array
from executor.photo.errors import PhotoRefused
from executor.photo.fitting.rim import beneath, level_by_rim, tilted_circle
from executor.photo.geometry.observation import level_rotation
from executor.photo.inputs.annotations import Detection
from executor.photo.inputs.picture import Exif, Intrinsics, Photograph

cv2 = pytest.importorskip("cv2")
SIZE = (600, 400)
CAMERA = Intrinsics(650.0, 650.0, 300.0, 200.0, "drawn")
DOWN_RAD, ABOVE_M, RADIUS_M = math.radians(40.0), 0.45, 0.035
UP = np.array([0.0, -math.cos(DOWN_RAD), -math.sin(DOWN_RAD)])
TABLE = Detection("dining table", "table", (2.0, 4.0, 597.0, 398.0), 1.0, "drawn")


def rim(ahead_m: float = 0.5, aside_m: float = 0.04) -> Array:
    """(N, 2) pixels of a level circle, a height below the camera."""
    angle = np.linspace(0.0, 2.0 * math.pi, 200, endpoint=False)
    level = np.stack(
        [ahead_m + RADIUS_M * np.cos(angle), aside_m + RADIUS_M * np.sin(angle), np.full(200, -ABOVE_M)], axis=1
    )
    seen = level @ level_rotation(UP)
    return np.stack([650.0 * seen[:, 0] / seen[:, 2] + 300.0, 650.0 * seen[:, 1] / seen[:, 2] + 200.0], axis=1)


def test_an_ellipse_tells_the_tilt_and_the_distance() -> None:
    up, distance = tilted_circle(cv2.fitEllipse(rim().astype(np.float32)), CAMERA)
    assert math.degrees(math.acos(min(1.0, float(up @ UP)))) < 0.5
    assert distance * RADIUS_M == pytest.approx(ABOVE_M, rel=0.01)


def test_a_cup_on_a_table_that_fills_the_picture_levels_it() -> None:
    rgb = np.full((SIZE[1], SIZE[0], 3), (120, 80, 50), np.uint8)
    cv2.fillPoly(rgb, [np.round(rim() - 0.5).astype(np.int32)], (235, 235, 230), cv2.LINE_AA)
    picture = Photograph(Path("table.png"), rgb, Exif(None, None, ""))
    (x0, y0), (x1, y1) = rim().min(axis=0), rim().max(axis=0)
    cup = Detection("cup", "cup", (x0 - 2, y0 - 3, x1 + 2, y1 + 40), 1.0, "drawn")
    floor = level_by_rim(picture, CAMERA, [TABLE, cup])
    assert math.degrees(math.acos(min(1.0, float(floor.up @ UP)))) < 2.0
    # A cup of usual size is 0.07 m wide and 0.085 m high, a table 0.65 m.
    assert floor.height_m == pytest.approx(ABOVE_M + 0.085 + 0.65, abs=0.03)
    assert "as wide as usual" in floor.source and 0.05 < floor.spread_share < 0.15
    with pytest.raises(PhotoRefused, match="no table fills the picture"):
        level_by_rim(picture, CAMERA, [cup])
    with pytest.raises(PhotoRefused, match="no rim of something round"):
        level_by_rim(picture, CAMERA, [TABLE])


def test_what_fills_a_picture_is_what_reaches_three_borders() -> None:
    assert [entry.model for entry in beneath(TABLE, SIZE)][:1] == ["table_four_legs"]
    assert not beneath(Detection("table", "table", (100.0, 4.0, 500.0, 398.0), 1.0, "drawn"), SIZE)
    assert not beneath(Detection("cup", "cup", TABLE.box_px, 1.0, "drawn"), SIZE)
