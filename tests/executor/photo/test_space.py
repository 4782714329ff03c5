"""The floor, the vertical, the noise and the walls of rooms that are drawn by hand, ray by ray."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from executor.assets.library import LIBRARY
from executor.geometry import Array
from executor.photo.errors import PhotoRefused
from executor.photo.fitting.hypothesis import PoseHypothesis
from executor.photo.geometry.observation import observe
from executor.photo.geometry.residuals import BoxView
from executor.photo.geometry.walls import depth_of_empty, find_walls, find_walls_again
from executor.photo.inputs.annotations import Detection
from executor.photo.inputs.depth import Depth
from executor.photo.inputs.picture import Exif, Intrinsics, Photograph
from tests.executor.photo.test_fit import seen_from_above

SIZE = (200, 150)
CAMERA = Intrinsics(170.0, 170.0, 100.0, 75.0, "drawn")
HEIGHT_M, DOWN_RAD, ROLL_RAD = 1.4, math.radians(20.0), math.radians(4.0)
PICTURE = Photograph(Path("drawn.png"), np.zeros((SIZE[1], SIZE[0], 3), np.uint8), Exif(None, None, ""))


def rays_in_room() -> Array:
    """Return (H, W, 3) in a room with x ahead, y left, z up, for a camera that looks down and is a little askew."""
    c, s = math.cos(ROLL_RAD), math.sin(ROLL_RAD)
    rolled = CAMERA.rays(SIZE) @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]]).T
    ahead = np.stack([rolled[..., 2], -rolled[..., 0], -rolled[..., 1]], axis=-1)
    c, s = math.cos(DOWN_RAD), math.sin(DOWN_RAD)
    return ahead @ np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]).T


def drawn(
    wall_m: float | None = 4.0,
    floor: bool = True,
    noise: float = 0.002,
    top_m: float = 9.0,
    left_m: float = math.inf,
    behind_m: float = math.inf,
    thick_m: float = 0.0,
) -> Depth:
    """Return the depth of a floor, walls across and one along, with noise that grows with the square of the depth.

    The first wall across has a top that is as deep as `thick_m`.
    """
    rays = rays_in_room()
    with np.errstate(divide="ignore"):
        z = np.where(rays[..., 2] < -1e-6, -HEIGHT_M / rays[..., 2], np.inf) if floor else np.full(SIZE[::-1], np.inf)
        if wall_m is not None:
            across = np.where(rays[..., 0] > 1e-6, wall_m / rays[..., 0], np.inf)
            z = np.minimum(z, np.where(HEIGHT_M + rays[..., 2] * across < top_m, across, np.inf))
            above = np.where(rays[..., 2] < -1e-6, (top_m - HEIGHT_M) / rays[..., 2], np.inf)
            behind = rays[..., 0] * above - wall_m
            z = np.minimum(z, np.where((above > 0.0) & (behind > 0.0) & (behind < thick_m), above, np.inf))
            along = np.where(rays[..., 1] > 1e-6, left_m / rays[..., 1], np.inf)
            z = np.minimum(z, np.where(rays[..., 0] * along < wall_m, along, np.inf))
            z = np.minimum(z, np.where(rays[..., 0] > 1e-6, behind_m / rays[..., 0], np.inf))
    z = np.where(z < 20.0, z, 0.0)
    spread = np.random.default_rng(0).normal(size=z.shape) * (0.001 + noise * z**2)
    return Depth(np.where(z > 0, z + spread, 0.0), "drawn")


def test_the_floor_levels_the_room_and_tells_the_noise() -> None:
    seen, floor = observe(PICTURE, drawn(), CAMERA)
    assert floor.height_m == pytest.approx(HEIGHT_M, abs=0.002)
    assert floor.tilt_deg == pytest.approx(20.0, abs=0.05)
    heights = seen.points_m[..., 2][seen.measured & (rays_in_room()[..., 2] < -0.5)]
    assert abs(float(np.median(heights))) < 0.003
    assert seen.noise.growth_per_m == pytest.approx(0.002, rel=0.3)


def test_a_point_goes_to_the_pixel_that_it_came_from() -> None:
    seen, _ = observe(PICTURE, drawn(), CAMERA)
    point = seen.points_m[140, 60]
    assert seen.pixels(point)[0] == pytest.approx([60.5, 140.5], abs=1e-6)


def test_the_wall_is_found_and_what_hides_it_is_none() -> None:
    seen, _ = observe(PICTURE, drawn(), CAMERA)
    (wall,) = find_walls(seen, ())
    assert wall.offset_m == pytest.approx(-4.0, abs=0.02)
    assert wall.normal == pytest.approx([-1.0, 0.0], abs=0.02)
    nothing = (Detection("cup", "cup", (0.0, 0.0, 4.0, 4.0), 1.0, "me"),)
    beside = find_walls(observe(PICTURE, drawn(left_m=0.2), CAMERA)[0], nothing)
    assert sorted(wall.offset_m for wall in beside) == pytest.approx([-4.0, -0.2], abs=0.02)
    assert len(find_walls(observe(PICTURE, drawn(left_m=0.05), CAMERA)[0], nothing)) == 1
    everything = Detection("cupboard", None, (0.0, 0.0, 200.0, 150.0), 1.0, "me")
    assert find_walls(seen, (everything,)) == ()


def test_a_wall_that_is_looked_over_is_no_higher_where_another_one_crosses_its_plane() -> None:
    seen, _ = observe(PICTURE, drawn(wall_m=3.0, top_m=0.9, left_m=1.2), CAMERA)
    low = next(wall for wall in find_walls(seen, ()) if abs(wall.normal[0]) > 0.9)
    assert low.offset_m == pytest.approx(-3.0, abs=0.02)
    assert low.top_m == pytest.approx(0.9, abs=0.05)


def test_a_thing_is_seen_as_before_until_something_before_it_is_known() -> None:
    seen, _ = observe(PICTURE, drawn(), CAMERA)
    nobody = np.zeros(seen.z_m.shape, dtype=bool)
    before, box_px = BoxView.of(seen, np.full(seen.z_m.shape, np.inf), nobody), (50.0, 40.0, 100.0, 80.0)
    known = np.full(seen.z_m.shape, np.inf)
    known[:, 60:70] = seen.z_m[:, 60:70]
    assert BoxView.of(seen, known, nobody).is_like(before, (75.0, 40.0, 100.0, 80.0))
    assert not BoxView.of(seen, known, nobody).is_like(before, box_px)
    assert not BoxView.of(seen, np.full(seen.z_m.shape, np.inf), ~nobody).is_like(before, box_px)


def test_the_front_of_what_nobody_has_put_a_box_around_is_a_wall_where_it_is_thin() -> None:
    somewhere = Detection("cup", None, (150.0, 130.0, 160.0, 140.0), 1.0, "me")
    row, wall = (drawn(wall_m=2.5, top_m=0.8, behind_m=3.5, thick_m=thick_m) for thick_m in (0.6, 0.1))
    (behind,) = find_walls(observe(PICTURE, row, CAMERA)[0], (somewhere,))
    assert behind.offset_m == pytest.approx(-3.5, abs=0.02)
    seen, _ = observe(PICTURE, wall, CAMERA)
    _, low = sorted(find_walls(seen, (somewhere,)), key=lambda one: one.offset_m)
    assert (low.offset_m, low.top_m, low.thick_m) == pytest.approx((-2.5, 0.8, 0.1), abs=0.03)
    behind_face_m = low.offset_m - seen.points_m[..., :2] @ low.normal
    on_top = (np.abs(behind_face_m - 0.05) < 0.03) & (np.abs(seen.points_m[..., 2] - 0.8) < 0.05)
    explained = np.abs(low.depth(seen.eye_m, seen.rays) - seen.z_m) < 0.05
    assert on_top.sum() > 100 and explained[on_top].mean() > 0.95


def test_a_wall_in_a_box_is_found_when_it_is_known_which_pixels_are_of_the_thing() -> None:
    seen, _ = observe(PICTURE, drawn(), CAMERA)
    thing = Detection("cupboard", None, (0.0, 0.0, 200.0, 150.0), 1.0, "me")
    nothing = np.zeros(seen.z_m.shape, dtype=bool)
    (far,) = find_walls(seen, ())
    assert find_walls(seen, (thing,)) == ()
    for known in ((), (replace(far, offset_m=far.offset_m + 0.05, top_m=1.0),)):
        (wall,) = find_walls_again(known, seen, (), nothing)
        assert (wall.offset_m, wall.top_m) == pytest.approx((far.offset_m, far.top_m), abs=0.01)
    assert find_walls_again((far,), seen, (thing,), nothing) == (far,), "one that is not seen again stays"
    on_wall = np.abs(seen.points_m[..., 0] - 4.0) < 0.1
    assert find_walls_again((), seen, (), on_wall) == (), "what was fitted is no wall"
    depth, owner = depth_of_empty(seen, (far,))
    assert (owner[on_wall] == 1).mean() > 0.95 and (owner[~on_wall] == 0).mean() > 0.95
    assert depth == pytest.approx(np.minimum(seen.floor_z_m, far.depth(seen.eye_m, seen.rays)))


@pytest.mark.parametrize("half_rad", [0.3, 0.17])
def test_a_low_wall_that_goes_on_behind_what_hides_its_ends_may_be_of_any_length(half_rad: float) -> None:
    low, before, far = (drawn(x, noise=0.0005, top_m=1.0, behind_m=3.0, thick_m=0.1) for x in (2.2, 2.0, 3.0))
    rays = rays_in_room()
    aside = np.abs(rays[..., 1]) > half_rad * rays[..., 0]
    hidden, seen_to_end = (replace(low, z_m=np.where(aside, other.z_m, low.z_m)) for other in (before, far))
    for depth, offsets_m in ((hidden, [-3.0, -2.2]), (seen_to_end, [-3.0])):
        seen, _ = observe(PICTURE, depth, CAMERA)
        found = find_walls(seen, (), fitted=aside)
        assert sorted(wall.offset_m for wall in found) == pytest.approx(offsets_m, abs=0.02)


@pytest.mark.parametrize("askew_rad", [0.0, math.radians(8.0)])
def test_a_wall_goes_exactly_square_to_another_where_its_points_do(askew_rad: float) -> None:
    """Few pixels tell badly how a wall is turned that is seen from its end."""
    depth, rays = drawn(noise=0.004), rays_in_room()
    across = rays[..., 1] * math.cos(askew_rad) + rays[..., 0] * math.sin(askew_rad)
    aside_m = np.where(across > 1e-6, 0.9 / np.maximum(across, 1e-6), np.inf)
    z_m = np.minimum(depth.z_m, aside_m + 0.004 * np.random.default_rng(1).normal(size=aside_m.shape))
    nothing = (Detection("cup", "cup", (0.0, 0.0, 4.0, 4.0), 1.0, "me"),)
    found = find_walls(observe(PICTURE, replace(depth, z_m=z_m), CAMERA)[0], nothing)
    ahead, aside = sorted(found, key=lambda wall: wall.offset_m)
    assert (ahead.offset_m, aside.offset_m) == pytest.approx((-4.0, -0.9), abs=0.02)
    assert float(ahead.normal @ aside.normal) == pytest.approx(math.sin(askew_rad), abs=0.02 if askew_rad else 1e-9)


def test_what_is_left_of_a_front_beside_the_fit_of_it_is_no_wall() -> None:
    somewhere = Detection("cup", None, (150.0, 130.0, 160.0, 140.0), 1.0, "me")
    seen, _ = observe(PICTURE, drawn(wall_m=2.5, top_m=0.8, behind_m=3.5, thick_m=0.1), CAMERA)
    on_face = (np.abs(seen.points_m[..., 0] - 2.5) < 0.05) & (seen.points_m[..., 2] > 0.0)
    for most, offsets_m in ((1, [-3.5, -2.5]), (3, [-3.5])):
        fitted = on_face & (np.arange(SIZE[0]) % 4 < most)
        found = find_walls(seen, (somewhere,), fitted)
        assert sorted(wall.offset_m for wall in found) == pytest.approx(offsets_m, abs=0.03)


@pytest.mark.parametrize(("x_m", "width_m"), [(0.75, 1.0), (0.95, 0.8)])
def test_a_strip_of_a_tables_top_is_no_wall_where_nobody_has_boxed_the_table(x_m: float, width_m: float) -> None:
    table = PoseHypothesis(LIBRARY["table_round"], x_m, 0.1, 0.0, 0.0, (width_m, width_m, 0.69))
    somewhere = Detection("cup", "cup", (0.0, 0.0, 4.0, 4.0), 1.0, "me")
    assert find_walls(seen_from_above(table, finer=2)[0], (somewhere,)) == ()


@pytest.mark.parametrize("wall_m", [1.2, 3.0])
def test_a_picture_without_floor_is_refused(wall_m: float) -> None:
    with pytest.raises(PhotoRefused, match="floor") as caught:
        observe(PICTURE, drawn(wall_m=wall_m, floor=False), CAMERA)
    assert caught.value.kind == "floor"


def test_depth_in_another_unit_gives_no_floor() -> None:
    # Depths that are too small are no longer refused: a camera 0.28 m above a level plane is a real one over a desk.
    depth = drawn()
    with pytest.raises(PhotoRefused, match="at most 3 m") as caught:
        observe(PICTURE, replace(depth, z_m=depth.z_m * 2.5), CAMERA)
    assert caught.value.kind == "floor" and "--depth-unit-m" in str(caught.value)
    _, floor = observe(PICTURE, replace(depth, z_m=depth.z_m * 0.2), CAMERA)
    assert floor.above_top_m == pytest.approx(0.28, abs=0.01) and floor.source.startswith("assumed")
