"""A picture without depth is levelled by its lines, and scaled by the camera's height."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.drawn_rooms.rooms import DrawnRoom
from executor.bench.photo.truth import photograph, photographer
from executor.geometry import Array
from executor.photo.errors import PhotoRefused
from executor.photo.geometry.level import flat_observation, level_by_height
from executor.photo.geometry.lines import find_upright
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


@pytest.fixture(scope="module")
def picture() -> Photograph:
    return drawn((3.2, 0.9), (2.9, -0.2), (2.7, -1.1))


def off_deg(up: Array) -> float:
    """Return how far a direction is off the one that is up."""
    return math.degrees(math.acos(float(np.clip(up @ UP, -1.0, 1.0))))


def test_lines_tell_what_is_up_and_how_furniture_is_turned(picture: Photograph) -> None:
    found = find_upright(picture, CAMERA)
    assert off_deg(found.up) < 0.2
    floor = level_by_height(found, HEIGHT_M)
    assert floor.tilt_deg == pytest.approx(20.0, abs=0.5) and "lines; the camera" in floor.source
    seen = flat_observation(picture, CAMERA, floor)
    assert not seen.has_depth and seen.heading_rad is not None
    assert abs(math.remainder(seen.heading_rad - TURNED_RAD, math.pi / 2)) < math.radians(1.0)


def test_level_lines_tell_how_far_a_camera_looks_down_where_upright_ones_do_not() -> None:
    # By its upright lines alone it is 0.25 degrees off.
    assert off_deg(find_upright(drawn((4.2, 0.4), (3.5, -0.3), (2.8, 0.3)), CAMERA).up) < 0.1


def test_lines_between_hues_of_one_brightness_are_as_good_as_others() -> None:
    # In grey there is hardly a line.
    assert off_deg(find_upright(drawn((3.2, 0.9), (2.9, -0.2), colours=ALIKE), CAMERA).up) < 0.2


@pytest.mark.slow
@pytest.mark.render
@pytest.mark.parametrize(
    ("room", "off_rad"),
    [
        # What stands askew, and lines of little contrast, made up 3 to 5 mrad off: 2 cm of a cup's place on a table.
        (DrawnRoom("household", 77800, 4), 1e-3),
        (DrawnRoom("household", 77800, 47), 1e-3),
        # More lines went by another direction, 4 degrees off, as long as headings were those one begins with.
        (DrawnRoom("T3", 78502, None), 3e-3),
    ],
    ids=str,
)
def test_up_is_told_in_rooms_where_not_all_lines_go_alike(room: DrawnRoom, off_rad: float) -> None:
    with photographer():
        shot = photograph(room.pair().scene, room.camera_seed)
    K = shot.K
    camera = Intrinsics(K[0, 0], K[1, 1], K[0, 2], K[1, 2], "drawn")
    found = find_upright(Photograph(Path("room.png"), shot.rgb, Exif(None, None, "")), camera)
    assert np.linalg.norm(found.up - shot.T_world_camera[2, :3]) < off_rad


def test_up_is_square_to_other_lines_and_not_where_most_meet(picture: Photograph) -> None:
    cv2 = pytest.importorskip("cv2")
    rgb, meet = picture.rgb.copy(), np.array([1000.0, -900.0])
    for x in range(50, 610, 90):
        ends = [meet + (np.array([x, 470.0]) - meet) * (row - meet[1]) / (470.0 - meet[1]) for row in (5.0, 115.0)]
        cv2.line(rgb, *(tuple(np.round(end * 16).astype(int).tolist()) for end in ends), (230,) * 3, 2, cv2.LINE_AA, 4)
    assert off_deg(find_upright(replace(picture, rgb=rgb), CAMERA).up) < 0.3


def test_a_picture_without_lines_is_refused() -> None:
    grey = Photograph(Path("grey.png"), np.full((SIZE[1], SIZE[0], 3), 90, np.uint8), Exif(None, None, ""))
    with pytest.raises(PhotoRefused, match="0 lines of it are upright"):
        find_upright(grey, CAMERA)
