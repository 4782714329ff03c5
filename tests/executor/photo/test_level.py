"""A picture without depth is levelled as given, and its lines tell how furniture is turned."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from executor.geometry import Array
from executor.photo.geometry.level import flat_observation, level_as_given
from executor.photo.geometry.lines import heading_of_lines
from executor.photo.geometry.observation import level_rotation
from executor.photo.inputs.picture import Exif, Intrinsics, Photograph

SIZE = (640, 480)
CAMERA = Intrinsics(520.0, 520.0, 320.0, 240.0, "drawn")
HEIGHT_M, TURNED_RAD = 1.5, 0.3
DOWN_RAD, ROLL_RAD = math.radians(20.0), math.radians(3.0)
UP = np.array([math.sin(ROLL_RAD) * math.cos(DOWN_RAD), -math.cos(ROLL_RAD) * math.cos(DOWN_RAD), -math.sin(DOWN_RAD)])


def in_picture(points_m: Array) -> Array:
    """Return (N, 2) pixels of points of the level frame."""
    seen = (points_m - [0.0, 0.0, HEIGHT_M]) @ level_rotation(UP)
    return np.stack([520.0 * seen[:, 0] / seen[:, 2] + 320.0, 520.0 * seen[:, 1] / seen[:, 2] + 240.0], axis=1)


GREYS = ((60,) * 3, (200,) * 3, (150,) * 3, (110,) * 3)
ALIKE = ((120, 120, 120), (200, 80, 116), (40, 160, 124), (120, 100, 223))  # As bright as each other, in other hues.


def drawn(*places: tuple[float, float], colours: Sequence[Sequence[int]] = GREYS) -> Photograph:
    """Return boxes on a floor, all turned alike, drawn face by face: colours of the floor, tops, fronts and sides."""
    cv2 = pytest.importorskip("cv2")
    # Four times as fine, since OpenCV draws edges half a pixel too far out.
    rgb = np.full((4 * SIZE[1], 4 * SIZE[0], 3), colours[0], np.uint8)
    c, s = math.cos(TURNED_RAD), math.sin(TURNED_RAD)
    for number, (x, y) in enumerate(places):
        corners = np.array(list(itertools.product((-0.25, 0.25), (-0.3, 0.3), (0.0, 0.8)))) @ np.array(
            [[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]]
        ) + [x, y, 0.0]
        pixels = np.round(4 * in_picture(corners) - 0.5).astype(np.int32)
        faces = (1, 3, 7, 5), (0, 1, 3, 2), (0, 1, 5, 4) if y > 0 else (2, 3, 7, 6)
        for colour, face in zip(colours[1:], faces, strict=True):
            cv2.fillConvexPoly(rgb, pixels[list(face)], [value - 20 * number for value in colour])
    return Photograph(Path("drawn.png"), cv2.resize(rgb, SIZE, interpolation=cv2.INTER_AREA), Exif(None, None, ""))


@pytest.mark.parametrize("colours", [GREYS, ALIKE], ids=["greys", "hues of one brightness"])
@pytest.mark.parametrize("factor", [0.75, 1.0, 2.5])
def test_level_lines_tell_how_furniture_is_turned_at_any_resolution(
    colours: Sequence[Sequence[int]], factor: float
) -> None:
    shown = drawn((3.2, 0.9), (2.9, -0.2), (2.7, -1.1), colours=colours)
    size = round(factor * SIZE[0]), round(factor * SIZE[1])
    shown = replace(shown, rgb=np.asarray(Image.fromarray(shown.rgb).resize(size, Image.Resampling.LANCZOS)))
    camera = Intrinsics(520.0 * factor, 520.0 * factor, 320.0 * factor, 240.0 * factor, "drawn")
    floor = level_as_given(UP, HEIGHT_M)
    assert floor.tilt_deg == pytest.approx(20.0) and floor.height_m == HEIGHT_M
    seen = flat_observation(shown, camera, floor)
    assert not seen.has_depth and seen.heading_rad is not None
    assert abs(math.remainder(seen.heading_rad - TURNED_RAD, math.pi / 2)) < math.radians(1.0)


def test_where_no_two_directions_stand_out_nothing_is_turned() -> None:
    pytest.importorskip("cv2")
    grey = Photograph(Path("grey.png"), np.full((SIZE[1], SIZE[0], 3), 90, np.uint8), Exif(None, None, ""))
    assert heading_of_lines(grey, CAMERA, level_rotation(UP)) is None
